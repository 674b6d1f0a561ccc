"""Run time against error, compared with all alternatives of a user.

`python -m benchmarks run_time_error [GROUP]` measures what benchmarks/run_time_error.json lacks and
writes docs/run_time_error.md and its figures. An interrupted run continues. A row measured with
other code, other libraries or another machine is measured again.

Peers: `pip install '.[benchmarks,engines]' mujoco-mjx jaxsim billiards`. Missing peers are
reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import jax

from benchmarks.study import Study
from benchmarks.time_and_error import derivatives, engines, fits, impacts, page, scenes
from benchmarks.time_and_error.running import Store

GROUPS: dict[str, Callable[[Store, str, bool], None]] = {
    "impacts": impacts.run,
    "derivatives": derivatives.run,
    "engines": engines.run,
    "scenes": scenes.run,
    "fits": fits.run,
}
"""The groups in the order of the page."""


def measure(
    path: Path, fresh: bool, group: str | None, busiest: float, only: str, small: bool
) -> None:
    store = Store(path, fresh, busiest)
    # A cached program would cost no compile time. The tests use a cache and report no times.
    jax.config.update("jax_enable_compilation_cache", small)
    for name in [group] if group else GROUPS:
        GROUPS[name](store, only, small)


OPTIONS = {
    "group": {"nargs": "?", "choices": GROUPS, "help": "one group; all by default"},
    "--busiest": {"type": float, "default": math.inf, "help": "load average to accept"},
    "--only": {"default": "", "help": "ways whose name contains this, or in impacts the problem"},
    "--small": {"action": "store_true", "help": "a few rows of every group"},
}
STUDY = Study(
    __file__,
    __doc__,
    measure,
    page.written,
    "run_time_error",
    OPTIONS,
    draw=page.draw,
    keeps=True,
    whole=True,
)
