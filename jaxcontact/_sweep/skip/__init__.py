"""Dependences of a traced function: the arrays to compute over each set of dimensions."""
