"""One ball in MJX, Brax and JaxSim, by their own contacts and by a law of ours in MJX and JaxSim.

`python -m benchmarks laws_inside` needs `pip install mujoco-mjx brax jaxsim`. The ball of 0.5 kg
meets a plane at 0.5, 1 and 3 m/s, without gravity, from four positions within a step; e shall be
0.8 and 0.5.

- MJX by default: the solref (0.02, 1) that every model has. There is no parameter e.
- MJX with numbers of `jc.export`: a spring and a dashpot by solref, as long as the contact at
  1 m/s.
- Brax `spring` and `positional`: their `elasticity` is e.
- JaxSim by default: the numbers that its soft contacts have. There is no parameter e.
- JaxSim with numbers for 1 m/s: K δ^(3/2) (1 + d δ'), where d of e is that of `ExactRestitution`.
- Ours: `contact_force` of `ExactRestitution`, at the step that `time_step` returns for all three
  speeds.

JaxSim's ball has one point, the lowest. Its integrator is the semi-implicit one, as MJX's.

The price is the processor's time for the step of a ball, of twelve in one compiled `vmap`, the
best of three runs. Rows that laws_inside.json has are kept, so that only engines of new rows must
be there; `--fresh` measures all of them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxcontact as jc
from benchmarks.study import HERE, Study, lines, table
from benchmarks.time_and_error.reading import cheapest, number, some

MASS, RADIUS, STIFFNESS = 0.5, 0.05, 1e6
"""kg, m, and N/m^(3/2)."""
ASKED, SPEEDS, PHASES = (0.8, 0.5), (0.5, 1.0, 3.0), (0.1, 0.37, 0.6, 0.95)
CONTACT = jc.Contact(mass=MASS, stiffness=STIFFNESS)
LASTS = 0.25
"""Simulated time in s: all contacts have ended, or creep."""

MODEL = """<mujoco><option gravity="0 0 0"/><custom><numeric name="elasticity" data="{e}"/></custom>
  <worldbody><geom name="floor" type="plane" size="5 5 1" condim="{condim}" {contact}/>
    <body pos="0 0 {radius}"><freejoint/>
      <geom name="ball" type="sphere" size="{radius}" mass="{mass}" condim="{condim}" {contact}/>
    </body></worldbody></mujoco>"""

# The first and last of the points of a sphere are on the axis y of its collision.
POINT = """<sdf version="1.9"><model name="ball"><link name="ball">
  <inertial><mass>{mass}</mass><inertia><ixx>5e-4</ixx><ixy>0</ixy><ixz>0</ixz><iyy>5e-4</iyy>
    <iyz>0</iyz><izz>5e-4</izz></inertia></inertial>
  <collision name="shape"><pose>0 0 0 1.5707963267948966 0 0</pose>
    <geometry><sphere><radius>{radius}</radius></sphere></geometry></collision>
  </link></model></sdf>"""

Bounce = Callable[[Any, Any, Any, Any], Any]
"""Velocity in m/s after a number of steps, from step, velocity, and phase of the touch."""


def text(e: float = 0.0, contact: str = "", condim: int = 1) -> str:
    return MODEL.format(e=e, contact=contact, condim=condim, radius=RADIUS, mass=MASS)


def duration(e: float, speed: float = 1.0) -> float:
    return float(jc.impact(jc.ExactRestitution(e=e), CONTACT, speed).duration)


def by_mjx(contact: str = "", law: jc.AbstractLaw | None = None, substeps: int = 1) -> Bounce:
    """MJX with a contact of its own, or with a law of ours."""
    import mujoco
    from mujoco import mjx

    model = mujoco.MjModel.from_xml_string(text(contact=contact))
    ours = law and jc.mjx.contact_force(law, CONTACT, model, substeps=substeps)
    engine = ours.model if ours else mjx.put_model(model)
    plain = mjx.make_data(engine)

    def bounce(step: Any, velocity: Any, phase: Any, count: Any) -> Any:
        timed = engine.tree_replace({"opt.timestep": step})
        data = plain.replace(
            qpos=plain.qpos.at[2].add(phase * velocity * step),
            qvel=plain.qvel.at[2].set(-velocity),
        )
        if ours:
            state = data, ours.init(timed, data)
            state = jax.lax.fori_loop(0, count, lambda _, s: ours.step(timed, *s), state)
            return state[0].qvel[2]
        return jax.lax.fori_loop(0, count, lambda _, d: mjx.step(timed, d), data).qvel[2]

    return bounce


def by_brax(pipeline: str, e: float) -> Bounce:
    """Brax, whose steps have the restitution as a parameter."""
    import importlib

    from brax.io import mjcf

    engine = importlib.import_module(f"brax.{pipeline}.pipeline")
    system = mjcf.loads(text(e=e, condim=3))

    def bounce(step: Any, velocity: Any, phase: Any, count: Any) -> Any:
        timed = system.tree_replace({"opt.timestep": step})
        q = jnp.asarray(system.init_q).at[2].add(phase * velocity * step)
        qd = jnp.zeros(6).at[2].set(-velocity)
        state = engine.init(timed, q, qd)
        none = jnp.zeros(0)
        return jax.lax.fori_loop(0, count, lambda _, s: engine.step(timed, s, none), state).qd[2]

    return bounce


def by_jaxsim(
    own: dict[str, float] | None = None, law: jc.AbstractLaw | None = None, substeps: int = 1
) -> Bounce:
    """JaxSim with soft contacts of these numbers, or with a law of ours."""
    import jaxsim.api as js
    from jaxsim.rbda.contacts import SoftContactsParams

    model = js.model.JaxSimModel.build_from_model_description(
        POINT.format(mass=MASS, radius=RADIUS),
        is_urdf=False,
        gravity=0.0,
        contact_params=SoftContactsParams.build(**own or {}),
    )
    with model.editable(validate=False) as model:
        points = model.kin_dyn_parameters.contact_parameters
        lowest = int(np.argmin(points.point[:, 2]))
        points.enabled = tuple(k == lowest for k in range(len(points.body)))
    ours = law and jc.jaxsim.contact_force(law, CONTACT, model, substeps=substeps)
    up = jnp.array([0.0, 0.0, 1.0])

    def bounce(step: Any, velocity: Any, phase: Any, count: Any) -> Any:
        timed = dataclasses.replace(ours.model if ours else model, time_step=step)
        data = js.data.JaxSimModelData.build(
            timed,
            base_position=(RADIUS + phase * velocity * step) * up,
            base_linear_velocity=-velocity * up,
        )
        if ours:
            state = data, ours.init(timed, data)
            state = jax.lax.fori_loop(0, count, lambda _, s: ours.step(timed, *s), state)
            return state[0].base_velocity[2]
        data = jax.lax.fori_loop(0, count, lambda _, d: js.model.step(timed, d), data)
        return data.base_velocity[2]

    return bounce


def for_one_speed(e: float) -> dict[str, float]:
    """The numbers of JaxSim's soft contacts with which e is right at 1 m/s."""
    damping = float(jc.ExactRestitution(e=e).damping_factor(CONTACT, 1.0))
    return {"K": STIFFNESS, "D": damping * STIFFNESS, "p": 0.5, "q": 1.5}


