"""A scene written down without any of the package's geometry."""

from __future__ import annotations

import numpy as np

from starplumb.physics.light import Corrections
from starplumb.table.observations import Observations

H = 600_000.0
R = 6_378_137.0
# metres east and north of the point below the camera, which stands over 0 N 0 E
EAST = np.array([9e3, -8e3, 7e3, -6e3, 2e3])
NORTH = np.array([5e3, 6e3, -9e3, -4e3, -1e3])


def by_hand() -> Observations:
    """Camera over 0 N 0 E at height H, x_K east, y_K south, z_K down; E is K. Up is x of J, east y, north z.

    The marker (east, north) on the tangent plane lies at (-H, east, north) from the camera, so it appears at the
    tangents (east/H, -north/H).
    """
    n = EAST.size
    p_J = np.stack([np.full(n, R), EAST, NORTH], axis=-1)
    r_J = np.tile([R + H, 0.0, 0.0], (n, 1))
    C_EJ = np.tile([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]], (n, 1, 1))
    range_m = np.sqrt(H**2 + EAST**2 + NORTH**2)
    e_E = np.stack([EAST, -NORTH, np.full(n, H)], axis=-1) / range_m[:, None]
    return Observations(
        image=np.zeros(n, dtype=np.int64),
        landmark=np.arange(n),
        xy_K=np.stack([EAST / H, -NORTH / H], axis=-1),
        slope_K=np.tile(4e-6 * np.eye(2), (n, 1, 1)),
        line_period_s=np.zeros(n),
        C_EJ=C_EJ,
        omega_E=np.zeros((n, 3)),
        r_J=r_J,
        v_J=np.zeros((n, 3)),
        p_J=p_J,
        e_E=e_E,
        row_rate_E=np.zeros((n, 3)),
        range_m=range_m,
        sigma_px=np.full(n, 0.1),
        weight=np.ones(n),
        cov_attitude_E=np.zeros((1, 3, 3)),
        cov_position_J=np.zeros((1, 3, 3)),
        cov_landmark_J=np.zeros((n, 3, 3)),
        corrections=Corrections(False, False, False),
    )
