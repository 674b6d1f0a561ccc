"""The page of all plots and its pictures: `python docs/plots.py`, with names for some only.

Each picture is made by the code that the page shows.
"""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).parent
FOLDER = HERE / "plots"
_DPI = 75


class Section(NamedTuple):
    """A picture: its file, title and words, and the code that makes it, which ends with `ax`."""

    name: str
    title: str
    words: str
    code: str
    ending: str = ".png"

    @property
    def file(self) -> Path:
        """Return the path of the picture."""
        return FOLDER / f"{self.name}{self.ending}"


BEFORE = """\
import io

import jax
import numpy as np
import scipy.io.wavfile

import jaxcontact as jc

jax.config.update("jax_enable_x64", True)
"""

SECTIONS = (
    Section(
        "law",
        "A law",
        "The force-indentation loop (its area is the energy lost), delivered over requested e, and "
        "the damping factor. A dot marks the law itself.",
        """\
        ax = jc.plot.law(jc.HuGuo(e=0.5))
        jc.plot.law(jc.HuntCrossley(e=0.5), ax=ax)
        """,
    ),
    Section(
        "law_of_speed",
        "A law whose e depends on the speed",
        "Such a law needs a contact and a speed, in SI units.",
        """\
        contact = jc.Contact(mass=0.05, stiffness=1e6)
        ax = jc.plot.law(jc.ConstantDamping(c=2e5), contact, 2.0)
        jc.plot.law(jc.KuwabaraKono(A=1e-4), contact, 2.0, ax=ax)
        """,
    ),
    Section(
        "impact",
        "One impact",
        "The loop, and force and speed over time. Dotted lines are the numbers of the `Impact`.",
        """\
        ball = jc.HuGuo(e=0.7), jc.Contact(mass=1.0, stiffness=1.4e8)
        path, hit = jc.trajectory(*ball, 4.2), jc.impact(*ball, 4.2)
        ax = jc.plot.impact(path, hit)
        """,
    ),
    Section(
        "trajectory",
        "One quantity over another",
        "Each axis is time, indentation, velocity or force.",
        """\
        ax = jc.plot.trajectory(path, x="indentation", y="velocity")
        """,
    ),
    Section(
        "sweep",
        "A sweep over two axes",
        "A map; values that are not finite are white.",
        """\
        ranges = {"e": np.linspace(0.1, 1, 40), "v": np.geomspace(0.01, 10, 50)}
        table = jc.sweep(lambda e, v: jc.impact(jc.HuGuo(e=e), contact, v), **ranges)
        ax = jc.plot.sweep(table, field="max_force")
        """,
    ),
    Section(
        "sweep_lines",
        "The same as lines",
        "A few lines over the named axis.",
        """\
        ax = jc.plot.sweep(table, field="duration", x="e")
        """,
    ),
    Section(
        "sound",
        "A recording of sound",
        "The sounds that were identified as bounces, in a simulated recording.",
        """\
        rate, rng = 44100, np.random.default_rng(0)
        touches = 0.4 + np.cumsum(0.55 * 0.8 ** np.arange(9))  # or your own file
        clock = np.arange(int(rate * (touches[-1] + 0.4))) / rate
        sound = 0.003 * rng.normal(size=clock.size)
        for k, touch in enumerate(touches):
            since = np.clip(clock - touch, 0, None)
            sound += 0.5 * 0.8**k * np.exp(-since / 0.004) * np.sin(5000 * since)
        sound = (32767 * np.clip(sound, -1, 1)).astype(np.int16)
        file = io.BytesIO()
        scipy.io.wavfile.write(file, rate, sound)
        file.seek(0)
        ax = jc.plot.sound(jc.read_recording(file))
        """,
    ),
    Section(
        "track",
        "A track from video",
        "The fitted parabolas and the impacts between them, for a simulated track.",
        """\
        e, touch, speed = 0.75, 0.25, 2.5  # m/s, or your own file
        time, y = np.arange(0, 2, 1 / 120), 0.0
        for _ in range(8):
            fall = time - touch
            y = np.where(fall < 0, y, e * speed * fall - 4.905 * fall**2)
            touch, speed = touch + 2 * e * speed / 9.81, e * speed
        y = np.where(time < 0.25, 2.5 * (0.25 - time) - 4.905 * (0.25 - time) ** 2, y)
        y = y + 0.001 * rng.normal(size=time.size)
        ax = jc.plot.track(jc.read_recording({"t (s)": time, "y (m)": y}))
        """,
    ),
    Section(
        "record",
        "A record of a force plate",
        "The impacts found in a simulated record, and their fits.",
        """\
        time = np.arange(0, 0.5, 2e-5)
        force = 0.3 * rng.normal(size=time.size)  # or your own file
        for start, speed in ((0.05, 2.0), (0.25, 1.5), (0.4, 1.1)):
            hit = jc.trajectory(jc.HuGuo(e=0.7), contact, speed)
            force += np.interp(time - start, hit.time, hit.force, left=0, right=0)
        recording = jc.read_recording(time=time, force=force)
        ax = jc.plot.record(jc.calibrate(recording, mass=0.05, laws="exact"))
        """,
    ),
    Section(
        "calibration",
        "A calibration",
        "The recording that ships with the package: its pairs, those left out, and the chosen law "
        "± 2 standard errors. The title has e with its 95 % interval. Laws that are not ruled out "
        'are thin and have their names at the ends of their lines; `show="all"` adds the others.',
        """\
        cal = jc.calibrate(jc.read_recording())
        ax = jc.plot.calibration(cal)
        """,
    ),
    Section(
        "choice",
        "The choice among laws",
        "The law of the verdict is the thickest line. Here the rejected ones are drawn too, in "
        "grey. The broad grey line is a free smooth curve for comparison.",
        """\
        ax = jc.plot.choice(cal.choice, show="all")
        """,
    ),
    Section(
        "fit",
        "A fit",
        "The result of `fit` or any `fit_*`: data, prediction, the band of the true curve and that "
        "of new readings.",
        """\
        pairs = cal.recorded_pairs.where(~cal.outliers.flagged)
        data = {"velocity": pairs.velocity, "e": pairs.restitution}
        found = jc.fit_damping(contact, **data, power=True)
        ax = jc.plot.fit(found)
        """,
    ),
    Section(
        "fit_columns",
        "A fit of several columns",
        "A simulated record of one impact, with noise on both sensors.",
        """\
        rng, time = np.random.default_rng(0), np.asarray(path.time)
        force = path.force + rng.normal(0, 300, time.size)
        depth = path.indentation + rng.normal(0, 1e-6, time.size)
        record = jc.fit_record(*ball, time, 4.2, force=force, indentation=depth)
        ax = jc.plot.fit(record)
        """,
    ),
    Section(
        "residuals",
        "Residuals",
        "Residuals over x, in order of measurement, and against normal quantiles.",
        """\
        ax = jc.plot.residuals(found)
        """,
    ),
    Section(
        "profile",
        "Profiles of the likelihood",
        "The standard error is unreliable if the curve leaves the dashed parabola.",
        """\
        ax = jc.plot.profile(found)
        """,
    ),
    Section(
        "corner",
        "Parameters in pairs",
        "The normal approximation of a fit (dashed) over the draws of its posterior.",
        """\
        posterior = jc.posterior(found, draws=1000)
        ax = jc.plot.corner(posterior, names=found.names)
        jc.plot.corner(found, ax=ax)
        """,
    ),
    Section(
        "scene",
        "A scene in two dimensions",
        "Paths of the spheres. Faint circles are the start, full ones the end, dots impacts. In "
        "three dimensions select two axes, such as `axes=(0, 2)`.",
        """\
        box = {"low": [0.0, 0.0], "high": [1.0, 0.6]}
        balls = jc.random_spheres(5, **box, radius=0.06, mass=0.1, speed=1.0, seed=2)
        scene = jc.Scene([*balls, jc.Box(**box)], jc.HuGuo(e=0.8), gravity=[0.0, -9.81])
        run = jc.simulate(scene, 0.8, instantaneous=True)
        ax = jc.plot.scene(run)
        """,
    ),
    Section(
        "scene_line",
        "A scene in one dimension",
        "World lines, as wide as the spheres.",
        """\
        line, how = jc.read_scene(example="line")
        ax = jc.plot.scene(jc.simulate(line, **how))
        """,
    ),
    Section(
        "energy",
        "Where the energy goes",
        "The energy, and the initial energy less the losses of the impacts.",
        """\
        ax = jc.plot.energy(run)
        """,
    ),
    Section(
        "gaps",
        "The gaps of a mechanism",
        "A double pendulum beside a wall. A gap is negative in contact. `label` names the lines.",
        """\
        pendulum, start = jc.systems.double_pendulum()
        swing = jc.simulate(pendulum, 2.5, **start)
        names = ["upper mass", "lower mass"]
        ax = jc.plot.gaps(swing, label=names)
        """,
    ),
    Section(
        "forces",
        "Its contact forces",
        "Each contact has points of its own, so that its peak is shown however short it is.",
        """\
        ax = jc.plot.forces(swing, label=names)
        """,
    ),
    Section(
        "phase",
        "Its phase portrait",
        "Speed over position of one coordinate. A contact is a jump of the speed.",
        """\
        ax = jc.plot.phase(swing, coordinate=1, units=("rad", "rad/s"))
        """,
    ),
    Section(
        "animate_mechanism",
        "A film of a mechanism",
        "Contacts flash. Mechanisms of `jc.systems` have a picture of their own; for others `draw` "
        "returns points, those where the gaps close first, and lines. The result is the same.",
        """\
        def draw(q, args):
            x, y = np.cumsum([np.sin(q), -np.cos(q)], axis=1)
            masses, wall = np.stack([x, y], axis=1), np.array([[-0.3, -2], [-0.3, 0.4]])
            return masses, [np.array([[0, 0], *masses]), wall]


        film = jc.plot.animate(swing, seconds=2.5, fps=6, draw=draw)
        """,
        ".gif",
    ),
    Section(
        "animate",
        "A moving picture",
        'Notebooks show it with buttons; `film.save("run.gif")` writes it, as does "run.mp4" with '
        "ffmpeg. Contacts flash, and spheres that spin have a radius.",
        """\
        film = jc.plot.animate(run, seconds=1.2, fps=10)
        """,
        ".gif",
    ),
)

