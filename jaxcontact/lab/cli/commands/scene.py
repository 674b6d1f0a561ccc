"""`jaxcontact scene`: many bodies from a file, as a table of impacts, and as figures."""

from __future__ import annotations

import argparse
import pathlib
import sys
import tempfile
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO

from ....extend import FIGURES, Stages
from ..options import InputError, Output, fields, input_errors, output_folder, output_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .... import Run, Scene

RUN, IMPACTS = "run.csv", "impacts.csv"
MOVING = (".gif",)
"""File formats of an animation."""

_WIDTH, _LOW, _HIGH = 6.4, 2.6, 7.2
"""Width, and least and largest height, of a figure in inches."""

_SQUARE, _ENERGY = 4.4, 2.4
"""Heights in inches of a plot of space before it is drawn, and of the energy below it."""

SUMMARY = "many bodies from impact to impact, from a file"

DESCRIPTION = """\
Follow the spheres of a scene from impact to impact, with each other and with fixed or moving walls,
and print the run and its impacts. A soft scene (one without `instantaneous = true`) may take
a minute to compile.
"""

EPILOG = """\
FILE is TOML, in SI units:

  duration = 0.5
  gravity = [0.0, -9.81]            # two numbers: two dimensions
  stiffness = 1e8                   # or by [material.NAME], see --example line --show
  law = { name = "hu_guo", e = 0.7 }

  [[sphere]]
  name = "ball"
  radius = 0.01
  mass = 0.03
  position = [0.0, 0.2]
  velocity = [1.0, 0.0]

  [[plane]]
  name = "table"
  point = [0.0, 0.0]
  normal = [0.0, 1.0]

The keys are the arguments of `jaxcontact.Scene`, `simulate`, `Sphere`, `Plane`, `Box` and
`random_spheres`; `jaxcontact.read_scene` documents the format, and the examples show most of it:

  jaxcontact scene --example table --show > my.toml
  jaxcontact scene my.toml --out results --plot run.png
  jaxcontact scene my.toml --to lammps --out model

exit codes: 0 done; 1 the run stopped before its end (its status says why), or with --to the model
misses the tolerance (it says by how much), and everything is written; 2 bad input, or a scene that
the engine cannot express, nothing written.
"""

OPTIONS = f"""
[FILE] | | the scene, as TOML
--example NAME | | a scene that ships with the package: line, table or box
--show | flag | print the file instead of running it
--out DIR | | write {RUN} and {IMPACTS} into this folder, made if missing
--to ENGINE | | write a model for this engine into --out, instead of running the scene: drake,
    exudyn, lammps or mujoco
--time-step S | positive | with --to: the engine's time step in s
--tolerance E | positive | with --to: error of e that the model may have (default: 0.001)
--plot FILE | | draw the paths, and the energy below them; .png, .pdf or .svg
--animate FILE | | draw an animation; .gif
--axes XZ | | two axes to draw, such as xy or xz (default in three dimensions: xz)
"""


def run(arguments: argparse.Namespace, progress: Stages) -> Output:
    """Run the scene; return its log and the requested files."""
    progress("reading the scene")
    from .... import Ending, read_scene, simulate
    from ....extend import examples

    if (arguments.file is None) == (arguments.example is None):
        raise InputError(f"give either a FILE or --example {', '.join(examples())}")
    out = output_folder(arguments.out or ".")
    plot = output_path("--plot", arguments.plot, FIGURES) if arguments.plot else None
    film = output_path("--animate", arguments.animate, MOVING) if arguments.animate else None
    with input_errors(lambda text: text.replace("Argument `example`", "--example")):
        scene, how = read_scene(arguments.file, example=arguments.example)
    if arguments.show:
        text = examples().get(arguments.example)
        text = pathlib.Path(arguments.file).read_text() if text is None else text
        return Output([text.removesuffix("\n")], text)
    if arguments.to is not None:
        return _export(arguments, scene, how, progress)
    if arguments.time_step or arguments.tolerance:
        raise InputError("--time-step and --tolerance are those of --to, which is missing")
    axes = _axes(arguments.axes, scene.dimensions)
    progress("compiling and running the scene")
    with input_errors(lambda text: f"{arguments.file or arguments.example}: {text}"):
        done = simulate(scene, **how, progress=False if arguments.quiet else None, throw=False)
    files: dict[pathlib.Path, bytes | Callable[[BinaryIO], object]] = {}
    if arguments.out is not None:
        files |= {out / RUN: done.to_csv, out / IMPACTS: done.impacts.to_csv}
    drawable = float(done.reached) > 0
    if (plot or film) and not drawable:
        print("no pictures: the run has no values to draw", file=sys.stderr)
    if plot and drawable:
        progress("drawing")
        files[plot] = _picture(done, axes, plot)
    if film and drawable:
        progress("drawing the moving picture")
        files[film] = _moving(done, axes)
    names = list(map(str, files))
    shown = [done, done.impacts] + ([f"Written    {', '.join(names)}"] if files else [])
    data = {
        "status": Ending(int(done.status)).name,
        "reached": done.reached,
        "bodies": done.impacts.names,
        "impacts": done.impacts.to_dict(),
        "files": names,
    }
    return Output(shown, data, files, 0 if int(done.status) == Ending.COMPLETED else 1)


