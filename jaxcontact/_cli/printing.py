"""Results as JSON: strict, with null for non-finite numbers."""

from __future__ import annotations

import json
import math
from typing import Any


def print_json(result: Any) -> None:
    """Print a result of dicts, lists, texts, numbers and arrays."""
    print(json.dumps(plain(result), indent=1, ensure_ascii=False, allow_nan=False))


def plain(value: Any) -> Any:
    """Convert arrays to lists, numbers to Python's, and non-finite ones to None."""
    if isinstance(value, dict):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    import numpy as np

    # The remaining values are arrays and numbers of NumPy and JAX.
    return plain(np.asarray(value).tolist())
