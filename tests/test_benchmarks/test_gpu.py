"""The benchmark for GPUs in short form on a CPU, and what a GPU is asked to compile."""

import json

import jax
import pytest

from benchmarks import gpu
from jaxcontact._program import compiled

WITHIN = {"float64": 1e-13, "float32": 1e-5}  # measured 3e-15 and 2e-7


def test_rows_have_an_error_and_a_failed_one_its_reason(tmp_path, monkeypatch, usual_promotion):
    """The closed form, and a task that cannot be made."""

    def none(size, precision, platform):
        raise MemoryError("no | room")

    exact = next(task for task in gpu.TASKS if task.what == "exact")
    monkeypatch.setattr(gpu, "TASKS", (exact._replace(make=none, what="broken"), exact))
    gpu.STUDY.command(["--quick", "--only", "impacts", "--into", str(tmp_path)])
    result = json.loads((tmp_path / "gpu.json").read_text())
    rows = [row for row in result["rows"] if row["platform"] == "cpu"]
    broken, good = ([r for r in rows if r["what"] == what] for what in ("broken", "exact"))
    assert {row["failed"] for row in broken} == {"MemoryError: no | room"}
    assert {row["precision"] for row in good} == set(WITHIN)
    for row in good:
        assert row["error"] < WITHIN[row["precision"]] and row["rate"] > 0
    assert "`MemoryError: no / room`" in (tmp_path / "gpu.md").read_text()
    # The page compares with the best rate of the CPU.
    row = next(row for row in good if row["precision"] == "float64")
    faster = row | {"platform": "gpu", "rate": 7 * row["rate"]}
    written = gpu.page({"machine": result["machine"], "rows": [*result["rows"], faster]})
    assert "(7 times the CPU)" in written


def rows_of(tmp_path, *asked):
    """The rows of the short form, by their group and name."""
    gpu.STUDY.command(["--quick", "--into", str(tmp_path), *asked])
    rows = json.loads((tmp_path / "gpu.json").read_text())["rows"]
    return {(row["group"], row["what"]): row for row in rows}


def test_calls_that_are_no_single_program_run(tmp_path, monkeypatch, usual_promotion):
    """A sweep and fits of many balls, which choose their own blocks."""
    chosen = [task for task in gpu.TASKS if task.whole and "event" not in task.what]
    monkeypatch.setattr(gpu, "TASKS", chosen)
    rows = rows_of(tmp_path, "--only", "sweeps", "fits")
    assert len(rows) == 2
    # The fits are compared with `jc.fit` in standard errors: measured 8e-15.
    assert all(row["error"] < WITHIN["float64"] and row["rate"] > 0 for row in rows.values())


@pytest.mark.slow(reason="compiles every kind of program of the benchmark, three minutes")
def test_the_whole_short_form_runs(tmp_path, usual_promotion):
    rows = rows_of(tmp_path)
    assert {group for group, _ in rows} == set(gpu.GROUPS)
    failed = {what for what, row in rows.items() if "failed" in row}
    # Its truth needs numba, of [benchmarks].
    assert failed <= {("friction", "table of Maw, Barber and Fawcett")}


def test_no_row_starts_after_the_limit(tmp_path):
    result = gpu.Result(tmp_path / "gpu.json", gpu.GROUPS)
    gpu.measure_group("impacts", True, gpu.Clock(0.0), result)
    assert all(row["failed"].startswith("TimeoutError") for row in result.rows) and result.rows


def test_a_gpu_is_given_no_option_of_a_cpu(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    # Past the caches, which hold this process's answer.
    monkeypatch.setattr(compiled, "soon_options", compiled.soon_options.__wrapped__)
    assert compiled.soon_options() is None
    assert compiled.quick_options.__wrapped__() is None


def test_an_option_that_this_jax_lacks_leaves_the_others(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    assert compiled._known({"xla_no_such_option": True}) is None
    # As from JAX 0.11 on, which has one way to emit loops.
    monkeypatch.setattr(compiled, "soon_options", lambda: None)
    assert "xla_backend_optimization_level" in compiled.quick_options.__wrapped__()
