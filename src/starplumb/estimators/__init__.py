"""The estimators by the names of the command line; each a frozen dataclass of options in a file of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module

from .protocol import Estimator


def _of(module: str, kind: str) -> Callable[[], Estimator]:
    """Makes an estimator of a module, which is loaded when it is first asked for: most work needs one or two."""

    def made() -> Estimator:
        found: Estimator = getattr(import_module(f".{module}", __name__), kind)()
        return found

    return made


METHODS: dict[str, Callable[[], Estimator]] = {
    "gls": _of("gls", "Gls"),
    "default": _of("default", "Default"),
    "robust": _of("robust", "Robust"),
    "sequential": _of("sequential", "Sequential"),
    "observer": _of("published.observer", "Observer"),
    "least-squares": _of("published.least_squares", "LeastSquares"),
    "cross-product": _of("published.cross_product", "CrossProduct"),
    "image-plane": _of("published.image_plane", "ImagePlane"),
    "ground-plane": _of("published.ground_plane", "GroundPlane"),
    "projective": _of("published.projective", "Projective"),
    "wahba": _of("wahba", "Wahba"),
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
    from .start import FromClosedForm, FromModel

    if start == "model":
        from .sequential import Sequential

        return FromModel(Sequential(start="model") if name == "sequential" else method(), BEARS[name])
    return method() if name == "sequential" else FromClosedForm(method())
