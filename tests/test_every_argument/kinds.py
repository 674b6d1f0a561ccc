"""Sixty kinds of values that people pass by mistake, or correctly elsewhere."""

import datetime
import decimal
import fractions
import functools
import math

import jax
import jax.numpy as jnp
import ml_dtypes
import numpy as np

import jaxcontact as jc


class Silent:
    """An object that cannot be shown."""

    def __repr__(self):
        raise RuntimeError("no repr")


def some_function(*given):
    return given


LAW = jc.HuGuo(e=0.5)
CONTACT = jc.Contact(1.0, 1e6)
STEEL = jc.Material(2.1e11, 0.3, 7800.0)

KINDS = (
    # Nothing, flags and text
    {"None": None, "True": True, "numpy True": np.True_, "empty text": "", "text": "abc"}
    | {"digit": "1", "numpy text": np.str_("abc"), "bytes": b"1", "bytearray": bytearray(b"1")}
    # Containers
    | {"empty list": [], "tuple": (1, 2, 3), "range": range(3), "list of text": ["1"]}
    | {"list of None": [None], "ragged": [[1.0], [1.0, 2.0]], "dict": {}, "set": {1}}
    | {"dict of numbers": {"e": 0.5}, "generator": (one for one in (1, 2))}
    # Things
    | {"object": object(), "silent": Silent(), "class": int, "function": some_function}
    | {"module": math, "law": LAW, "contact": CONTACT, "material": STEEL, "law class": jc.HuGuo}
    # Numbers
    | {"half": 0.5, "one and a half": 1.5, "whole": 4, "numpy whole": np.int64(4)}
    | {"numpy half": np.float32(0.5), "jax half": jnp.asarray(0.5), "jax whole": jnp.asarray(4)}
    | {"numpy 0-d": np.array(0.5), "float16": np.float16(0.5), "bfloat16": ml_dtypes.bfloat16(0.5)}
    | {"nan": math.nan, "inf": math.inf, "-inf": -math.inf, "negative": -1.5, "minus one": -1}
    | {"zero": 0, "huge": 10**400, "beyond repr": 10**5000, "Decimal": decimal.Decimal("0.5")}
    | {"Fraction": fractions.Fraction(1, 2), "complex": 1j, "numpy complex": np.complex128(1j)}
    | {"long double": np.longdouble(0.5), "datetime": datetime.datetime(2026, 1, 2)}
    | {"datetime64": np.datetime64("2026-01-02"), "nanoseconds": np.datetime64(1, "ns")}
    | {"timedelta64": np.timedelta64(1, "ns")}
    # Arrays
    | {"shape (1,)": np.ones(1), "jax shape (1,)": jnp.ones(1), "shape (0,)": np.zeros(0)}
    | {"shape (2, 3)": np.full((2, 3), 0.5), "with nan": np.array([0.5, math.nan, 0.5])}
    | {"masked": np.ma.masked_invalid([0.5, math.nan, 0.5]), "masked 0-d": np.ma.masked}
    | {"array of text": np.array(["a", "b", "c"]), "structured": np.zeros(3, [("a", float)])}
    | {"array of objects": np.array([0.5, None, 0.5], object)}
    | {"array of flags": np.array([True, False, True]), "array of complex": np.array([1j] * 3)}
    | {"array of long doubles": np.ones(3, np.longdouble), "jax complex": jnp.asarray([1j])}
    | {"array of dates": np.array(["2026-01-02"] * 3, "datetime64[ns]")}
    | {"jax flags": jnp.asarray([True, False, True]), "jax key": jax.random.key(0)}
    | {"shape and type": jax.ShapeDtypeStruct((), float)}
)
try:
    import pandas
except ImportError:
    pass
else:
    KINDS |= {
        "Series": pandas.Series([0.5, 0.25, 0.5]),
        "Series of text": pandas.Series(["a", "b", "c"]),
        "DataFrame": pandas.DataFrame({"e": [0.5, 0.25, 0.5]}),
        "Timestamp": pandas.Timestamp("2026-01-02"),
    }
KNOWN = KINDS.keys() | {"Series", "Series of text", "DataFrame", "Timestamp"}

GROUPS = {
    "NOTHING": "",
    # A whole number above 2
    "WHOLE": "whole or numpy whole or jax whole",
    "SEED": "WHOLE or zero",
    # One number in (0, 1)
    "INSIDE": "half or numpy half or jax half or numpy 0-d or float16 or bfloat16",
    "ABOVE_ONE": "WHOLE or one and a half",
    "POSITIVE": "INSIDE or ABOVE_ONE",
    "REAL": "POSITIVE or negative or minus one or zero",
    "TEXT": "empty text or NAME",
    "NAME": "text or digit or numpy text",
    "FLAG": "True or numpy True",
    "CALLABLE": "class or function or law class",
    "PROGRESS": "FLAG or CALLABLE",
    "ONE": "shape (1,) or jax shape (1,)",
    "THREE": "tuple or range or Series",
    # Arrays of numbers: their bad lanes are flagged, so that any number in them is legal
    "ARRAYS": "THREE or ONE or numpy 0-d or empty list or shape (2, 3) or shape (0,) or with nan"
    " or DataFrame",
    "SCALARS": "jax half or jax whole or numpy 0-d",
    "EXPONENT": "ARRAYS or SCALARS or one and a half",
    # Numbers in (0, 1]
    "E": "INSIDE or ARRAYS or SCALARS",
    "POSITIVES": "POSITIVE or ARRAYS",
    "REALS": "REAL or ARRAYS",
}
"""Values that may be legal."""


@functools.cache
def kinds_of(words):
    """The kinds that a text names, groups in capitals: "REALS or None but empty list"."""
    some, _, others = words.partition(" but ")
    found = [kinds_of(GROUPS[one]) if one in GROUPS else {one} for one in some.split(" or ") if one]
    kinds = frozenset().union(*found) - (kinds_of(others) if others else frozenset())
    assert kinds <= KNOWN, words
    return kinds
