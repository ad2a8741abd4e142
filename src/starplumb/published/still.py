"""True tables of the papers' scenes: a frame camera at given places and attitudes in J, without light effects."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.light import Corrections
from ..table.equation import predict
from ..table.observations import Observations, sight

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NO_CORRECTIONS = Corrections(light_time=False, aberration=False)


def still_frames(
    r_J: ArrayLike,
    C_EJ: ArrayLike,
    p_J: Array,
    image: Index,
    landmark: Index,
    C_EK_true: Array,
    tan_px: float,
    *,
    attitude_E: Array,
    position_m: float,
    landmark_m: float,
    noise_px: float,
) -> Observations:
    """Table of sightings (n,) without error, with the errors that it states.

    Images at ``r_J`` (..., n, 3) m with attitude ``C_EJ`` (..., n, 3, 3), their markers ``p_J`` (..., n, 3) m, the
    mounting ``C_EK_true`` (..., 3, 3).  ``tan_px`` is the tangent of a pixel, ``attitude_E`` (3, 3) rad^2 the
    covariance of each image's attitude; the other standard deviations hold along each axis.
    """
    n, m, L = image.size, int(image.max()) + 1, int(landmark.max()) + 1
    still = np.zeros((n, 3))
    geometry: dict[str, Any] = {
        "r_J": np.broadcast_to(r_J, (*np.shape(r_J)[:-2], n, 3)),
        "v_J": still,
        "C_EJ": np.broadcast_to(C_EJ, (*np.shape(C_EJ)[:-3], n, 3, 3)),
        "omega_E": still,
    }
    directions = sight(p_J, line_period_s=np.zeros(n), corrections=NO_CORRECTIONS, **geometry)
    return Observations(
        image=image,
        landmark=landmark,
        xy_K=predict(C_EK_true, directions["e_E"]),
        slope_K=np.broadcast_to(tan_px * np.eye(2), (n, 2, 2)),
        line_period_s=np.zeros(n),
        p_J=p_J,
        sigma_px=np.full(n, noise_px),
        weight=np.ones(n),
        cov_attitude_E=np.broadcast_to(attitude_E, (m, 3, 3)),
        cov_position_J=np.broadcast_to(position_m**2 * np.eye(3), (m, 3, 3)),
        cov_landmark_J=np.broadcast_to(landmark_m**2 * np.eye(3), (L, 3, 3)),
        corrections=NO_CORRECTIONS,
        **geometry,
        **directions,
    )
