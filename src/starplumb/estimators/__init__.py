"""The estimators by the names of the command line; each a frozen dataclass of options in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

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
from .start import FromClosedForm, FromModel
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
"""Called without arguments, each has its published or recommended options, and starts where it was published to."""
BEARS = {
    "sequential": "some 20 deg",
    "observer": "a few degrees",
    **dict.fromkeys(("least-squares", "cross-product", "image-plane", "ground-plane"), "half a degree"),
    "projective": "some 20 deg",
}
"""Methods that have to start somewhere, and what error of the start they bear (``benchmarks/starts.py``)."""


def methods(start: str = "closed-form") -> dict[str, Callable[[], Estimator]]:
    """All methods, those that have to start somewhere at the closed form or, as published, at the model mounting."""
    return {name: partial(_started, name, method, start) for name, method in METHODS.items()}


def _started(name: str, method: Callable[[], Estimator], start: str) -> Estimator:
    if name not in BEARS:
        return method()
    if start == "model":
        return FromModel(Sequential(start="model") if name == "sequential" else method(), BEARS[name])
    return method() if name == "sequential" else FromClosedForm(method())
