"""The ball of Table 2 and its twenty impacts: four laws, five restitutions, one batch."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from .._contact import Contact
from .._laws import Damped, get_law
from ._figures.style import FOUR_LAWS, RESTITUTIONS
from ._impacts import SolvedImpacts, cache_by_precision, solve
from ._reproduction import Table, long_table

MASS, RADIUS, HEIGHT, GRAVITY, STIFFNESS = 1.0, 0.1, 1.0, 9.8, 1.4e8
"""Table 2, in kg, m, m, m/s² and N/m^1.5."""

DROP = HEIGHT - RADIUS
"""Fall height of the ball's lowest point, in m."""

SPEED = float(np.sqrt(2 * GRAVITY * DROP))
"""Speed at contact in m/s, Eq. 41 and 42."""

SAMPLES = 200


@cache_by_precision
def impacts() -> SolvedImpacts:
    """Solve the twenty impacts, shape (4, 5) for laws and restitutions, without gravity as in the
    paper.

    JAX's precision setting applies.
    """
    e = jnp.asarray(RESTITUTIONS)
    alpha = jnp.stack([get_law(law.key, e=e).damping_factor() for law in FOUR_LAWS])
    # One law with α as its parameter represents all four, so one compiled solve suffices.
    return solve(Damped(alpha=alpha), Contact(mass=MASS, stiffness=STIFFNESS), SPEED, SAMPLES)


def ball_table() -> Table:
    """Return the outcome of all twenty impacts, law by law, each from e = 1.0 down to 0.2."""
    solved = impacts()
    columns = {
        "law": np.array([[law.key] for law in FOUR_LAWS]),
        "e_in": RESTITUTIONS,
        "alpha": solved.alpha,
        "max_deformation_m": solved.max_indentation,
        "duration_s": solved.duration,
        "max_force_N": solved.max_force,
        "rebound_velocity_m_per_s": solved.rebound_velocity,
        "energy_loss_J": solved.energy_loss,
        "e_out": solved.restitution,
    }
    return long_table(columns)
