"""All jobs of the map, with their numbers of lanes."""

from __future__ import annotations

from .grid import CONCRETE, Job
from .kinds import KINDS

PRECISIONS = ("float64", "float32")
EXPONENTS = (*CONCRETE, None)
# Lanes of a job: a million if the truth comes from a table, 2e4 per law if it is integrated.
BY_TABLE = {"exact": 40_000, "phase": 20_000, "event": 20_000}
BY_MOTION = {"hunt_crossley": 2000, "kuwabara_kono": 500, "oscillator": 1000}


def _exponents(kind: str) -> tuple[float | None, ...]:
    # Jankowski's law is made for 3/2.
    return (1.5,) if KINDS[kind].approach else EXPONENTS


def all_jobs() -> list[Job]:
    """In the order in which they are run."""
    jobs = []
    for precision in PRECISIONS:
        for kind, described in KINDS.items():
            for n in _exponents(kind):
                jobs += [
                    Job(
                        kind,
                        n,
                        False,
                        method,
                        precision,
                        BY_TABLE[method] if described.has_table(n) else BY_MOTION[described.family],
                    )
                    for method in _free_methods(kind)
                ]
                lanes = BY_MOTION[described.family] * (2 if described.approach else 1)
                jobs.append(Job(kind, n, True, "event", precision, lanes))
    # The most common cases first, so that an interrupted run has covered them.
    first = {1.5: 0, None: 1, 1.0: 2, 3.0: 3, 2.0: 4}
    return sorted(jobs, key=lambda job: (job.precision != "float64", first[job.exponent]))


def _free_methods(kind: str) -> tuple[str, ...]:
    described = KINDS[kind]
    if kind == "hunt_crossley_tension":  # never pulls in a free impact
        return ()
    phase = ("phase",) if described.tension or described.family == "hunt_crossley" else ()
    exact = () if described.family == "kuwabara_kono" else ("exact",)
    return (*exact, "event", *phase)


def by_table(jobs: list[Job]) -> list[list[Job]]:
    """The jobs in groups that share a table of free impacts; the others alone.

    In the order of the first of each group.
    """
    groups: dict[object, list[Job]] = {}
    for job in jobs:
        shared = not job.pushed and KINDS[job.kind].has_table(job.exponent)
        groups.setdefault((job.kind, job.exponent) if shared else job, []).append(job)
    return list(groups.values())
