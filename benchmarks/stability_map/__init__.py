"""The workers of `python -m benchmarks stability`; its oracles share no code with jaxcontact."""
