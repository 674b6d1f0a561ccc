"""Settings of every test: double precision, strict arrays, repeatable examples, no windows."""

import atexit
import gc
import os
import pathlib
import shutil
import sys
import tempfile
from importlib.metadata import version

# Set before anything imports matplotlib, so that no display is needed.
os.environ.setdefault("MPLBACKEND", "Agg")
# One compilation cache for the run, shared by its workers and by the programs that tests start
# through this variable. It is created fresh and removed, since an older cache would hide a change
# of XLA.
if "JAXCONTACT_TEST_CACHE" not in os.environ:
    os.environ["JAXCONTACT_TEST_CACHE"] = tempfile.mkdtemp(prefix="jaxcontact-tests-")
    atexit.register(shutil.rmtree, os.environ["JAXCONTACT_TEST_CACHE"], ignore_errors=True)
os.environ["JAX_COMPILATION_CACHE_DIR"] = os.environ["JAXCONTACT_TEST_CACHE"]
# Without bytecode each process that a test starts compiles its imports, which takes two seconds.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    os.environ["PYTHONPYCACHEPREFIX"] = f"{os.environ['JAXCONTACT_TEST_CACHE']}/bytecode"
os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "true"
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
# Source locations of operations are not needed, and take a twentieth of the run time.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
# Of each error that passes through JAX, the filter of its traceback looks up the file of each frame
# on the disk, which takes longer than to find the error: a third of tests/test_every_argument.
os.environ.setdefault("JAX_TRACEBACK_FILTERING", "off")
# Threads of OpenBLAS that wait for work take more time than small matrices: an eigenvalue problem
# of 180 rows 25 times as much.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Programs are compiled once here and run a few times. The compiler's optimisations cost more time
# than they save. Its newer way to emit loops takes half the time of a compilation. Set this
# variable to 0 to run the tests with the compiler settings of users.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# XLA ends the process at an unknown flag, so other versions get no flags.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    # Notes of what may alias only help optimisations, and take a thirtieth of each compilation.
    " --xla_llvm_enable_alias_scope_metadata=false --xla_llvm_enable_noalias_metadata=false"
    # Code motion into and out of loops takes an eighth of each compilation and saves less.
    " --xla_disable_hlo_passes=while-loop-invariant-code-motion,while-loop-constant-sinking"
    if os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] == "1" and version("jaxlib").startswith("0.10.")
    else "",
)

import jax
import pytest
from hypothesis import HealthCheck, settings

# The library sets none of these; they belong to the application.
jax.config.update("jax_enable_x64", True)
# An accidental float32 or a missing axis should fail here instead of losing digits silently.
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Tracing makes millions of short-lived objects. At Python's default rate the search for cycles
# takes a tenth of the run and finds almost nothing; at 50,000 objects it takes a fifth of that.
gc.set_threshold(300_000, 50, 20)