_HEAD = """\
# Plots

<!-- made by `python docs/plots.py` -->

{gallery}

Every function draws on the axes passed as `ax`, or on new ones, and returns them. Functions with
several panels return an array of axes. Data stay in SI units; tick labels have a prefix where
numbers would be long ("time / µs"). The colours are those of Okabe & Ito, which are safe for colour
blindness. Curves also differ by line style, so they stay distinct in grey. If you set matplotlib's
`axes.prop_cycle`, your colours are used.

`jc.plot.save(ax, "picture.pdf")` writes PDF, SVG or PNG. The bytes are reproducible: the file has
no date, and letters are TrueType or outlines.

Each section uses variables of the sections above. All begin with

```python
{before}```
"""


def _gallery() -> str:
    """Return all pictures as a grid of links to their sections."""
    pictures = []
    for section in SECTIONS:
        anchor = section.title.lower().replace(" ", "-")
        link = section.file.relative_to(HERE).as_posix()
        image = f'<img src="{link}" width="180" alt="{section.title}">'
        pictures.append(f'<a href="#{anchor}">{image}</a>')
    return "\n".join(pictures) + "\n"


def page() -> str:
    """Return the page in Markdown."""
    parts = [_HEAD.format(before=BEFORE, gallery=_gallery())]
    for section in SECTIONS:
        code = textwrap.dedent(section.code)
        link = section.file.relative_to(HERE).as_posix()
        parts.append(
            f"## {section.title}\n\n{section.words}\n\n```python\n{code}```\n\n"
            f"![{section.title}]({link})\n"
        )
    return "\n".join(parts)


def draw(only: list[str]) -> None:
    """Draw all pictures, or those named in `only`; all code runs, since later sections use it."""
    from matplotlib import pyplot

    import jaxcontact as jc

    pyplot.switch_backend("Agg")
    FOLDER.mkdir(exist_ok=True)
    known: dict[str, Any] = {}
    exec(BEFORE, known)
    for section in SECTIONS:
        exec(textwrap.dedent(section.code), known)
        if only and section.name not in only:
            continue
        if section.ending == ".gif":
            known["film"].save(section.file, dpi=60)
        else:
            jc.plot.save(known["ax"], section.file, dpi=_DPI)
        print(section.file.name, f"{section.file.stat().st_size / 1000:.0f} kB")
        pyplot.close("all")


if __name__ == "__main__":
    draw(sys.argv[1:])
    (HERE / "plots.md").write_text(page())