def exported(e: float) -> str:
    """The attributes of both geoms with the numbers of `jc.export`."""
    found = jc.export(jc.ExactRestitution(e=e), CONTACT, 1.0, engine="mujoco")
    k, b = found.parameters["stiffness"], found.parameters["damping"]
    return f'solref="{-k:.12g} {0 - b:.12g}" solimp="0.9 0.9 0.001 0.5 2"'


def methods() -> Iterator[tuple[str, str, Callable[[float], Bounce], Callable[[float], float]]]:
    """Yield engine, contact, a ball for each e, and its time step for each e."""

    def ours(by: Callable[..., Bounce], error: float, substeps: int = 1) -> tuple[Any, Any]:
        def ball(e: float) -> Bounce:
            return by(law=jc.ExactRestitution(e=e), substeps=substeps)

        def step(e: float) -> float:
            law = jc.ExactRestitution(e=e)
            return jc.mjx.time_step(law, CONTACT, SPEEDS, error=error, substeps=substeps)

        return ball, step

    def inside(engine: str, by: Callable[..., Bounce]) -> Iterator[tuple[str, str, Any, Any]]:
        yield (engine, "ours, for an error of 1 %", *ours(by, 0.01))
        yield (engine, "ours, for 0.1 %", *ours(by, 0.001))
        yield (engine, "ours, for 1 %, 8 substeps", *ours(by, 0.01, 8))

    yield "MJX", "its default", lambda e: by_mjx(), lambda e: 0.002
    for steps in (5, 20, 400):
        yield (
            "MJX",
            "its own, numbers of `jc.export`",
            lambda e: by_mjx(exported(e)),
            lambda e, steps=steps: duration(e) / steps,
        )
    for pipeline in ("spring", "positional"):
        for step in (0.002, 0.0001):
            yield (
                f"Brax, {pipeline}",
                "its own, `elasticity`",
                lambda e, pipeline=pipeline: by_brax(pipeline, e),
                lambda e, step=step: step,
            )
    yield from inside("MJX", by_mjx)
    yield "JaxSim", "its default", lambda e: by_jaxsim(), lambda e: 0.001
    for steps in (5, 20, 400):
        yield (
            "JaxSim",
            "its own, numbers for 1 m/s",
            lambda e: by_jaxsim(for_one_speed(e)),
            lambda e, steps=steps: duration(e) / steps,
        )
    yield from inside("JaxSim", by_jaxsim)


