"""One satellite of a fleet in a row, from the document of its trend."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...physics.timescales import parse

DAY_NS = 86_400e9
LAST = 12
"""Campaigns in the sparkline."""


def satellite_row(d: Mapping[str, Any]) -> dict[str, Any]:
    """Error in use, age, sigma, evidence of change, what to do, and the last campaigns, as seen from a trend's time."""
    advice = d["recommendation"]
    loss = "rms_if_issued" if advice["rms_in_use_arcsec"] is None else "rms_in_use"
    points = d["points"]
    change = min(d["changes"], key=lambda c: c["p"], default=None)
    ends = np.array([p["value_arcsec"][:2] for p in points[-LAST:]])
    axis = int(np.argmax(np.ptp(ends, axis=0)))
    now, last = parse([d["at"], points[-1]["time"]], "UTC").tolist()
    return {
        "satellite": d["satellite"],
        "from": d["from"],
        "to": d["to"],
        "campaigns": len(points),
        "last": points[-1]["time"],
        "age_days": (now - last) / DAY_NS,
        "loss_m": advice[f"{loss}_m"],
        "loss_arcsec": advice[f"{loss}_arcsec"],
        "issued": advice["rms_in_use_arcsec"] is not None,
        "sigma_arcsec": d["forecast"][0]["sigma_arcsec"],
        "change": None if change is None else change["words"],
        "change_p": None if change is None else change["p"],
        "action": advice["action"],
        "calibrate_by": advice["calibrate_by"],
        "recent_arcsec": ends[:, axis].tolist(),
    }
