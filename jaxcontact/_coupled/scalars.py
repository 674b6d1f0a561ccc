"""Types of single numbers."""

from jaxtyping import Array, Bool, Float, Int

Number = Float[Array, ""]
Flag = Bool[Array, ""]
Index = Int[Array, ""]
