"""jaxcontact: contact laws and impacts, differentiable in JAX."""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

# First of all: XLA reads its flags when its backend starts.
from . import _fast_loops as _fast_loops

if _TYPE_CHECKING:
    # For readers and type checkers. Each name is loaded on first use together with its room, so a
    # program that solves one impact does not import scenes and fits. A star stands for a room that
    # imports public names only, as a test holds.
    from ._bounce import *  # noqa: F403 (all of them public)
    from ._cache import cache as cache
    from ._contact import Contact as Contact
    from ._contact import Material as Material
    from ._fast_loops import FastLoops as FastLoops
    from ._fast_loops import fast_loops as fast_loops
    from ._fit import Between as Between
    from ._fit import Fit as Fit
    from ._fit import Fits as Fits
    from ._fit import FitStatus as FitStatus
    from ._fit import Fixed as Fixed
    from ._fit import Free as Free
    from ._fit import Huber as Huber
    from ._fit import Positive as Positive
    from ._fit import Posterior as Posterior
    from ._fit import compare_fits as compare_fits
    from ._fit import fit as fit
    from ._fit import fit_many as fit_many
    from ._fit import posterior as posterior
    from ._flight import Drag as Drag
    from ._forms import AbstractForm as AbstractForm
    from ._forms import ScaledImpact as ScaledImpact
    from ._forms import exact_damping_factor as exact_damping_factor
    from ._friction import AbstractFriction as AbstractFriction
    from ._friction import MawBarberFawcett as MawBarberFawcett
    from ._friction import RegularizedCoulomb as RegularizedCoulomb
    from ._friction import RigidCoulomb as RigidCoulomb
    from ._friction import SpringSlider as SpringSlider
    from ._friction import Tangential as Tangential
    from ._friction import TangentialOutcome as TangentialOutcome
    from ._friction import WaltonFriction as WaltonFriction
    from ._friction import tangential_rebound as tangential_rebound
    from ._functions import power as power
    from ._impact import AbstractMethod as AbstractMethod
    from ._impact import Event as Event
    from ._impact import Exact as Exact
    from ._impact import Impact as Impact
    from ._impact import ObliqueImpact as ObliqueImpact
    from ._impact import ObliqueTrajectory as ObliqueTrajectory
    from ._impact import Phase as Phase
    from ._impact import RoundBodies as RoundBodies
    from ._impact import Slip as Slip
    from ._impact import Status as Status
    from ._impact import Trajectory as Trajectory
    from ._impact import impact as impact
    from ._impact import oblique_impact as oblique_impact
    from ._impact import oblique_trajectory as oblique_trajectory
    from ._impact import restitution as restitution
    from ._impact import trajectory as trajectory
    from ._inverse import *  # noqa: F403 (all of them public)
    from ._laws import DMT as DMT
    from ._laws import JKR as JKR
    from ._laws import VELOCITY_THRESHOLD as VELOCITY_THRESHOLD
    from ._laws import AbstractElasticPlastic as AbstractElasticPlastic
    from ._laws import AbstractHuntCrossley as AbstractHuntCrossley
    from ._laws import AbstractLaw as AbstractLaw
    from ._laws import AntypovElliott as AntypovElliott
    from ._laws import Bridges as Bridges
    from ._laws import CarvalhoMartins as CarvalhoMartins
    from ._laws import ConstantDamping as ConstantDamping
    from ._laws import Damped as Damped
    from ._laws import EnergyLoss as EnergyLoss
    from ._laws import ExactRestitution as ExactRestitution
    from ._laws import Flores as Flores
    from ._laws import Gonthier as Gonthier
    from ._laws import HerbertMcWhannell as HerbertMcWhannell
    from ._laws import Hertz as Hertz
    from ._laws import HuGuo as HuGuo
    from ._laws import HuntCrossley as HuntCrossley
    from ._laws import Jankowski as Jankowski
    from ._laws import KelvinVoigt as KelvinVoigt
    from ._laws import KuwabaraKono as KuwabaraKono
    from ._laws import LankaraniNikravesh as LankaraniNikravesh
    from ._laws import LeeWang as LeeWang
    from ._laws import LinearDashpot as LinearDashpot
    from ._laws import Luding as Luding
    from ._laws import MarhefkaOrin as MarhefkaOrin
    from ._laws import PowerDamping as PowerDamping
    from ._laws import PowerRestitution as PowerRestitution
    from ._laws import StepDamping as StepDamping
    from ._laws import Thornton as Thornton
    from ._laws import ThorntonPlastic as ThorntonPlastic
    from ._laws import Tsuji as Tsuji
    from ._laws import Viscoplastic as Viscoplastic
    from ._laws import WaltonBraun as WaltonBraun
    from ._laws import WetRestitution as WetRestitution
    from ._laws import ZhiyingQishao as ZhiyingQishao
    from ._laws import get_law as get_law
    from ._laws import list_laws as list_laws
    from ._laws import register_law as register_law
    from ._scene import *  # noqa: F403 (all of them public)
    from ._simulate import simulate as simulate
    from ._sweep import *  # noqa: F403 (all of them public)
    from ._system import System as System
    from ._system import SystemContacts as SystemContacts
    from ._system import SystemMargin as SystemMargin
    from ._system import SystemPhases as SystemPhases
    from ._system import SystemRun as SystemRun
    from ._system import SystemStates as SystemStates
    from ._text.failure import NumericalError as NumericalError
    from .engines import Export as Export
    from .engines import export as export
    from .engines.scenes import SceneExport as SceneExport
    from .engines.scenes import export_scene as export_scene
    from .engines.scenes import read_run as read_run
    from .lab.bounces import fit_bounces as fit_bounces
    from .lab.calibration.calibrate import Calibration as Calibration
    from .lab.calibration.calibrate import calibrate as calibrate
    from .lab.calibration.calibrate_friction import FrictionCalibration as FrictionCalibration
    from .lab.calibration.calibrate_friction import calibrate_friction as calibrate_friction
    from .lab.calibration.summary import CalibrationSummary as CalibrationSummary
    from .lab.calibration.summary import load_calibration as load_calibration
    from .lab.choice.choose_law import choose_law as choose_law
    from .lab.choice.law_choice import LawChoice as LawChoice
    from .lab.design import Design as Design
    from .lab.design import design as design
    from .lab.oblique.choose_friction import FrictionChoice as FrictionChoice
    from .lab.oblique.choose_friction import choose_friction as choose_friction
    from .lab.oblique.fit_oblique import fit_oblique as fit_oblique
    from .lab.recordings import Recording as Recording
    from .lab.recordings import RecordingError as RecordingError
    from .lab.recordings import read_recording as read_recording
    from .lab.records.fit_record import fit_record as fit_record
    from .lab.records.low_pass import LowPass as LowPass
    from .lab.report_page import report as report
    from .paper._velocity_profile import VelocityProfile as VelocityProfile
    from .paper._velocity_profile import fit_velocity_profile as fit_velocity_profile

