"""The estimators by the names of the command line; each a frozen dataclass of options in a file of its own."""

from __future__ import annotations

from collections.abc import Callable

from .default import Default
from .gls import Gls
from .protocol import Estimator
from .published.cross_product import CrossProduct
from .published.ground_plane import GroundPlane
from .published.image_plane import ImagePlane
from .published.least_squares import LeastSquares
from .published.observer import Observer
from .published.projective import Projective
from .robust import Robust
from .sequential import Sequential
from .wahba import Wahba

METHODS: dict[str, Callable[[], Estimator]] = {
    "gls": Gls,
    "default": Default,
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
