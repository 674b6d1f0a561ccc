"""The workers of `python benchmarks/stability.py`; its oracles share no code with jaxcontact."""
