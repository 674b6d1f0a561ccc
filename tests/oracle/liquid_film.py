"""A sphere that meets a wall through a film of liquid, in 25 digits.

Nothing of ``jaxcontact`` is imported.
"""

import mpmath as mp

from tests.oracle.stored import stored

E, VISCOSITY, RADIUS, MASS = 0.9, 0.05, 2e-3, 1e-4
FILM, ROUGHNESS = 1e-4, 1e-6


@stored()
def through_the_film(speed, resists):
    """The speed after the film, which resists with 6πμa² v/x on the way in, or on both ways.

    Newton's equation over τ, dt = x dτ, which is regular: the gap and the speed over FILM.
    """
    with mp.workdps(25):
        drag = 6 * mp.pi * mp.mpf(VISCOSITY) * mp.mpf(RADIUS) ** 2 / mp.mpf(MASS)
        ratio = mp.mpf(ROUGHNESS) / mp.mpf(FILM)

        def leave(speed, begin, end, sign):
            path = mp.odefun(lambda _, y: [sign * y[1] * y[0], -drag * y[1]], 0, [begin, speed])
            guess = abs(mp.log(end / begin)) / speed
            return path(mp.findroot(lambda tau: path(tau)[0] / end - 1, (guess, 1.01 * guess)))[1]

        inside = leave(mp.mpf(speed), mp.mpf(1), ratio, -1)
        out = E * inside
        return float(leave(out, ratio, mp.mpf(1), 1) if resists else out)
