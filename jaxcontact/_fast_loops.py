"""The flag with which XLA compiles a small loop as one function.

On CPUs, XLA runs the body of a loop as many small kernels, and each number between them goes
through memory. It compiles the loop as one function if an iteration touches few bytes. The default
limit, 1,024, is below what one step of an impact needs. JAX accepts this option for a whole process
only, before its backend starts.
"""

from __future__ import annotations

import os
import re
import sys
from typing import NamedTuple

VARIABLE = "JAXCONTACT_FAST_LOOPS"
"""Set it to 0 to leave XLA's flags alone."""

_KEY = "xla_cpu_small_while_loop_byte_threshold"
_FLAG = f"--xla_backend_extra_options={_KEY}=1000000"
_DEFAULT = 1024


class FastLoops(NamedTuple):
    """The answer of `fast_loops`: XLA compiles the loops of this process as single functions on
    CPUs, or not, and why. True in a condition if it does.

    - `on`: whether it does
    - `reason`: what set the flag, or what prevented it
    """

    on: bool
    reason: str

    def __bool__(self) -> bool:
        return self.on


def _set() -> FastLoops:
    flags = os.environ.get("XLA_FLAGS", "")
    if os.environ.get(VARIABLE) == "0":
        # A parent process may have set the flag.
        if _FLAG in flags and not _started():
            os.environ["XLA_FLAGS"] = flags = flags.replace(_FLAG, "").strip()
        if _KEY not in flags:
            return FastLoops(False, f"{VARIABLE} is 0")
    if given := re.findall(rf"{_KEY}=(\d+)", flags):
        return FastLoops(int(given[-1]) > _DEFAULT, f"XLA_FLAGS sets {_KEY}={given[-1]}")
    if _started():
        reason = "JAX's backend had started when jaxcontact was imported; import jaxcontact first"
        return FastLoops(False, reason)
    os.environ["XLA_FLAGS"] = f"{flags} {_FLAG}".strip()
    return FastLoops(True, "set when jaxcontact was imported")


def _started() -> bool:
    """Return whether a backend of JAX runs, without importing JAX."""
    bridge = sys.modules.get("jax._src.xla_bridge")
    return bridge is not None and bool(bridge.backends_are_initialized())


_found = _set()


def fast_loops() -> FastLoops:
    """Return whether XLA compiles the loops of this process as single functions on CPUs, and why.

    Importing jaxcontact sets the XLA option `xla_cpu_small_while_loop_byte_threshold` to 1,000,000
    by the environment variable XLA_FLAGS. It does not if that variable holds the option, if
    JAXCONTACT_FAST_LOOPS is 0, or if JAX's backend runs already. The results of a loop agree to
    rounding. Loops with library calls, and those on other devices, are compiled as before.
    """
    return _found