settings.register_profile(
    "jaxcontact",
    derandomize=True,
    # The first example includes compilation.
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("jaxcontact")

# The longest files run first, so that no worker ends with a long one alone.
_LONG = (
    "test_random_mechanisms test_friction_gradients test_friction_coupled test_rounding "
    "test_weight test_chains test_soft_runs test_gravity test_gradients test_methods "
    "test_agreement test_derivatives test_every_argument test_force_ends test_necks_and_memories"
).split()
_PLACE = {name: place for place, name in enumerate(_LONG)}


def pytest_collection_finish(session):
    """What is there before the first test stays: no search for circles goes through it again."""
    gc.collect()
    gc.freeze()


_TESTS = pathlib.Path(__file__).resolve().parent
_MOST_LEFT_OUT = 0.05


# Left out unless `-m` asks for them. The code of the benchmarks changes seldom; weights do often.
_ON_REQUEST = ("engines", "nightly")
# What a quick check runs: one of each kind. A line names a file, a function or a case.
_CORE = tuple((_TESTS / "core.txt").read_text(encoding="utf-8").split())


def pytest_collection_modifyitems(config, items):
    items.sort(key=lambda item: _PLACE.get(item.path.stem, len(_LONG)))
    for item in items:
        if item.path.parent.name == "test_benchmarks" and item.path.stem != "test_weight":
            item.add_marker("nightly")
        if item.nodeid.startswith(_CORE):
            item.add_marker("core")
    named = any("::" in argument for argument in config.args)
    if not named and (lost := _without_case(items)):
        raise pytest.UsageError(f"slow() names cases that do not exist: {', '.join(sorted(lost))}")
    left = [item for item in items if _is_left_out(item)]
    # `args_source` is not available in workers.
    everything = [pathlib.Path(name).resolve() for name in config.args] == [_TESTS]
    if everything and len(left) > _MOST_LEFT_OUT * len(items):
        raise pytest.UsageError(
            f"{len(left)} of {len(items)} tests are slow: more than a twentieth"
        )
    # Tests named on the command line, or selected with -m, are never deselected.
    if named:
        return
    asked = config.option.markexpr
    out = set() if "slow" in asked else set(left)
    closed = [mark for mark in _ON_REQUEST if mark not in asked]
    out |= {item for item in items if any(map(item.get_closest_marker, closed))}
    if out:
        config.hook.pytest_deselected(items=[item for item in items if item in out])
        items[:] = [item for item in items if item not in out]


def _without_case(items):
    """Return what `slow("id", ...)` names and no case of the function is called."""
    named = {
        f"{item.nodeid.partition('[')[0]}[{case}]"
        for item in items
        for mark in item.iter_markers("slow")
        for case in mark.args
    }
    return named - {item.nodeid for item in items}


def _is_left_out(item):
    """Whether a test is slow: all of it, or the cases that `slow("id", reason=...)` names."""
    mark = item.get_closest_marker("slow")
    if mark is None:
        return False
    if not mark.kwargs.get("reason"):
        raise pytest.UsageError(f"{item.nodeid}: a slow test says why, slow(reason=...)")
    if mark.args and item.callspec.id not in mark.args:
        item.own_markers.remove(mark)
        return False
    return True


# Linux limits a process to 65,530 memory regions and ends it beyond. A compiled program takes a
# few, an impact by an adaptive solve about 500.
_MAPS, _MEMORY = pathlib.Path("/proc/self/maps"), pathlib.Path("/proc/self/statm")
_MOST_MAPS = 25_000
_MOST_BYTES = 3_000_000_000


def _is_full():
    if not _MAPS.exists():
        return False
    held = int(_MEMORY.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return held > _MOST_BYTES or _MAPS.read_bytes().count(b"\n") > _MOST_MAPS


# A test file compiles so many programs at most: those of the list, or this number. Alone it
# compiles more than among others, and `.ci/times.py` counts it alone.
_PROGRAMS = 80
_BUDGETS = {
    name: int(most)
    for name, most in map(str.split, (_TESTS / "programs.txt").read_text("utf-8").splitlines())
}
_compiled, _heard = [0], []


def _count(event, _seconds, **_):
    if event == "/jax/core/compile/backend_compile_duration":
        _compiled[0] += 1
        _heard.append(event)


jax.monitoring.register_event_duration_secs_listener(_count)


@pytest.fixture(scope="module", autouse=True)
def room_for_programs(request):
    """Hold a file to its budget of programs, and drop them afterwards where they are too many.

    The cache still has them. After every file it would cost a tenth more: files share small
    programs. Never, a worker grows to 8 GB.
    """
    before = _compiled[0]
    yield
    # Matplotlib warns of more than twenty figures.
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")
    if _is_full():
        jax.clear_caches()
        gc.collect()
    name = request.path.relative_to(_TESTS).as_posix()
    count, most = _compiled[0] - before, _BUDGETS.get(name, _PROGRAMS)
    # With -m, other cases run; other versions of JAX compile other small programs.
    if not request.config.option.markexpr and version("jax") == "0.10.2":
        assert count <= most, f"tests/{name} compiled {count} programs; its budget is {most}"


@pytest.fixture
def usual_promotion():
    """The promotion that users have, for calls into libraries that do not keep the strict one.

    optax's Adam raises a float to an integer count; diffrax's event solve mixes float32 states with
    float64 times; JaxSim and MJX mix precisions and shapes.
    """
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        yield


@pytest.fixture
def compiled():
    """What was compiled in a test; `clear` it where the count begins."""
    _heard.clear()
    return _heard