def measured(bounce: Bounce, step: float) -> tuple[float, float, float]:
    """Return the smallest and the largest e, and the processor time in s of a ball's step."""
    lanes = [np.array(x) for x in np.meshgrid(SPEEDS, PHASES)]
    v, phase = (jnp.asarray(x.ravel()) for x in lanes)
    count = round(LASTS / step)
    all_lanes = jax.jit(jax.vmap(bounce, in_axes=(None, 0, 0, None)))
    e = np.asarray(all_lanes(step, v, phase, count) / v)
    times = []
    for _ in range(3):
        begin = time.process_time()
        jax.block_until_ready(all_lanes(step, v, phase, count))
        times.append((time.process_time() - begin) / count / v.size)
    return float(e.min()), float(e.max()), min(times)


def rows(known: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield a row for each method, as far as it is not known."""
    for engine, contact, ball, step_of in list(methods())[len(known) :]:
        row: dict[str, Any] = {"engine": engine, "contact": contact, "e": []}
        for e in ASKED:
            step = step_of(e)
            low, high, seconds = measured(ball(e), step)
            shortest = duration(e, max(SPEEDS))
            row["e"].append(
                {"asked": e, "step": step, "low": low, "high": high, "seconds": seconds}
                | {"steps": shortest / step}
            )
        yield row


def both(of: Callable[[dict[str, Any]], str]) -> Callable[[dict[str, Any]], str]:
    """Return what a row says of both e, once where it is the same."""
    return lambda row: " / ".join(dict.fromkeys(map(of, row["e"])))


def span(low: float, high: float) -> str:
    ends = dict.fromkeys(f"{0 + round(x, 3):.3f}" for x in (low, high))
    return " to ".join(ends)


COLUMNS: dict[str, Callable[[dict[str, Any]], str]] = {
    "engine": lambda row: row["engine"],
    "contact": lambda row: row["contact"],
    "step/ms": both(lambda cell: f"{1e3 * cell['step']:.3g}"),
    "steps in a contact": both(lambda cell: number(cell["steps"])),
    **{
        f"{e:g} becomes": lambda row, k=k: span(row["e"][k]["low"], row["e"][k]["high"])
        for k, e in enumerate(ASKED)
    },
    "µs a step": lambda row: f"{1e6 * row['e'][0]['seconds']:.2g}",
}

ENGINES = {
    "jaxcontact": (
        "ExactRestitution, exact",
        "one impact, scenes of spheres and walls, mechanisms from equations; fits",
        "more than thirty laws, most with a given e; exact derivatives",
    ),
    "Exudyn": (
        "Exudyn, explicit",
        "multibody systems whose contact must be right",
        "e is a parameter; the law is of the family of ours",
    ),
    "Drake": (
        "Drake, continuous, implicit",
        "robots, if the error must be controlled",
        "K δ (1 + d δ'); e falls with speed",
    ),
    "MuJoCo": (
        "MuJoCo",
        "robots, control",
        "a spring and a dashpot; no e",
    ),
    "MJX": (
        "MJX",
        "thousands of robots on an accelerator",
        "that of MuJoCo, or a law of ours (below)",
    ),
    "JaxSim": (
        "JaxSim",
        "robots on an accelerator, with derivatives through the steps",
        "spring and dashpot at points, exponents free; no e; or a law of ours (below)",
    ),
    "LAMMPS": (
        "LAMMPS",
        "thousands to millions of grains",
        "e is a parameter; friction with a history",
    ),
}
"""By engine: its name in run_time_error.json, what it is for, and its contact."""

WITHIN = 0.01
"""The relative error of e for which the page states the price."""


def engines() -> str:
    """Return the table of engines of docs/engines.md, with prices of run_time_error.json."""
    every = json.loads((HERE / "run_time_error.json").read_text())["rows"].values()
    found = []
    for engine, (way, purpose, contact) in ENGINES.items():
        row = cheapest(some(every, group="engines", problem="exported", batch=5, way=way), WITHIN)
        if row is None:
            steps, price = "–", "–"
        elif engine == "Drake":
            steps, price = f"its own, accuracy {row['setting']:g}", number(row["cost"])
        else:
            steps, price = f"{row['setting']:g}" if row["setting"] else "none", number(row["cost"])
        found.append([engine, purpose, contact, steps, price])
    return lines(["engine", "for", "its contact", "steps for 1 % of e", "µs a rebound"], found)


def measure(known: dict[str, Any] | None) -> Iterator[dict[str, Any]]:
    found = known or {"rows": []}
    for name in ("jax", "mujoco", "mujoco-mjx", "brax", "jaxsim"):
        # Kept rows need no engine.
        with contextlib.suppress(PackageNotFoundError):
            found.setdefault("versions", {})[name] = version(name)
    for row in rows(found["rows"]):
        found["rows"].append(row)
        yield found


def tables(found: dict[str, Any]) -> dict[str, str]:
    return {"": table(COLUMNS, found["rows"]), ", engines": engines()}


STUDY = Study(__file__, __doc__, measure, tables, "engines")
