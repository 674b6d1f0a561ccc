"""Two balls above a table, as tests of exported scenes have them."""

import numpy as np

import jaxcontact as jc

BALLS = [
    jc.Sphere(0.01, 0.03, [0.0, 0.05], [0.3, 0.0], name="ball"),
    jc.Sphere(0.02, 0.1, [0.05, 0.06], [0.0, -0.2]),
]
SPUN = jc.Sphere(0.01, 0.03, [0.0, 0.05], [0.3, 0.0], spin=3.0, name="ball")
TABLE = jc.Plane([0.0, 0.0], [0.0, 2.0], name="the table")
LAW, STIFFNESS, GRAVITY = jc.HuGuo(e=0.7), 1e8, 9.81
TIMES = np.linspace(0, 0.1, 3)
# Closing speeds are given, so that no run is needed to find them.
SPEEDS = 0.1, 1.0
FRICTION = jc.SpringSlider(0.5, ratio=0.8)
BY_PAIR = {("ball", "the table"): jc.RigidCoulomb(0.1), "default": jc.RigidCoulomb(0.4)}


def scene(*bodies, **words):
    given = {"law": LAW, "stiffness": STIFFNESS, "gravity": [0.0, -GRAVITY]}
    return jc.Scene([*(bodies or [*BALLS, TABLE])], **{**given, **words})


def rolling(*bodies, **words):
    return scene(*(bodies or [SPUN, BALLS[1], TABLE]), **{"friction": FRICTION, **words})
