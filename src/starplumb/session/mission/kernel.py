"""The SPICE frame kernel of a mounting that was issued: as it is at the start of its validity."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ...io.campaign.fixed_frames import CAMERA
from ...io.campaign.spice_config import SpiceConfig, SpiceFrame, camera_frames, kernel_frames
from ...io.formats.spice import frame_kernel_text
from ...io.formats.spice_names import CAMERA_ID, TRACKER_ID
from ...physics.units import ARCSEC


def frame_of(camera: str, rigs: Iterable[tuple[str, ...]]) -> tuple[str, int]:
    """SPICE's name and id of a camera of an archive whose campaigns have the cameras ``rigs``: those that ``calibrate``
    gives it in the largest rig, cameras of other campaigns behind; a camera that is alone is called as it is there."""
    names = dict.fromkeys(name for rig in sorted(rigs, key=len, reverse=True) for name in rig)
    if len(names) < 2:
        return CAMERA, CAMERA_ID
    return camera_frames(dict.fromkeys(names, SpiceFrame()), TRACKER_ID)[camera]


def kernel_of(issued: Mapping[str, Any]) -> str:
    """``mounting.tf`` of what ``Archive.issue`` gives, its coefficients in the comments."""
    model = issued["model"]
    frame = issued["spice_frame"], issued["spice_id"]
    camera, tracker, ids = kernel_frames(SpiceConfig(), issued["tracker"], frame)
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
