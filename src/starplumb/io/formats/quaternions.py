"""Quaternions of a file as those of a rotation: of unit norm, in our sense."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...physics.errors import InputError
from .series_tables import FloatArray

CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])
"""Scalar last: turns the quaternion of a frame's turn into that which takes coordinates along, and back."""
_NORM_TOLERANCE = 1e-3
_ROUNDING = 1e-15


def unit(q: FloatArray, error: Callable[[int, str], InputError]) -> FloatArray:
    """Quaternions (n, 4) of norm 1.  Raises ``error(row, sentence)`` for the first whose norm is not 1 within 1e-3."""
    norm = np.linalg.norm(q, axis=1)
    wrong = ~(np.abs(norm - 1.0) <= _NORM_TOLERANCE)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise error(row, f"the quaternion has norm {norm[row]:.6g}, wanted 1 within 0.001")
    # Digits that are of unit norm already are kept as they are: no file changes by being read and written.
    norm[np.abs(norm - 1.0) < _ROUNDING] = 1.0
    return np.asarray(q / norm[:, None])
