"""The workers of `python benchmarks/stability.py`; the oracles here share no code with jaxcontact."""