def _export(
    arguments: argparse.Namespace, scene: Scene, how: dict[str, Any], progress: Stages
) -> Output:
    """Write the model of the scene for an engine, and return what it is."""
    from ....engines.scenes import export_scene

    if arguments.out is None:
        raise InputError("--to needs --out, the folder of the model")
    if arguments.plot or arguments.animate:
        raise InputError("--plot and --animate show a run, and --to makes none")
    progress("matching the contacts of the engine")
    with input_errors(lambda text: f"{arguments.file or arguments.example}: {text}"):
        made = export_scene(
            scene,
            arguments.to,
            how["duration"],
            times=how["times"],
            time_step=arguments.time_step,
            tolerance=arguments.tolerance or 1e-3,
        )
    made.write(arguments.out)
    data = fields(made, "engine command output time_step steps velocity tolerance expected_error")
    data["files"] = [str(pathlib.Path(arguments.out) / name) for name in made.files]
    shown = [made, f"Written    {arguments.out}"]
    return Output(shown, data, code=0 if made.keeps_tolerance else 1)


def _axes(text: str | None, dimensions: int) -> tuple[int, ...] | None:
    """Return the numbers of two axes, None for all; raise InputError for other letters."""
    names = "xyz"[:dimensions]
    if text is None:
        return (0, 2) if dimensions == 3 else None
    if dimensions == 1 or len(text) != 2 or text[0] == text[1] or not set(text) <= set(names):
        allowed = {1: "left out, in one dimension", 2: "xy or yx", 3: "two letters of xyz"}
        raise InputError(f"--axes must be {allowed[dimensions]}, but is {text}")
    return tuple(names.index(letter) for letter in text)


def _picture(done: Run, axes: tuple[int, ...] | None, file: pathlib.Path) -> bytes:
    """Draw the paths, and the energy below them, in separate axes."""
    from ....extend import render
    from ....plot import energy, scene

    def fill(figure: Figure) -> None:
        # The height of the paths is known only after drawing.
        upper, lower = figure.subplots(2, height_ratios=(1, 1))
        scene(done, axes=axes, ax=upper)
        energy(done, ax=lower)
        tall = _height(upper)
        figure.set_size_inches(_WIDTH, tall + _ENERGY)
        upper.get_gridspec().set_height_ratios((tall, _ENERGY))

    return render(fill, (_WIDTH, _SQUARE + _ENERGY), file)


def _moving(done: Run, axes: tuple[int, ...] | None) -> bytes:
    """Return the animation as a GIF."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from ....plot import animate

    figure = Figure(figsize=(_WIDTH, _SQUARE), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    animation = animate(done, axes=axes, ax=ax)
    figure.set_size_inches(_WIDTH, _height(ax))
    # The writer of matplotlib accepts only the name of a file.
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / f"film{MOVING[0]}"
        animation.save(file, writer="pillow", dpi=80)
        return file.read_bytes()


def _height(ax: Axes) -> float:
    """Return the height in inches that a plot of space needs for its limits."""
    if ax.get_aspect() != 1.0:
        return _SQUARE
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    return min(max(_WIDTH * (top - bottom) / (right - left) + 0.5, _LOW), _HIGH)
