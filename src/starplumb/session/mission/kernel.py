"""The SPICE frame kernel of a mounting that was issued: as it is at the start of its validity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...io.campaign.spice_config import SpiceConfig, kernel_frames
from ...io.formats.spice import frame_kernel_text
from ...physics.units import ARCSEC


def kernel_of(issued: Mapping[str, Any]) -> str:
    """``mounting.tf`` of what ``Archive.issue`` gives, its coefficients in the comments."""
    model = issued["model"]
    camera, tracker, ids = kernel_frames(SpiceConfig(), issued["tracker"])
    comments = [
        f"valid from {issued['from']} to {issued['to'] or 'further notice'} (UTC), as it is at the start",
        f"issued because: {issued['reason']}",
        f"turn of the mounting, arcsec about x y z, t years after {model['year_time']}, dt after {model['time']}:",
        *(
            f"  {name}: {' '.join(f'{c:.6f}' for c in row)}"
            for name, row in zip(model["columns"], model["coefficients_arcsec"], strict=True)
        ),
    ]
    P = ARCSEC**2 * np.array(issued["covariance_arcsec2"])
    return frame_kernel_text(
        np.array(issued["matrix"]), camera, tracker, ids=ids, covariance_E=P, comments=comments
    )
