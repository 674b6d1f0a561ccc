"""Generate ``reference.json``: ``python -m tests.oracle.generate`` (two minutes on two cores)."""

import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field

import mpmath
from mpmath import mp, mpf

from tests.oracle import _impacts as oracle
from tests.oracle._reference import REFERENCE_FILE

# Digits written. Differences lose some of the computed digits, second differences more.
VALUE_DIGITS, SLOPE_DIGITS, CURVATURE_DIGITS = 30, 25, 20
# Smaller numbers are the rounding of an exact zero, such as the loss of an elastic impact.
ZERO = mpf("1e-32")

ALPHAS = "0 1e-8 1e-4 0.01 0.3 0.5 1 2 5 14.4 20 100 1e3 1e4 1e6 1.6e6".split()
EXPONENTS = "1 1.25 1.5 2 3".split()


@dataclass(frozen=True)
class Job:
    """A case to compute: by which arguments to differentiate once, twice, and which one-sidedly."""

    function: str
    args: dict[str, str | bool]
    slopes: tuple[str, ...]
    curvatures: tuple[str, ...] = ()
    forward: frozenset[str] = field(default_factory=frozenset)


def jobs() -> Iterator[Job]:
    """The whole grid."""
    for n in EXPONENTS:
        for alpha in ALPHAS:
            # The family is analytic through alpha = 0, so two-sided differences are valid there.
            yield Job("hunt_crossley", {"alpha": alpha, "n": n}, ("alpha", "n"), ("alpha",))

    def oscillator(ending: str, exponents: str, zetas: str) -> Iterator[Job]:
        for n in exponents.split():
            for zeta in zetas.split():
                # With damping on approach only, the peak of the force is at the turn for zeta <= 0,
                # before it for > 0.
                one_sided = frozenset({"zeta"} if ending == "approach" and zeta == "0" else ())
                yield Job(
                    "oscillator",
                    {"zeta": zeta, "n": n, "ending": ending},
                    ("zeta",),
                    forward=one_sided,
                )

    yield from oscillator("tension", "1 1.5 2", "0 .1 .3 .5 .8 .95 .975")
    yield from oscillator("clamped", "1 1.5", ".05 .2 .5 .7 .9 .999 1 1.001 1.5 5 50")
    yield from oscillator("approach", "1.5", "0 .05 .2 .5 .9 1 1.5 5 50 1000")
    for tension in (True, False):
        for a in "0 .01 .1 .3 .6 1 1.5 3 5".split():
            # Without tension and damping the force ends with the indentation; with negative a it
            # would not.
            one_sided = frozenset({"a"} if a == "0" and not tension else ())
            yield Job(
                "kuwabara_kono", {"a": a, "n": "1.5", "tension": tension}, ("a",), forward=one_sided
            )
    for n in ("1", "1.5"):
        for alpha in ("0", ".3", "2"):
            for gamma in (".01", ".1", ".5", "-.05"):
                yield Job(
                    "with_gravity", {"alpha": alpha, "n": n, "gamma": gamma}, ("alpha", "gamma")
                )


def _text(x: mpf | None, digits: int) -> str | None:
    if x is None:
        return None
    return "0" if abs(x) < ZERO else mp.nstr(x, digits)


def row(job: Job) -> dict:
    """One case as it is stored."""
    function = getattr(oracle, job.function)
    # The double nearest to each printed decimal, which the library receives digit for digit.
    args = tuple(
        x if isinstance(x, bool) or k == "ending" else float(x) for k, x in job.args.items()
    )
    impact = function(*args)
    stored: dict = {
        "args": job.args,
        "value": [_text(getattr(impact, f), VALUE_DIGITS) for f in oracle.FIELDS],
    }
    if impact.settled:
        stored["settled"] = True
    for key, names, order, digits in (
        ("d", job.slopes, 1, SLOPE_DIGITS),
        ("d2", job.curvatures, 2, CURVATURE_DIGITS),
    ):
        for name in names:
            index = list(job.args).index(name)
            slopes = oracle.derivative(function, args, index, order, forward=name in job.forward)
            stored.setdefault(key, {})[name] = [_text(slopes[f], digits) for f in oracle.FIELDS]
    return stored


def main() -> None:
    """Computes the grid and writes the file, one case a line."""
    start = time.perf_counter()
    todo = list(jobs())
    with ProcessPoolExecutor(2) as pool:
        rows = list(pool.map(row, todo))
    lines: dict[str, list[str]] = {}
    for job, stored in zip(todo, rows, strict=True):
        lines.setdefault(job.function, []).append(json.dumps(stored, separators=(",", ":")))
    provenance = {
        "made_by": "python -m tests.oracle.generate",
        "mpmath": mpmath.__version__,
        "digits": {"value": VALUE_DIGITS, "d": SLOPE_DIGITS, "d2": CURVATURE_DIGITS},
        "arguments": "each stands for the double nearest to it",
        "derivatives": "null where the output has a kink",
    }
    comma = ",\n"
    blocks = comma.join(f'"{name}":[\n{comma.join(body)}\n]' for name, body in lines.items())
    REFERENCE_FILE.write_text(
        f'{{"provenance":{json.dumps(provenance)},\n"fields":{json.dumps(oracle.FIELDS)},\n"cases":{{\n{blocks}\n}}}}\n'
    )
    size = REFERENCE_FILE.stat().st_size / 1000
    print(f"{len(rows)} cases, {size:.0f} kB, {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
