"""Elementary functions without cancellation, series, products, and roots with derivatives."""

from .elementary import arc_over_sine as arc_over_sine
from .elementary import half_gamma_ratio as half_gamma_ratio
from .elementary import kappa as kappa
from .elementary import kappa_and_psi as kappa_and_psi
from .elementary import log1p_over as log1p_over
from .elementary import log_remainder as log_remainder
from .elementary import log_remainder_over as log_remainder_over
from .elementary import psi as psi
from .elementary import sinc_root as sinc_root
from .elementary import speed_of as speed_of
from .powers import power as power
from .products import Product as Product
from .products import contraction as contraction
from .products import product_in_place as product_in_place
from .products import small_product as small_product
from .roots import bracketed_root as bracketed_root
from .roots import expanded_root as expanded_root
from .roots import implicit_root as implicit_root
from .roots import ratio as ratio
from .roots import with_implicit_derivative as with_implicit_derivative
from .series import chebyshev as chebyshev
from .series import chebyshev_by_piece as chebyshev_by_piece
from .series import chebyshev_polynomials as chebyshev_polynomials
from .series import horner as horner
from .varying import varying as varying
