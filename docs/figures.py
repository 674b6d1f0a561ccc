"""The figures of the README and of pages: `python docs/figures.py`, with names for some only."""

import io
import sys
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot

import jaxcontact as jc

sys.path.insert(0, str(Path(__file__).parents[1]))
from benchmarks import oblique_rebounds as rebounds
from benchmarks.lab.sound import as_wave, draw

HERE = Path(__file__).parent
# Okabe and Ito's colours, safe for colour blindness.
COLOURS = ("#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00")
LAWS = (
    ("Hunt-Crossley", jc.HuntCrossley),
    ("Lankarani-Nikravesh", jc.LankaraniNikravesh),
    ("Flores et al.", jc.Flores),
    ("Hu-Guo", jc.HuGuo),
    ("Carvalho-Martins", jc.CarvalhoMartins),
)

FRICTION = {
    "rigid": ("rigid Coulomb", {"color": COLOURS[0], "linestyle": "--"}),
    "walton": ("Walton, β0 = 0.44", {"color": COLOURS[4], "linestyle": ":"}),
    "displacement": ("spring, displacement", {"color": "#CC79A7", "linestyle": "-."}),
    "force": ("spring, force", {"color": COLOURS[1], "linestyle": "-."}),
    "rescaled": ("spring, rescaled", {"color": COLOURS[2], "linestyle": "--"}),
    "mbf": ("Maw-Barber-Fawcett", {"color": COLOURS[3], "linewidth": 2}),
}
"""Names and looks of friction laws in pictures."""


def delivered() -> None:
    """Draw delivered over requested restitution of each law, and its hysteresis at e = 0.5."""
    asked = jnp.linspace(0.05, 1, 96)
    contact = jc.Contact(mass=1.0, stiffness=1.4e8)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.6, 3.7), layout="constrained")
    for (name, law), colour in zip(LAWS, COLOURS, strict=True):
        left.plot(asked, jc.restitution(law(e=asked)), color=colour, label=name)
        path = jc.trajectory(law(e=0.5), contact, 4.2, samples=300)
        right.plot(1e3 * path.indentation, 1e-3 * path.force, color=colour)
    left.plot([0, 1], [0, 1], color="black", linestyle="--", linewidth=1, label="exact law")
    left.set(
        xlabel="restitution asked for", ylabel="restitution delivered", xlim=(0, 1), ylim=(0, 1)
    )
    figure.legend(loc="outside upper center", ncol=3, frameon=False, fontsize="small")
    right.set(
        xlabel="indentation / mm",
        ylabel="force / kN",
        title="1 kg, 1.4e8 N/m$^{1.5}$, 4.2 m/s, e = 0.5 asked for",
    )
    right.title.set_fontsize("small")
    right.set_xlim(left=0)
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(HERE / "delivered.png", dpi=130, metadata={"Software": None})
    worst = {n: float(np.max(np.abs(jc.restitution(law(e=asked)) - asked))) for n, law in LAWS}
    print(worst)


def hu_guo() -> None:
    """Draw Fig. 6 of Hu & Guo."""
    jc.paper.fig6().figure.savefig(HERE / "fig6.png", dpi=130, metadata={"Software": None})


def bowl() -> None:
    """Draw three soft balls that fall into a bowl: their paths and their energy."""
    balls = [
        jc.Sphere(radius=0.1, mass=0.5, position=place, name=name)
        for place, name in (([-0.6, 0.3], "left"), ([0.1, 0.2], "middle"), ([0.62, 0.1], "right"))
    ]
    scene = jc.Scene(
        [*balls, jc.Shell(centre=[0.0, 0.0], radius=1.0, name="bowl")],
        law=jc.HuGuo(e=0.8),
        stiffness=1e7,
        gravity=[0.0, -9.81],
    )
    run = jc.simulate(scene, duration=1.2)
    figure, (left, right) = pyplot.subplots(
        1, 2, figsize=(6.6, 3.5), width_ratios=(1, 1), layout="constrained"
    )
    jc.plot.scene(run, ax=left)
    jc.plot.energy(run, ax=right)
    figure.savefig(HERE / "bowl.png", dpi=130, metadata={"Software": None})
    print(run.impacts)


