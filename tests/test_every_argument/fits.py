"""The general fitter."""

import functools

import numpy as np

import jaxcontact as jc
from jaxcontact._fit import Bootstrap
from jaxcontact._fit.uncertainty.profile import Profile
from tests.test_every_argument.case import COUNT, NOTHING, PROGRESS, SEED, SWITCH, Case, V
from tests.test_every_argument.kinds import (
    ARRAYS,
    CALLABLE,
    FLAG,
    INSIDE,
    NONE,
    POSITIVE,
    REAL,
    REALS,
)


def _line(params, x):
    return params["a"] + params["b"] * x


@functools.cache
def a_fit():
    x = np.linspace(0, 1, 8)
    return jc.fit(_line, 1 + 2 * x + 0.1 * np.cos(40 * x), {"a": 0.5, "b": 1.0}, x=x)


def a_posterior():
    samples = {name: np.ones((2, 4)) for name in ("a", "b")}
    return jc.Posterior(samples, {}, {}, 0, 0, False, "", a_fit())


def _proportional(params, x):
    return params["a"] * x


# With one parameter, which a single point determines.
FIT = {"data": V, "start": {"a": 1.0}, "x": V, "predict": _proportional}


# Of three balls with one point.
MANY = {"data": np.ones((3, 1)), "start": {"a": 1.0}, "predict": _proportional}
OF_THREE = frozenset({"range", "with nan", "Series", "DataFrame"})
NAMES = OF_THREE | {"tuple", "Series of text"}
NAMES |= {f"array of {what}" for what in ("text", "flags", "dates", "long doubles")} | {"jax flags"}
NO_LEAVES = NONE | {"dict", "empty list", "list of None"}
FIT_START = (
    REAL - {"jax whole"}
    | ARRAYS - {"empty list", "range", "shape (0,)", "with nan"}
    | {"dict of numbers", "ragged", "law", "contact", "material"}
)


@functools.cache
def cases() -> dict[str, Case]:
    fitted = a_fit()
    return {
        "fit": Case(
            jc.fit,
            FIT,
            {
                "predict": CALLABLE,
                # Any tree of numbers, which the prediction must match.
                "data": REALS - {"empty list", "shape (0,)", "with nan"}
                | {"dict of numbers", "ragged", "law", "contact", "material"},
                # JAX integer arrays stay unchanged, and nothing remains to be fitted.
                "start": FIT_START,
                # Any tree of arrays that the prediction accepts.
                "x": REALS
                | NONE
                | FLAG
                | {"dict", "dict of numbers", "ragged", "list of None"}
                | {"complex", "numpy complex", "array of complex", "jax complex", "jax flags"}
                | {"nan", "inf", "-inf", "array of flags", "jax key", "law", "contact", "material"},
                "sigma": POSITIVE | NONE,
                "weights": POSITIVE | NONE,
                "groups": NONE,
                "correlation": NONE,
                "transforms": NONE | {"dict"},
                "loss": NOTHING,
                "noise": NOTHING,
                "optimizer": NOTHING,
                "starts": COUNT,
                "spread": POSITIVE,
                "seed": SEED,
                "max_steps": COUNT | NONE,
                "patience": COUNT,
                "rtol": POSITIVE,
                "reverse": SWITCH,
                "throw": SWITCH,
                "progress": PROGRESS | NONE,
            },
        ),
        "fit_many": Case(
            jc.fit_many,
            MANY,
            {
                "predict": CALLABLE,
                "data": frozenset({"shape (2, 3)", "DataFrame"}),
                "start": FIT_START,
                "balls": (NAMES - {"with nan"}) | NONE,
                "x": OF_THREE | NO_LEAVES | {"array of flags", "array of complex", "jax flags"},
                "sigma": POSITIVE | NONE | {"shape (1,)", "jax shape (1,)", "DataFrame"},
                "weights": POSITIVE | NONE | {"shape (1,)", "jax shape (1,)", "DataFrame"},
                "transforms": NONE | {"dict"},
                "own_start": FLAG,
                "loss": NOTHING,
                "max_steps": COUNT | NONE,
                "rtol": POSITIVE,
                "reverse": SWITCH,
                "batch_size": COUNT | NONE,
                "progress": PROGRESS | NONE,
            },
        ),
        "Huber": Case(jc.Huber, {}, {"threshold": POSITIVE}),
        "Between": Case(jc.Between, {"low": -5.0, "high": 10.0}, {"low": REAL, "high": REAL}),
        "Fit.predict": Case(fitted.predict, {}, {"x": REALS | NONE}),
        "Fit.predict_with_error": Case(fitted.predict_with_error, {}, {"x": REALS | NONE}),
        "Fit.linearised": Case(fitted.linearised, {}, {"x": REALS | NONE}),
        "Fit.bootstrap": Case(fitted.bootstrap, {}, {"draws": COUNT, "seed": SEED}),
        "Fit.profile": Case(
            fitted.profile,
            {"name": "a"},
            {
                "name": NOTHING,
                "values": REALS - {"with nan", "empty list", "shape (0,)"} | NONE,
                "points": COUNT,
                "span": POSITIVE,
            },
        ),
        "Fit.interval": Case(fitted.interval, {}, {"level": INSIDE}),
        "Fit.confidence_band": Case(
            fitted.confidence_band, {}, {"x": REALS | NONE, "level": INSIDE}
        ),
        "Fit.prediction_band": Case(
            fitted.prediction_band,
            {"x": V},
            {"x": REALS | NONE, "level": INSIDE, "sigma": POSITIVE | NONE},
        ),
        "Bootstrap.interval": Case(
            Bootstrap(("a",), np.ones((3, 1)), np.ones(3, bool)).interval, {}, {"level": INSIDE}
        ),
        "Profile.interval": Case(
            Profile("a", 1.0, V, V, V - 1.75, 4, False).interval, {}, {"level": INSIDE}
        ),
        "Profile.quantile": Case(
            Profile("a", 1.0, V, V, V - 1.75, 4, False).quantile, {}, {"level": INSIDE}
        ),
        "posterior": Case(
            jc.posterior,
            {"fit": fitted},
            {
                "fit": NOTHING,
                "draws": COUNT,
                "chains": COUNT,
                "warmup": COUNT,
                "prior": NONE | {"dict", "function"},
                "seed": SEED,
            },
        ),
        "Posterior.interval": Case(
            a_posterior().interval, {"name": "a"}, {"name": NOTHING, "level": INSIDE}
        ),
        "compare_fits": Case(
            jc.compare_fits,
            {"fits": {"one": fitted, "two": fitted}},
            {"fits": NOTHING, "folds": COUNT, "groups": NONE, "seed": SEED},
        ),
    }
