"""One ball thrown at a plane in the real engines: they deliver the wanted restitution.

This is a separate group: `pip install '.[engines]'`, then `pytest -m engines`. Other runs omit it.
Here a missing engine fails the test, with the reason.
"""

import pytest

import jaxcontact as jc
from jaxcontact.engines import export
from tests.engines.test_export.run import case, needed, rebounds
from tests.engines.test_export.test_page import measured

pytestmark = pytest.mark.engines

# The error promised for every engine, relative; each export states its own, smaller one.
PROMISE = 0.01
CONTINUOUS = 5e-5  # Drake's continuous plant at an accuracy of 1e-6: measured 2.2e-5
PAGE = 1e-4  # rounding of the page's four digits, with a margin for the next release of an engine

# The ball of Hu and Guo, and a steel sphere of 1 cm.
SMALL = jc.Contact.sphere_plane(0.005, jc.Material(207e9, 0.3, 7800.0))
BALLS = [(jc.Contact(1.0, 1.4e8), 4.2, 0.1), (SMALL, 0.3, 0.005)]
WANTED = (0.95, 0.7, 0.5, 0.3, 0.12)
PHASES = (0.1, 0.5, 0.9)
VARIANTS = [
    ("bullet", {}), ("drake", {}), ("exudyn", {}), ("exudyn", {"impact_model": 1}),
    ("exudyn", {"impact_model": 0}), ("lammps", {"damping": "coeff_restitution"}),
    ("lammps", {"damping": "limit_damping"}), ("lammps", {"damping": "tsuji"}),
    ("lammps", {"damping": "viscoelastic"}), ("mujoco", {}),
]  # fmt: skip
LABEL = ["-".join([engine, *map(str, options.values())]) for engine, options in VARIANTS]


def exports(engine, options, wanted=WANTED):
    """The exports for both balls, with what a case needs beside them."""
    found = []
    for contact, velocity, radius in BALLS:
        more = {"radius": radius} if engine == "lammps" else {}
        for e in wanted:
            law = jc.ExactRestitution(e=e)
            each = export(law, contact, velocity, engine=engine, **options, **more)
            found.append((each, float(contact.mass), velocity, radius))
    return found


@pytest.mark.parametrize(("engine", "options"), VARIANTS, ids=LABEL)
def test_the_engine_delivers_the_target(engine, options, tmp_path):
    needed(engine)
    # impactModel 1 delivers nothing below 0.4877, limit_damping nothing below 0.1353.
    wanted = WANTED[:3] if options.get("impact_model") == 1 else WANTED
    wanted = WANTED[:4] if options.get("damping") == "limit_damping" else wanted
    found = exports(engine, options, wanted)
    cases = [case(*each, phase=phase) for each in found for phase in PHASES]
    delivered = rebounds(engine, cases, tmp_path)
    targets = [each[0] for each in found for _ in PHASES]
    worst = max(abs(e / x.target - 1) for e, x in zip(delivered, targets, strict=True))
    assert worst < targets[0].expected_error < PROMISE
    # The page states the result for 0.5.
    at_half = delivered[len(PHASES) * wanted.index(0.5) + 1]
    assert at_half == pytest.approx(measured()[engine, *options.values()], abs=PAGE)


# Each of Newton's steps is a dozen launches from Python: one case here, the worst ones beside it.
def test_newton_delivers_the_target(tmp_path):
    needed("newton")
    some = exports("newton", {}, (0.5,))[:1] + exports("newton", {}, (0.12,))
    phases = (0.5, *PHASES[-1:] * 2)
    cases = [case(*each, phase=phase) for each, phase in zip(some, phases, strict=True)]
    delivered = rebounds("newton", cases, tmp_path)
    for e, (each, *_) in zip(delivered, some, strict=True):
        assert abs(e / each.target - 1) < each.expected_error < PROMISE
    assert delivered[0] == pytest.approx(measured()["newton",], abs=PAGE)


def test_drakes_continuous_plant(tmp_path):
    needed("drake")
    found = exports("drake", {})
    delivered = rebounds("drake", [case(*each, discrete=False) for each in found], tmp_path)
    for e, each in zip(delivered, found, strict=True):
        assert e == pytest.approx(each[0].target, rel=CONTINUOUS)


@pytest.mark.parametrize("engine", ["bullet", "lammps", "mujoco"])
def test_without_the_export_it_would_be_another_restitution(engine, tmp_path):
    """The asked e is not what tsuji delivers, nor a default contact: the tests above can fail."""
    needed(engine)
    contact, velocity, radius = BALLS[0]
    options = {"radius": radius, "damping": "tsuji"} if engine == "lammps" else {}
    found = export(jc.ExactRestitution(e=0.5), contact, velocity, engine=engine, **options)
    plain = case(found, 1.0, velocity, radius)
    if engine == "lammps":
        asked = f" {found.parameters['e']:.12g} tangential"
        assert asked in plain["snippet"]
        plain["snippet"] = plain["snippet"].replace(asked, " 0.5 tangential")
    else:
        plain["snippet"] = ""
    (e,) = rebounds(engine, [plain], tmp_path)
    assert abs(e / 0.5 - 1) > 10 * PROMISE


def test_lammps_has_our_dmt(tmp_path):
    """The rebound at three touch positions, and the speed in the middle of compression."""
    needed("lammps")
    contact, radius, velocity = jc.Contact(mass=1e-11, stiffness=4e6), 1e-5, 0.045
    law = jc.DMT.of_surfaces(0.1, radius)
    found = export(law, contact, velocity, engine="lammps", radius=radius)
    each = found, 1e-11, velocity, radius
    # `drops.py` runs for twice the duration: here 0.3 of that of the contact.
    inside = case(*each, steps=600) | {"duration": 0.15 * found.duration}
    *delivered, speed = rebounds(
        "lammps", [*(case(*each, phase=phase) for phase in PHASES), inside], tmp_path
    )
    assert max(abs(e - 1) for e in delivered) < found.expected_error
    # Adhesion accelerates the ball to 1.35 times its speed; without it, it would be slower.
    wanted = jc.trajectory(law, contact, velocity, samples=11).velocity[3] / velocity
    assert wanted > 1.3
    assert -speed == pytest.approx(float(wanted), rel=PROMISE / 10)


@pytest.mark.parametrize(
    "law",
    [
        jc.Luding(ratio=1.5, slope=0.0, adhesion=0.5),
        jc.Luding(ratio=3.0, slope=0.0, adhesion=0.8),
        jc.WaltonBraun(ratio=20.0, slope=0.0),
    ],
    ids=repr,
)
def test_exudyn_has_our_luding(law, tmp_path):
    needed("exudyn")
    found = export(law, jc.Contact(0.033, 1e7, 1.0), 1.0, engine="exudyn")
    cases = [case(found, 0.033, 1.0, 0.01, phase=phase) for phase in PHASES]
    for e in rebounds("exudyn", cases, tmp_path):
        assert abs(e / found.target - 1) < found.expected_error