__version__ = "0.1.0"

_ROOMS = {
    "_bounce": "Bounce bounce",
    "_cache": "cache",
    "_contact": "Contact Material",
    "_friction": (
        "AbstractFriction MawBarberFawcett RegularizedCoulomb RigidCoulomb SpringSlider Tangential "
        "TangentialOutcome WaltonFriction tangential_rebound"
    ),
    "_functions": "power",
    "_fit": (
        "Between Fit Fits FitStatus Fixed Free Huber Positive Posterior compare_fits fit fit_many "
        "posterior"
    ),
    "_fast_loops": "FastLoops fast_loops",
    "_flight": "Drag",
    "_forms": "AbstractForm ScaledImpact exact_damping_factor",
    "_impact": (
        "AbstractMethod Event Exact Impact ObliqueImpact ObliqueTrajectory Phase RoundBodies Slip "
        "Status Trajectory impact oblique_impact oblique_trajectory restitution trajectory"
    ),
    "_inverse": (
        "AbstractShape Network Rational Spline fit_damping fit_energy_loss fit_impacts learn_law"
    ),
    "_laws": (
        "VELOCITY_THRESHOLD AbstractElasticPlastic AbstractHuntCrossley AbstractLaw "
        "AntypovElliott Bridges CarvalhoMartins ConstantDamping DMT Damped EnergyLoss "
        "ExactRestitution Flores Gonthier HerbertMcWhannell Hertz HuGuo HuntCrossley JKR "
        "Jankowski KelvinVoigt KuwabaraKono LankaraniNikravesh LeeWang LinearDashpot "
        "Luding MarhefkaOrin PowerDamping PowerRestitution StepDamping Thornton "
        "ThorntonPlastic Tsuji Viscoplastic WaltonBraun WetRestitution ZhiyingQishao get_law "
        "list_laws register_law"
    ),
    "_scene": (
        "Box Ending EngineRun Impacts Margin Plane Prescribed Run Scene Shell SolvedBy Sphere "
        "States Steady Vibration random_spheres read_scene"
    ),
    "_simulate": "simulate",
    "_sweep": "Sweep sweep",
    "_system": ("System SystemContacts SystemMargin SystemPhases SystemRun SystemStates"),
    "_text.failure": "NumericalError",
    # Parts that the core does not import, but for these names.
    "engines": "Export export",
    "engines.scenes": "SceneExport export_scene read_run",
    "lab.bounces": "fit_bounces",
    "lab.calibration.calibrate": "Calibration calibrate",
    "lab.calibration.calibrate_friction": "FrictionCalibration calibrate_friction",
    "lab.calibration.summary": "CalibrationSummary load_calibration",
    "lab.choice.choose_law": "choose_law",
    "lab.choice.law_choice": "LawChoice",
    "lab.oblique.choose_friction": "FrictionChoice choose_friction",
    "lab.oblique.fit_oblique": "fit_oblique",
    "lab.recordings": "Recording RecordingError read_recording",
    "lab.records.fit_record": "fit_record",
    "lab.records.low_pass": "LowPass",
    "lab.report_page": "report",
    "lab.design": "Design design",
    "paper._velocity_profile": "VelocityProfile fit_velocity_profile",
}
"""Public names by room."""
_HOME = {name: room for room, names in _ROOMS.items() for name in names.split()}
_MODULES = ("jaxsim", "mjx", "paper", "plot", "systems")

# Derived, so that each name is listed once.
__all__ = [*sorted(_HOME), *_MODULES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> _Any:
    if name in _MODULES:
        return _import_module(f".{name}", __name__)
    if name not in _HOME:
        raise AttributeError(f"module 'jaxcontact' has no attribute {name!r}")
    value = getattr(_import_module(f".{_HOME[name]}", __name__), name)
    # Later accesses find the name in the module.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
