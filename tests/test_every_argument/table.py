"""Every public callable with its cases, and the exempt ones."""

import functools

from tests.test_every_argument import fits, friction, measured, physics, results, scenes, systems


@functools.cache
def cases():
    rooms = (physics, fits, measured, results, scenes, systems, friction)
    every = [case for room in rooms for case in room.cases()]
    assert len({case.label for case in every}) == len(every)
    return {case.label: case for case in every}


EXEMPT = {
    # Results, which the library makes
    r"(Bounce|Calibration|CalibrationSummary|Design|EngineRun|Export|FastLoops|Fits?|FrictionCalibration|FrictionChoice|"
    r"Impact|Impacts|LawChoice|Margin|"
    r"ObliqueImpact|ObliqueTrajectory|"
    r"Posterior|Recording|Run|ScaledImpact|SceneExport|States|Sweep|SystemContacts|SystemMargin|SystemPhases|"
    r"SystemRun|SystemStates|Trajectory|VelocityProfile)\(.*\)": ("a result, made by the library"),
    r"Luding\.force\(contact\)": "needs an exponent that the contacts of the table lack",
    r"FrictionChoice\.friction\(name\)": "see tests/lab/test_calibration/test_oblique.py",
    r"Fits\.fit\(ball\)": "see tests/test_fit/test_many.py",
    r"Fit\.why_no_error\(name\)": "see tests/test_fit/test_general.py",
    r"export_scene\(time_step\)|SceneExport\..*|EngineRun\..*|read_run\(.*\)": (
        "see test_scenes.py and test_read_run.py of tests/engines/test_export"
    ),
    r"RecordingError\(.*\)": "an error, raised by the library",
    r"paper\.(Number|Published|Reproduction)\(.*\)": "a result, made by the library",
    r"(Status|FitStatus|Ending|Slip|SolvedBy)(\.names_of)?\(.*\)": "an enumeration of Python",
    # Called by the library, with arguments that are checked before
    r"Abstract(Law|HuntCrossley|ElasticPlastic|Form|Friction|Method|Shape)(\..*)?\(.*\)": (
        "an interface to fill in"
    ),
    r"Tangential(Outcome)?(\..*)?\(.*\)": "what the library and a friction law exchange",
    r"Sweep\.(coordinates|taken)\(.*\)": "called by the library",
    r"Sphere\.moved_to\(.*\)|Shell\.centre_at\(.*\)": "called by the library",
    r"(Sphere|Plane|Box|Shell)\.after\(.*\)": "called by the library",
    r"(choose_[a-z]+|learn_law|fit_[a-z_]+)\((weights|groups|correlation|transforms|sigma|loss|noise|"
    r"optimizer|starts|spread|seed|max_steps|patience|rtol|reverse|progress|throw)\)": "see `fit`",
    r"cache\(folder\)": "a setting of the process, in tests/lab/test_cli/test_cache.py",
    r"(Prescribed|simulate)\(args\)": "whatever the functions take",
    r"LowPass\.(read|correlation)\(.*\)": "called by the library",
    r"RegularizedCoulomb\.force\(.*\)": "called by the library",
    r".*\.(rebound|along|has_formula|uncovered)\(.*\)": "called by the library",
    r"RoundBodies\.(arms|mobility|require_mass)\(.*\)": "called by the library",
    r"systems\.from_mjx\(.*\)": "needs MJX, which the tests of engines have",
    r"(mjx|jaxsim)\.(contact_force|(Contact|Terrain)Force(\.(init|step))?)\(.*\)": "the same",
    r"(Steady|Vibration|Prescribed)\.(start|along|after)\(.*\)": "called by the library",
    r".*\.(form|chosen|solve|error|over|tolerances|damping_ratio)\(.*\)": "called by the library",
    r".*\.jumps\(.*\)": "called by the library",
    r"(Exact|Event|Phase)\.restitution\(.*\)": "called by the library",
    r".*\.damping_factor\(.*\)": "not used where α does not depend on it",
}
"""Patterns of callables and arguments that are not in the table, and why."""
