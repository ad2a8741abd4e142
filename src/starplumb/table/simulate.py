"""From truth to measurements: what the instruments would report of a scene whose geometry and mounting are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from .equation import predicted
from .error_sources import Errors
from .observations import Observations

Array = NDArray[np.float64]
__all__ = ["Errors", "measure"]


def measure(truth: Observations, C_EK_true: Array, errors: Errors) -> Observations:
    """The table the instruments would give: the true scene of ``truth`` with errors, batch axes from either.

    The marker falls where the measurement equation puts it; a line scanner's row error exposes the row at another time,
    so attitude and position are read ``row error x line period`` later (to first order in the motion).
    """
    o = truth
    xy_K = predicted(o, C_EK_true, o.e_E) + (o.slope_K @ errors.pixel[..., None])[..., 0]
    if errors.tangent is not None:
        xy_K = xy_K + errors.tangent
    late = o.line_period_s * errors.pixel[..., 1]
    if errors.late_s is not None:
        late = late + errors.late_s[..., o.image]
    turn_E = late[..., None] * o.omega_E + errors.alpha_E[..., o.image, :]
    if errors.turn_E is not None:
        turn_E = turn_E + errors.turn_E
    C_EJ = so3.exp(turn_E) @ o.C_EJ
    r_J = o.r_J + errors.rho_J[..., o.image, :] + late[..., None] * o.v_J
    p_J = o.p_J + errors.pi_J[..., o.landmark, :]
    return replace(o.with_geometry(C_EJ=C_EJ, r_J=r_J, p_J=p_J), xy_K=xy_K)
