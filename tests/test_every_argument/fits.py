"""The general fitter."""

import functools

import numpy as np

import jaxcontact as jc
from jaxcontact._fit import Bootstrap
from jaxcontact._fit.uncertainty.interval import Profile
from tests.test_every_argument.case import V, case, method


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


TREES = "dict of numbers or ragged or law or contact or material"
# JAX integer arrays stay unchanged, and nothing remains to be fitted.
START = f"REAL or ARRAYS or {TREES} but jax whole or empty list or range or shape (0,) or with nan"
# Any tree of arrays that the prediction accepts.
X = f"REALS or None or FLAG or {TREES} or dict or list of None or complex or numpy complex"
X += " or array of complex or jax complex or jax flags or nan or inf or -inf or array of flags"
# Of three balls with one point.
MANY = {"data": np.ones((3, 1)), "start": {"a": 1.0}, "predict": _proportional}
OF_THREE = "range or with nan or Series or DataFrame"
BALLS = "None or range or Series or DataFrame or tuple or Series of text or jax flags or "
BALLS += " or ".join(f"array of {what}" for what in ("text", "flags", "dates", "long doubles"))


@functools.cache
def cases():
    fitted = a_fit()
    profile = Profile("a", 1.0, V, V, V - 1.75, 4, False)
    return [
        # With one parameter, which a single point determines.
        case(
            "fit",
            f"REALS or {TREES} but empty list or shape (0,) or with nan: data; {START}: start; "
            f"{X} or jax key: x; None or dict: transforms; WHOLE: starts patience; "
            "POSITIVE: spread rtol",
            **{"data": V, "start": {"a": 1.0}, "x": V, "predict": _proportional},
        ),
        case(
            "fit_many",
            f"shape (2, 3) or DataFrame: data; {START}: start; {BALLS}: balls; "
            f"{OF_THREE} or None or dict or empty list or list of None or array of flags or array "
            "of complex or jax flags: x; POSITIVE or None or ONE or DataFrame: sigma weights; "
            "None or dict: transforms; FLAG: own_start reverse; NOTHING: loss; POSITIVE: rtol; "
            "WHOLE or None: max_steps; PROGRESS or None: progress",
            **MANY,
        ),
        case("Huber", "POSITIVE: threshold"),
        case("Between", "REAL: low high", low=-5.0, high=10.0),
        *(
            method(fitted, name, "REALS or None: x")
            for name in ("predict", "predict_with_error", "linearised")
        ),
        method(fitted, "bootstrap"),
        method(
            fitted,
            "profile",
            "REALS or None but with nan or empty list or shape (0,): values; NOTHING: name; "
            "WHOLE: points; POSITIVE: span",
            name="a",
        ),
        method(fitted, "interval"),
        method(fitted, "confidence_band", "REALS or None: x"),
        method(fitted, "prediction_band", "REALS or None: x", x=V),
        method(Bootstrap(("a",), np.ones((3, 1)), np.ones(3, bool)), "interval"),
        method(profile, "interval"),
        method(profile, "quantile"),
        case("posterior", "WHOLE: chains warmup; None or dict or function: prior", fit=fitted),
        method(a_posterior(), "interval", "NOTHING: name", name="a"),
        case("compare_fits", "WHOLE: folds", fits={"one": fitted, "two": fitted}),
    ]
