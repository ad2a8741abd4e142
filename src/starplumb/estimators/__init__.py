"""The estimators by the names of the command line; each a frozen dataclass of options in a file of its own."""

from __future__ import annotations

from collections.abc import Callable

from .cross_product import CrossProduct
from .gls import Gls
from .ground_plane import GroundPlane
from .image_plane import ImagePlane
from .least_squares import LeastSquares
from .observer import Observer
from .projective import Projective
from .protocol import Estimator
from .robust import Robust
from .sequential import Sequential
from .wahba import Wahba

METHODS: dict[str, Callable[[], Estimator]] = {
    "gls": Gls,
    "robust": Robust,
    "sequential": Sequential,
    "observer": Observer,
    "least-squares": LeastSquares,
    "cross-product": CrossProduct,
    "image-plane": ImagePlane,
    "ground-plane": GroundPlane,
    "projective": Projective,
    "wahba": Wahba,
}
"""Called without arguments, each has its published or recommended options."""
