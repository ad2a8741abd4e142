"""``residuals.csv``: every sighting with its residuals and, where the method says it, its reliability."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...judge.snooping import Snooping
from ...physics.units import ARCSEC
from ..campaign.marks.markers import noise_columns
from ..text.write import Column

Array = NDArray[np.float64]

DECIMALS = 9
"""Kept of residuals: a billionth of a pixel, a nanometre; all 17 digits would double the size of the file."""

RESIDUAL_COLUMNS = [
    "image_id",
    "landmark_id",
    "role",
    "column_px",
    "row_px",
    "before_column_px",
    "before_row_px",
    "after_column_px",
    "after_row_px",
    "own_column_px",
    "own_row_px",
    "normalised",
    "before_east_m",
    "before_north_m",
    "after_east_m",
    "after_north_m",
]
"""``residuals.csv``: predicted minus measured pixel before, after, and less each image's and landmark's own error."""
RELIABILITY_COLUMNS = [
    "statistic",
    "w_column",
    "w_row",
    "tau_column",
    "tau_row",
    "redundancy",
    "detectable_column_px",
    "detectable_row_px",
    "effect_arcsec",
]
"""What :class:`starplumb.judge.snooping.Snooping` says of each sighting, behind the others where the method says it."""


def residual_names(c: Calibration) -> Sequence[str]:
    """Header of ``residuals.csv``."""
    return [*RESIDUAL_COLUMNS, *([] if c.snooping is None else RELIABILITY_COLUMNS), *_noise(c)[0]]


def residual_columns(c: Calibration, shift_px: float) -> Sequence[Column]:
    """Columns of ``residuals.csv``, one row a sighting in the order of the observation table.

    Pixels are given as the user counts them, ``shift_px`` ahead of ours.
    """
    s, r = c.campaign.sightings, c.residuals
    images, landmarks = c.campaign.images.ids, c.campaign.landmarks.ids
    role = np.where(s.check, "check", np.where(r.used, "control", "rejected"))
    return [
        [images[i] for i in s.image.tolist()],
        [landmarks[i] for i in s.landmark.tolist()],
        role.tolist(),
        s.column_px + shift_px,
        s.row_px + shift_px,
        *(_rounded(pair[:, i]) for pair in (r.before_px, r.after_px, r.fit_px) for i in range(2)),
        _rounded(r.normalised),
        *(_rounded(pair[:, i]) for pair in (r.before_m, r.after_m) for i in range(2)),
        *([] if c.snooping is None else _reliability_columns(c.snooping)),
        *_noise(c)[1],
    ]


def _noise(c: Calibration) -> tuple[Sequence[str], Sequence[Column]]:
    """The noise of marks whose column and row differ; of others nothing."""
    marks = c.campaign.sightings
    return ((), ()) if marks.ellipse is None else noise_columns(marks)


def _reliability_columns(s: Snooping) -> Sequence[Array]:
    """An error that nothing would show (infinite) is left empty."""
    detectable = [_rounded(s.detectable_px[:, i]) for i in range(2)]
    return [
        _rounded(s.statistic),
        *(_rounded(values[:, i]) for values in (s.w, s.tau) for i in range(2)),
        _rounded(s.redundancy),
        *(np.ma.masked_where(np.isinf(px), px) for px in detectable),
        np.ma.masked_invalid(_rounded(s.effect_E / ARCSEC)),
    ]


def _rounded(values: Array) -> Array:
    return np.round(values, DECIMALS) + 0.0  # which has no minus
