"""The section on oblique impacts of docs/run_time_error.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..study import Columns, table

Row = dict[str, Any]

_WORDS = """\
One impact with friction gives ψ2, the slip speed after it in the unit μ v0/κ. *MBF* is the row of
springs of Maw, Barber and Fawcett, for which the package has a table. *Spring and slider* is one
spring of the form "force" (LAMMPS `mindlin/force`), which the package solves by phases.

- Errors are those of ψ2, absolute, the worst of the lanes that are not flagged; the last column has
  the share of lanes above 1e-9 or flagged. The truth of the springs follows the fronts of slip
  (`tests/elastic_rebound.py`, which also made the table) with steps of 0.001. Independent of it,
  4,096 springs with Richardson's extrapolation agree within 1.1e-9 on 48 lanes. χ is 49/34; over
  1,000 lanes of ten other χ the table's worst error was 1.1e-9 in one lane. The truth of
  spring-sliders is the code by hand at its finest tolerance, on all lanes. A test compares it with
  14 digits of a solve in extended precision.
- LAMMPS is compared with the same spring and slider, so its error is that of its steps. MuJoCo has
  no tangential spring; its rebounds are beside those of
  [`RigidCoulomb`](export.md#rebounds-with-coulomb-friction).
- *numba, by hand* has formulas in slip, Taylor series of order 16 in stick, and roots of their
  polynomials for the events, on all cores. *numba, springs* has steps of second order, on
  all cores. *numba, fronts of slip* has no springs to count, but needs an elastic impact.
- Times are µs an impact over seven turns: the best by the clock, and the mean of the processor,
  summed over threads. Ratios are of processor time. By the clock, numba works on both cores; the
  phases of the package work on one most of the time.
- The machine was shared. In busier runs the clock showed up to five times as much, the processor
  about the same; so targets are compared with both."""


def section(result: dict[str, Any]) -> list[str]:
    """Return the lines of the section."""
    groups = result["groups"]
    rows = [row for group in groups.values() for row in group["rows"]]
    lines = ["## Oblique impacts", "", *verdict(rows), "", *_WORDS.split("\n"), ""]
    lines += ['<details markdown="1"><summary>All rows</summary>', ""]
    lines += [_table(rows), "", "</details>", ""]
    loads = {str(group["load"]) for group in groups.values()}
    known = next(iter(groups.values()))["machine"]
    commits = ", ".join(sorted({group["machine"]["commit"] for group in groups.values()}))
    lines.append(
        f"Measured by `benchmarks/oblique.py` on {known['processor']}, {known['cores']} cores, "
        f"commit {commits}; load averages after the groups: {', '.join(sorted(loads))}."
    )
    return [*lines, ""]


def _row(rows: list[Row], case: str, method: str, setting: str | None = None) -> Row | None:
    for row in rows:
        same = row["case"] == case and row["method"] == method
        if same and (setting is None or row["setting"] == setting):
            return row
    return None


def verdict(rows: list[Row]) -> list[str]:
    """Return the figures that the page is read for, targets first."""
    lines = []
    shared, each = "MBF, one χ, elastic", "MBF, χ and α of each lane"
    table, slope = (
        _row(rows, shared, "jc.tangential_rebound" + x) for x in ("", " with derivative")
    )
    own = _row(rows, each, "jc.tangential_rebound with derivative")
    springs = [row for row in rows if row["case"] == shared and row["method"].startswith("numba")]
    if table and slope and springs:
        words = [
            f"{_times(row, table)} times for {row['error']:.0e} "
            f"({row['method'].removeprefix('numba, ')}, {row['setting']})"
            for row in springs
            if row["error"] < 1e-7 or row is springs[0]
        ]
        lines.append(
            f"- **MBF, one χ and α: {_both(table)}; with its derivative {_both(slope, 0.05)}**, "
            f"error {table['error']:.0e} (target 1e-9: {_met(table['error'] <= 1e-9)}).\n"
            f"  numba takes longer than the table: {'; '.join(words)}."
        )
    if own:
        lines.append(f"- **MBF, χ and α of each lane: {_both(own, 3)}**, with its derivative.")
    mine = _row(rows, "spring and slider", "jaxcontact, phases")
    hand = _row(rows, "spring and slider", "numba, by hand", "5e-10")
    fine = _row(rows, "spring and slider", "numba, by hand", "1e-13")
    scipy = _row(rows, "spring and slider", "SciPy with events", "rtol 1e-08")
    if mine and hand and fine and scipy:
        lines.append(
            f"- **Spring and slider: {_both(mine, 5)}**, error {mine['error']:.0e} in the worst of "
            f"{mine['lanes']:,} lanes (target 1e-9: {_met(mine['error'] <= 1e-9)}). "
            f"**{_first(mine, hand, fine)}**: {_winner(mine, hand)}; {_winner(mine, fine)}. SciPy "
            f"takes {_times(scipy, mine)} times as long at {scipy['error']:.0e}."
        )
    all_of_it = _row(rows, "spring and slider", "jc.oblique_impact")
    if all_of_it:
        lines.append(f"- The whole `jc.oblique_impact` with it: {_both(all_of_it, 5)}.")
    plain = _row(rows, "spring and slider, small batch", "diffrax, clamped")
    whole = _row(rows, "spring and slider, small batch", "jc.oblique_impact")
    event = _row(rows, "spring and slider, small batch", 'jc.oblique_impact, "event"')
    if plain and whole and event:
        lines.append(
            f"- diffrax with the limit inside its right-hand side takes {_times(plain, whole)} "
            f"times as long as `jc.oblique_impact` ({plain['error']:.0e}), the package's "
            f'`method="event"` {_times(event, whole)} times ({event["error"]:.0e}, '
            f"{event['failed']:.0%} of the lanes flagged)."
        )
    slid = [row for row in rows if row["case"] == "all lanes slide"]
    if slid:
        words = "; ".join(f"{row['method']}: {_both(row)}" for row in slid)
        lines.append(f"- All lanes slide throughout. {words}.")
    return [*lines, *_engines(rows)]


def _engines(rows: list[Row]) -> list[str]:
    cases = [row for row in rows if row["case"].startswith("engine")]
    lammps = [row for row in cases if row["method"].startswith("LAMMPS")]
    lines = []
    if lammps:
        words = "; ".join(
            f"{row['method'].removeprefix('LAMMPS ')}, {row['setting']}: {row['error']:.0e}"
            for row in lammps
        )
        lines.append(f"- LAMMPS, worst error of ψ2: {words}.")
    return lines


def _first(mine: Row, *peers: Row) -> str:
    wins = [peer["cpu_us"] < mine["cpu_us"] and peer["us"] < mine["us"] for peer in peers]
    if all(wins):
        return "numba by hand wins"
    return "The package wins" if not any(wins) else "numba by hand wins at the larger error only"


def _met(good: bool) -> str:
    return "met" if good else "missed"


def _times(row: Row, other: Row) -> str:
    ratio = row["cpu_us"] / other["cpu_us"]
    return f"{float(f'{ratio:.2g}'):,.0f}" if ratio >= 10 else f"{ratio:.2g}"


def _both(row: Row, target: float | None = None) -> str:
    """Return both times, and whether they meet a target."""
    words = f"{row['us']:g} µs by the clock, {row['cpu_us']:g} µs of the processor"
    if target is None:
        return words
    verdicts = [_met(row[name] <= target) for name in ("us", "cpu_us")]
    if verdicts[0] == verdicts[1]:
        return f"{words} (target {target:g}: {verdicts[0]})"
    return (
        f"{words} (target {target:g}: {verdicts[0]} by the clock, {verdicts[1]} by the processor)"
    )


def _winner(mine: Row, peer: Row) -> str:
    """Return who is faster, by both times."""
    ratio, clock = mine["cpu_us"] / peer["cpu_us"], mine["us"] / peer["us"]
    return (
        f"numba by hand at {peer['error']:.0e} takes {1 / ratio:.2g} times the package's processor "
        f"time and {1 / clock:.2g} times its time by the clock"
    )


def _shown(name: str, form: str) -> Callable[[Row], str]:
    return lambda row: format(row[name], form) if "error" in row else "–"


def _table(rows: list[Row]) -> str:
    first: dict[str, Row] = {}
    for row in rows:
        first.setdefault(row["case"], row)
    columns: Columns = {
        "case": lambda row: row["case"],
        "method": lambda row: row["method"],
        "setting": lambda row: row["setting"],
        "impacts": lambda row: f"{row['lanes']:,}",
        "µs, clock": lambda row: f"{row['us']:g}",
        "µs, processor": lambda row: f"{row['cpu_us']:g}",
        "time ratio": lambda row: _times(row, first[row["case"]]),
        "error": _shown("error", ".1e"),
        "median error": _shown("median", ".1e"),
        "above 1e-9": _shown("above", ".0%"),
    }
    return table(columns, rows, "---")
