"""By which code a job was answered."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "jaxcontact"
# All that an impact stands on; what stands on impacts changes none of the map.
ROOMS = (
    *("_parameter.py", "_varying.py", "_elementary.py", "_implicit.py", "_contact.py"),
    *("_forms", "_laws", "_impact"),
)


@functools.cache
def fingerprint() -> str:
    """Ten digits that change with the files that compute impacts."""
    digest = hashlib.sha256()
    for room in ROOMS:
        place = PACKAGE / room
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.relative_to(PACKAGE).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:10]
