"""The closed form: the rotation that best carries the measured directions onto those of the markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..table.observations import Observations
from .protocol import AlignmentEstimate, without_prior
from .usable import status_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wahba:
    """Minimise ``sum w |e_E - C_EK e_K|^2``, any initial error, one step, no iteration.

    ``B = sum w e_E e_K^T = U S V^T``, ``C_EK = U diag(1, 1, det U det V) V^T``, all sightings with the same weight:
    errors that an image shares are not in it, so its angle about the boresight is several times worse than it need be,
    and it states no covariance of its own.
    Source: F. L. Markley, Attitude determination using vector observations and the singular value decomposition,
    J. Astronautical Sciences 36 (1988).
    """

    def __call__(self, observations: Observations, C_EK: Array) -> AlignmentEstimate:
        C, known = rotation(observations)
        status = status_of(observations, C, determined=known)
        notes = without_prior(
            observations,
            "closed form, any initial error; all sightings weigh the same; states no sigma",
        )
        return AlignmentEstimate(C, None, status, np.ones_like(status), notes=notes)


def rotation(observations: Observations) -> tuple[Array, NDArray[np.bool_]]:
    """The rotations (..., 3, 3) of the closed form, and where (...) the observations determine them."""
    weighted_e_E = observations.weight[..., None] * observations.e_E
    B = weighted_e_E.mT @ observations.e_K
    B = np.where(np.all(np.isfinite(B), axis=(-2, -1), keepdims=True), B, 0.0)  # and so singular
    U, S, Vt = np.linalg.svd(B)
    sign = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    U = U * np.stack([np.ones_like(sign), np.ones_like(sign), sign], axis=-1)[..., None, :]
    # two directions fix the rotation: the second singular value measures how far apart they are (rad^2, times n)
    return U @ Vt, np.asarray(S[..., 1] + sign * S[..., 2] > 1e-15 * S[..., 0])