def pendulum() -> None:
    """Draw a double pendulum beside a wall: the paths of its masses, and its gaps."""
    system, start = jc.systems.double_pendulum()
    run = jc.simulate(system, 2.5, **start, times=np.linspace(0, 2.5, 800))
    across = jnp.cumsum(jnp.sin(run.position), axis=1)
    height = -jnp.cumsum(jnp.cos(run.position), axis=1)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.6, 3.5), layout="constrained")
    left.axvline(-0.3, color="black", linewidth=2)
    for k, colour in enumerate((COLOURS[3], COLOURS[0])):
        left.plot(across[:, k], height[:, k], color=colour, label=f"mass {k + 1}")
    left.plot([0, *across[0]], [0, *height[0]], color="grey", marker="o", linewidth=1)
    left.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    left.legend(frameon=False, fontsize="small")
    jc.plot.gaps(run, label=["mass 1", "mass 2"], ax=right)
    _save(figure, "systems_pendulum.png", left, right)


def crank() -> None:
    """Draw the path of a journal in its bearing during a turn of the crank, and the force."""
    clearance = 0.5
    system, start = jc.systems.slider_crank(1e-3 * clearance)
    turn = 2 * np.pi / 523.5987755982989
    times = np.linspace(0, turn, 1500)
    run = jc.simulate(system, turn, **start, times=times)
    journal = 1e3 * jnp.stack(jax.vmap(system.gap.journal)(run.time, run.position), axis=1)
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.6, 3.5), layout="constrained")
    angle = np.linspace(0, 2 * np.pi, 200)
    bearing = clearance * np.cos(angle), clearance * np.sin(angle)
    left.plot(*bearing, color="black", linestyle="--", linewidth=1)
    left.plot(journal[:, 0], journal[:, 1], color=COLOURS[3], linewidth=1)
    left.set(xlabel="x / mm", ylabel="y / mm", aspect="equal")
    jc.plot.forces(run, label="journal and bearing", ax=right)
    _save(figure, "systems_crank.png", left, right)
    print(run)


def friction_impact() -> None:
    """Draw friction and slip of an oblique impact over time, by three friction laws."""
    figure, axes = pyplot.subplots(2, 2, figsize=(6.6, 4.4), layout="constrained", sharex=True)
    for (force, slip), degrees in zip(axes.T, (10, 20), strict=True):
        angle = np.radians(degrees)
        speeds = rebounds.SPEED * np.cos(angle), rebounds.SPEED * np.sin(angle)
        for name in ("rigid", "force", "mbf"):
            words, look = FRICTION[name]
            how = {"friction": rebounds.LAWS[name], "samples": 3185 if name == "rigid" else 200}
            path = jc.oblique_trajectory(jc.Hertz(), rebounds.CONTACT, *speeds, **how)
            force.plot(1e6 * path.time, path.friction, label=words, **look)
            slip.plot(1e6 * path.time, path.slip_velocity, **look)
        most = rebounds.MU * path.force
        force.fill_between(1e6 * path.time, -most, most, color="0.92", zorder=0)
        slip.axhline(0, color="0.6", linewidth=0.8, zorder=0)
        force.set_title(f"{degrees}° from the normal", fontsize="small")
        slip.set_xlabel("time / µs")
    axes[0, 0].set_ylabel("friction / N")
    axes[1, 0].set_ylabel("slip velocity / (m/s)")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncol=3, frameon=False, fontsize="small")
    _save(figure, "friction_impact.png", *axes.flat)


