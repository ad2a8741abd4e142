"""Marks where the model predicts them: what further parameters move is differentiated there.

Where a mark was measured it carries noise, and a derivative taken there carries the same noise as the residual that it
multiplies: with 3 px of noise a lens is then estimated wrong by up to half of its sigmas.  Where the model predicts
it, the errors of its image taken out as they are estimated, the derivative is that of the full nonlinear problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.lens import near
from .cameras.mounting import CameraMounting
from .equation import Linearised, linearise, predicted
from .observations import Observations
from .parameters import LookAngles, Optics, Parameter

Array = NDArray[np.float64]


WHOLE_TURN, WHOLE_SHIFT_M = 0.02, 20e3
"""Errors of an image, rad and m, from which on it is not measured but wrong, and nothing is linearised about them."""


@dataclass(frozen=True)
class ImageErrors:
    """Errors of images as they are estimated: ``alpha_E`` (..., m, 3) rad and ``rho_J`` (..., m, 3) m."""

    alpha_E: Array
    rho_J: Array

    @classmethod
    def of(
        cls, alpha_E: Array, rho_J: Array, settled: ImageErrors | None, stands: NDArray[np.bool_]
    ) -> ImageErrors:
        """Those found, 0 for an image that is off by more than an error of measurement; a run of a batch that
        ``stands`` (...) keeps what it has ``settled`` on."""
        size = np.maximum(_length(alpha_E) / WHOLE_TURN, _length(rho_J) / WHOLE_SHIFT_M)
        alpha_E, rho_J = (np.where(size[..., None] < 1.0, x, 0.0) for x in (alpha_E, rho_J))
        if settled is None:
            return cls(alpha_E, rho_J)
        stands = stands[..., None, None]
        return cls(np.where(stands, settled.alpha_E, alpha_E), np.where(stands, settled.rho_J, rho_J))


def _length(v: Array) -> Array:
    return np.asarray(np.sqrt(np.vecdot(v, v)))


@dataclass(frozen=True)
class Seen:
    """A table with its parameters ``applied``, linearised (``model``), and the same with each mark where it is
    ``predicted``, about the errors of the images; the residual is that with these errors in it."""

    applied: Observations
    model: Linearised
    predicted: Observations

    @classmethod
    def of(
        cls,
        stated: Observations,
        own: Sequence[tuple[Parameter, Array]],
        C_EK: Array,
        errors: ImageErrors | None,
    ) -> Seen:
        """Of a table as measured, at values of parameters and the mounting C_EK."""
        if not own:
            return cls(stated, linearise(stated, C_EK), stated)
        applied = stated
        for parameter, value in own:
            applied = parameter.apply(applied, value)
        shown = applied if errors is None else replace(applied, e_E=without_errors(applied, errors))
        foreseen = shown
        for parameter, value in own:
            if isinstance(parameter, Optics):
                xy_K, slope_K, at_K = parameter.look_at(stated.xy_K, value, predicted(shown, C_EK, shown.e_E))
                shown = replace(shown, xy_K=xy_K, slope_K=slope_K)
                foreseen = replace(shown, xy_K=at_K)
            elif isinstance(parameter, LookAngles | CameraMounting):
                at_K = near(predicted(shown, C_EK, shown.e_E), shown.xy_K, parameter.reach)
                foreseen = replace(shown, xy_K=at_K)
        model = linearise(shown, C_EK)
        if errors is not None:
            model = replace(model, z_px=_with_errors(model, applied, errors))
        return cls(applied, model, foreseen)


def without_errors(o: Observations, errors: ImageErrors) -> Array:
    """Directions (..., n, 3) by an attitude and an orbit without these errors."""
    shift_E = (o.C_EJ @ errors.rho_J[..., o.image, :, None])[..., 0]
    turn = so3.exp(-errors.alpha_E)[..., o.image, :, :]
    e_E = (turn @ (o.e_E + shift_E / o.range_m[..., None])[..., None])[..., 0]
    return np.asarray(e_E / np.sqrt(np.vecdot(e_E, e_E))[..., None])


def _with_errors(model: Linearised, o: Observations, errors: ImageErrors) -> Array:
    """The residual (..., n, 2) with these errors back in it, to first order: ``z - H alpha + R rho``."""
    turned = model.H @ errors.alpha_E[..., o.image, :, None]
    return np.asarray(model.z_px - (turned - model.R @ errors.rho_J[..., o.image, :, None])[..., 0])
