"""Numbers that a prediction never uses."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..._text.words import first_few
from ..problem.problem import FitProblem, evaluated
from .minimum import SearchEnd


def refuse_unused(problem: FitProblem, found: SearchEnd) -> None:
    """Raise ValueError for numbers of the start that do not enter the prediction.

    A number whose derivative alone vanishes is not identifiable, which is not a mistake.
    """
    without = np.flatnonzero(~np.any(found.jacobian, axis=0))
    if not without.size:
        return
    leaves, structure = jax.tree.flatten(problem.space.tree_of(jnp.asarray(found.values)))
    fitted = [i for i, shape in enumerate(problem.space.shapes) if shape is not None]

    def of_fitted(numbers: list[jax.Array]) -> list[jax.Array]:
        whole = list(leaves)
        for i, number in zip(fitted, numbers, strict=True):
            whole[i] = number
        tree = jax.tree.unflatten(structure, whole)
        return jax.tree.leaves(evaluated(problem.predict, tree, problem.x))

    jaxpr = jax.make_jaxpr(of_fitted)([leaves[i] for i in fitted]).jaxpr
    # Backwards from the results; all inputs of one operation count as used by it.
    used = {id(one) for one in jaxpr.outvars}
    for step in reversed(jaxpr.eqns):
        if any(id(one) in used for one in step.outvars):
            used |= {id(one) for one in step.invars}
    counts = [np.size(leaves[i]) for i in fitted]
    enters = np.repeat([id(one) in used for one in jaxpr.invars], counts)
    names = [problem.space.names[i] for i in without if not enters[i]]
    if names:
        raise ValueError(
            "Argument `start` must hold numbers that the prediction uses, but does not use "
            f"{first_few(names)}; leave out what is not fitted, or hold it by `transforms`."
        )
