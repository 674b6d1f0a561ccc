"""Laws with a memory of a user's own: two curves in SI units."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxcontact as jc
from tests.oracle.plastic_chain import follow, thornton
from tests.oracle.stored import stored
from tests.test_impact.support import impacts

FORMULA = 1e-10
"""Of event solves at rtol 1e-11 beside formulas: measured 5e-12 fully plastic, 2e-11 near yield."""
CREEPS = 1e-9  # of strong damping beside formulas
LOST = 5e-9  # of the same energy loss where it is 1 % of the energy: measured 8e-10
SLOPES = 1e-6  # of derivatives across a corner beside those of the formula: measured 1e-7
IN_SCENES = 1e-9  # of velocities in m/s at rtol 1e-10, beside SciPy

STEEL = jc.Contact(mass=0.03, stiffness=4 / 3 * 1e11 * 0.01**0.5)
C, STRONG = 5e7, np.array([30.0, 100.0, 300.0])


class FullyPlastic(jc.AbstractElasticPlastic):
    s: jax.Array

    def loading(self, indentation, contact):
        return self.s * indentation

    def unloading(self, largest, contact):
        force = self.loading(largest, contact)
        way_back = force / (contact.stiffness * jnp.sqrt(2 * largest))
        return force / way_back**1.5, largest - way_back


class Yielding(jc.AbstractElasticPlastic):
    """`Viscoplastic` by the indentation at yield."""

    depth: jax.Array
    c: float | jax.Array = C

    def corners(self, contact):
        return (self.depth,)

    def damping(self, contact):
        return self.c / contact.stiffness

    def loading(self, indentation, contact):
        beyond = jnp.maximum(indentation - self.depth, 0)
        elastic = jc.power(jnp.minimum(indentation, self.depth), 1.5)
        return contact.stiffness * (elastic + 1.5 * jnp.sqrt(self.depth) * beyond)

    def unloading(self, largest, contact):
        force = self.loading(largest, contact)
        way_back = force / (contact.stiffness * jnp.sqrt(largest))
        way_back = jnp.where(largest > self.depth, way_back, largest)
        return force / jc.power(way_back, 1.5), largest - way_back


def depth_of(yield_speed, contact):
    return (1.25 * contact.mass * yield_speed**2 / contact.stiffness) ** 0.4


def test_johnsons_fully_plastic_spheres():
    """e = c (Y/E*)^(1/2) (½ m v²/(Y R³))^(-1/8), with c from the energies in 40 digits. Johnson
    prints c = 3.8.
    """
    with mp.workdps(40):
        # With F = 2πRp δ and p = 3Y the work is πRp δ², and the way back returns 3F²/(10 a E*).
        # In units of R, Y and ½ m v², and with E* = Y.
        depth = mp.sqrt(1 / (3 * mp.pi))
        c = mp.sqrt(3 * (6 * mp.pi * depth) ** 2 / (10 * mp.sqrt(2 * depth)))
    radius, modulus, stress = 0.01, 1e11, 3e8
    speeds = np.array([0.5, 2.0, 5.0])
    hit = impacts(FullyPlastic(6 * np.pi * radius * stress), STEEL, speeds)
    energy = 0.5 * 0.03 * speeds**2 / (stress * radius**3)
    found = hit.restitution * (modulus / stress) ** 0.5 * energy**0.125
    np.testing.assert_allclose(found, float(c), rtol=FORMULA)
    assert abs(float(c) - 3.743) < 5e-4
    assert hit.method == "event"


def test_a_law_of_ones_own_is_that_of_the_package():
    """Elastic, barely yielding and plastic impacts, their derivatives by the yield, and strong
    damping: bodies creep apart at K/c, where 1 - c v/K is smaller than the error of a solve.
    """
    speeds = np.array([0.02, 0.051, 0.2, 2.0, 2.0, 2.0, 2.0])
    c = np.append(np.full(4, C), STEEL.stiffness / 2.0 * STRONG)
    names = ("restitution", "duration", "max_indentation", "max_force", "energy_loss")

    def numbers(law_of):
        def at(yield_speed):
            hit = jc.impact(law_of(yield_speed), STEEL, speeds)
            return jnp.stack([getattr(hit, name) for name in names])

        return jax.jit(lambda v: jax.jvp(at, (v,), (1.0,)))(0.05)

    found, mine = numbers(lambda v: Yielding(depth_of(v, STEEL), c))
    wanted, theirs = numbers(lambda v: jc.Viscoplastic(yield_speed=v, c=c))
    np.testing.assert_allclose(found[:4, :4], wanted[:4, :4], rtol=FORMULA)
    np.testing.assert_allclose(found[4, :4], wanted[4, :4], rtol=LOST)
    np.testing.assert_allclose(mine[0, 1:4], theirs[0, 1:4], rtol=SLOPES)
    np.testing.assert_allclose(found[:2, 4:], wanted[:2, 4:], rtol=CREEPS)
    assert mine[0, 0] == 0


MASSES = [0.03, 0.0015, 0.03]
PAIR = jc.Contact(mass=0.03 * 0.0015 / 0.0315, stiffness=2e8)  # all pairs have one effective mass


@stored()
def of_three(stiffness, mass, yield_speed, c):
    """The velocities of three balls in contact after 3 ms."""
    pair = thornton(mass, stiffness, yield_speed, c)
    return follow([pair, pair], MASSES, [0.0, 0.0], [2.0, 0.0, 0.0], 0.003).velocity


def test_in_a_scene():
    """Three balls in contact together, which load again."""
    balls = [
        jc.Sphere(radius=0.01, mass=mass, position=[0.02 * k], velocity=[2.0 * (k == 0)])
        for k, mass in enumerate(MASSES)
    ]
    law = Yielding(depth_of(0.3, PAIR))
    run = jc.simulate(jc.Scene(balls, law, stiffness=2e8), 0.003, rtol=1e-10)
    velocity, lost = run.velocity[-1].ravel(), np.sum(run.impacts.energy_loss)
    np.testing.assert_allclose(velocity, of_three(2e8, float(PAIR.mass), 0.3, C), atol=IN_SCENES)
    left = np.sum(0.5 * np.array(MASSES) * velocity**2)
    np.testing.assert_allclose(left + lost, run.energy[0], rtol=IN_SCENES)


def test_curves_that_do_not_meet_are_flagged():
    class Loose(FullyPlastic):
        share: float | jax.Array

        def unloading(self, largest, contact):
            stiffness, end = super().unloading(largest, contact)
            return self.share * stiffness, end

    slope = jnp.asarray(6e6)
    hit = impacts(Loose(slope, np.array([1.0, 0.5, 1.4])), STEEL)
    wrong = jc.Status.NOT_CONVERGED
    np.testing.assert_array_equal(hit.status, [jc.Status.SEPARATED, wrong, wrong])
    balls = [jc.Sphere(0.01, 0.03, [place], [speed]) for place, speed in ((0.0, 1.0), (0.03, 0.0))]
    scene = jc.Scene(balls, Loose(slope, 0.5), stiffness=1e8)
    run = jc.simulate(scene, 0.1, instantaneous=True, throw=False)
    assert run.status == jc.Ending.NOT_CONVERGED


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"exponents": (1.0, 1.5)}, "one exponent of its way back"),
        ({"corners": lambda self, *given: jnp.ones(())}, r"Odd\.corners` must return"),
        ({"unloading": lambda self, *given: jnp.ones(())}, r"Odd\.unloading` must return"),
    ],
)
def test_curves_of_another_kind_are_refused(change, message):
    law = type("Odd", (FullyPlastic,), change)
    with pytest.raises(TypeError, match=message):
        jc.impact(law(jnp.asarray(6e6)), STEEL, 1.0)
