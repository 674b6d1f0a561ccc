"""Run time against error: the parts of `benchmarks/run_time_error.py`."""