def friction_laws() -> None:
    """Draw ψ2 over ψ1 and v_t'/v_t over the angle by six friction laws, with measured points."""
    seen, angle = rebounds.points(), np.linspace(0.05, 60, 600)
    kappa = float(rebounds.CONTACT.tangential_ratio)

    def psi(degrees: np.ndarray, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        before = kappa * np.tan(np.radians(degrees)) / rebounds.MU
        return before, before * (1 - 3.5 * (1 - ratio))

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(6.6, 3.9), layout="constrained")
    for name, (words, look) in FRICTION.items():
        ratio, _ = rebounds.rebound(rebounds.LAWS[name], angle)
        left.plot(*psi(angle, np.asarray(ratio)), **look)
        right.plot(angle, ratio, label=words, **look)
    left.axhline(0, color="0.6", linewidth=0.8, zorder=0)
    # Of a spin ω: u' = u0 - 7/5 R ω, as a sphere has λ = 7/2.
    normal = rebounds.SPEED * np.cos(np.radians(seen.spin_angle))
    before, _ = psi(seen.spin_angle, seen.spin)
    after = before - kappa / rebounds.MU * 1.4 * rebounds.RADIUS * seen.spin / normal
    dots = {"color": "black", "linestyle": "none", "markersize": 5, "zorder": 3}
    left.plot(*psi(seen.ratio_angle, seen.ratio), marker="o", **dots)
    left.plot(before, after, marker="s", fillstyle="none", label="measured, from the spin", **dots)
    right.plot(seen.ratio_angle, seen.ratio, marker="o", label="measured, from v_t'/v_t", **dots)
    left.set(xlabel="ψ1", ylabel="ψ2", xlim=(0, 8), ylim=(-2, 2))
    right.set(xlabel="angle from the normal / degrees", ylim=(0.5, 1.02))
    right.set_ylabel("v_t'/v_t", labelpad=8)
    figure.legend(loc="outside upper center", ncol=3, frameon=False, fontsize="small")
    _save(figure, "friction_laws.png", left, right)


def _save(figure: Any, name: str, *panels: Any) -> None:
    for axes in panels:
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(HERE / name, dpi=130, metadata={"Software": None})


def sound() -> None:
    """Draw a simulated recording with hum, reverberation and noise, and the bounces found."""
    truth = draw(np.random.default_rng([0, 8]))
    recording = jc.read_recording(io.BytesIO(as_wave(truth)))
    jc.plot.sound(recording).figure.savefig(
        HERE / "sound.png", dpi=110, metadata={"Software": None}
    )
    print(recording, truth.e)


def films() -> None:
    """Film a double pendulum beside a wall, and rough balls that spin in a box."""
    system, start = jc.systems.double_pendulum()
    swing = jc.simulate(system, 2.5, **start)
    box = {"low": [0.0, 0.0], "high": [1.0, 0.8]}
    balls = jc.random_spheres(6, **box, radius=0.08, mass=0.1, speed=2.0, seed=3)
    bodies, rough = [*balls, jc.Box(**box)], jc.RigidCoulomb(mu=0.4)
    scene = jc.Scene(bodies, jc.HuGuo(e=0.85), friction=rough, gravity=[0.0, -9.81])
    for name, run in (
        ("film_mechanism", swing),
        ("film_scene", jc.simulate(scene, 1.5, instantaneous=True)),
    ):
        figure, ax = pyplot.subplots(figsize=(4.2, 4.0), layout="constrained")
        film = jc.plot.animate(run, seconds=3.2, fps=14, ax=ax)
        film.save(HERE / f"{name}.gif", dpi=80)
        print(name, f"{(HERE / f'{name}.gif').stat().st_size / 1000:.0f} kB")
        pyplot.close(figure)


if __name__ == "__main__":
    every = (bowl, crank, delivered, films, friction_impact, friction_laws, hu_guo, pendulum, sound)
    for make in every:
        if make.__name__ in sys.argv[1:] or not sys.argv[1:]:
            make()
