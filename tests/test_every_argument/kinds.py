"""Sixty kinds of values that people pass by mistake, or correctly elsewhere."""

import datetime
import decimal
import fractions
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

KINDS = {
    # Nothing, flags and text
    "None": None,
    "True": True,
    "numpy True": np.True_,
    "empty text": "",
    "text": "abc",
    "digit": "1",
    "numpy text": np.str_("abc"),
    "bytes": b"1",
    "bytearray": bytearray(b"1"),
    # Containers
    "empty list": [],
    "tuple": (1, 2, 3),
    "range": range(3),
    "list of text": ["1"],
    "list of None": [None],
    "ragged": [[1.0], [1.0, 2.0]],
    "dict": {},
    "dict of numbers": {"e": 0.5},
    "set": {1},
    "generator": (one for one in (1, 2)),
    # Things
    "object": object(),
    "silent": Silent(),
    "class": int,
    "function": some_function,
    "module": math,
    "law": LAW,
    "contact": CONTACT,
    "material": STEEL,
    "law class": jc.HuGuo,
    # Numbers
    "half": 0.5,
    "one and a half": 1.5,
    "whole": 4,
    "numpy whole": np.int64(4),
    "numpy half": np.float32(0.5),
    "jax half": jnp.asarray(0.5),
    "jax whole": jnp.asarray(4),
    "numpy 0-d": np.array(0.5),
    "float16": np.float16(0.5),
    "bfloat16": ml_dtypes.bfloat16(0.5),
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "negative": -1.5,
    "minus one": -1,
    "zero": 0,
    "huge": 10**400,
    "beyond repr": 10**5000,
    "Decimal": decimal.Decimal("0.5"),
    "Fraction": fractions.Fraction(1, 2),
    "complex": 1j,
    "numpy complex": np.complex128(1j),
    "long double": np.longdouble(0.5),
    "datetime": datetime.datetime(2026, 1, 2),
    "datetime64": np.datetime64("2026-01-02"),
    "nanoseconds": np.datetime64(1, "ns"),
    "timedelta64": np.timedelta64(1, "ns"),
    # Arrays
    "shape (1,)": np.ones(1),
    "jax shape (1,)": jnp.ones(1),
    "shape (2, 3)": np.full((2, 3), 0.5),
    "shape (0,)": np.zeros(0),
    "with nan": np.array([0.5, math.nan, 0.5]),
    "masked": np.ma.masked_invalid([0.5, math.nan, 0.5]),
    "masked 0-d": np.ma.masked,
    "array of text": np.array(["a", "b", "c"]),
    "array of objects": np.array([0.5, None, 0.5], object),
    "array of flags": np.array([True, False, True]),
    "structured": np.zeros(3, [("a", float)]),
    "array of complex": np.array([1j, 1j, 1j]),
    "array of long doubles": np.ones(3, np.longdouble),
    "array of dates": np.array(["2026-01-02"] * 3, "datetime64[ns]"),
    "jax complex": jnp.asarray([1j]),
    "jax flags": jnp.asarray([True, False, True]),
    "jax key": jax.random.key(0),
    "shape and type": jax.ShapeDtypeStruct((), float),
}
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

# Values that may be legal, in groups.
WHOLE = frozenset({"whole", "numpy whole", "jax whole"})
"""A whole number above 2."""
INSIDE = frozenset({"half", "numpy half", "jax half", "numpy 0-d", "float16", "bfloat16"})
"""One number in (0, 1)."""
ABOVE_ONE = WHOLE | {"one and a half"}
POSITIVE = INSIDE | ABOVE_ONE
BELOW_ZERO = frozenset({"negative", "minus one"})
REAL = POSITIVE | BELOW_ZERO | {"zero"}
TEXT = frozenset({"empty text", "text", "digit", "numpy text"})
FLAG = frozenset({"True", "numpy True"})
CALLABLE = frozenset({"class", "function", "law class"})
ARRAYS = frozenset(
    {"empty list", "tuple", "range", "shape (1,)", "jax shape (1,)", "shape (2, 3)", "shape (0,)"}
    | {"with nan", "Series", "DataFrame", "numpy 0-d"}
)
"""Arrays of numbers: their bad lanes are flagged, so that any number in them is legal."""
JAX_SCALARS = frozenset({"jax half", "jax whole", "numpy 0-d"})
NONE = frozenset({"None"})
E = INSIDE | ARRAYS | JAX_SCALARS
"""Numbers in (0, 1]."""
POSITIVES = POSITIVE | ARRAYS
REALS = REAL | ARRAYS
E |= {"jax whole"}
