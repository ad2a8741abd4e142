"""The tables of a calibration's report that list images, markers and sightings: of very many the worst, and how many
more there are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...judge.calibrate import Calibration
from ...physics.units import ARCSEC
from ..page import Table
from ..text import number

Document = Mapping[str, Any]

IMAGES_AT_MOST = 100
REJECTED_AT_MOST = 200
"""Images and rejected sightings in the tables of the page; result.json has more of them."""
LISTED_AT_MOST = 40
"""Markers and sightings in the tables of the page; residuals.csv has all of them."""


def rejections(document: Document) -> tuple[Table, ...]:
    """Sightings that were rejected; of very many those with the largest statistic."""
    rejected: Sequence[Document] = document["rejected"]
    if not rejected:
        return ()
    left = len(rejected) - REJECTED_AT_MOST
    if left > 0:
        rejected = sorted(rejected, key=lambda r: -(r["statistic"] or 0.0))[:REJECTED_AT_MOST]
    rows = [
        (str(r["image_id"]), str(r["landmark_id"]), str(r["reason"]), number(r["statistic"]))
        for r in rejected
    ]
    note = f"The largest statistic first; {left} more are in result.json." if left > 0 else ""
    head = ("image", "marker", "reason", "statistic")
    return (Table("Rejected sightings", head, rows, text_columns=3, note=note),)


def images(document: Document) -> tuple[Table, ...]:
    """Each image's residuals and its own estimated error; of very many the worst."""
    found, left = list(document["images"]), 0
    if len(found) > IMAGES_AT_MOST:
        found, left = _worst(document, "images", "rms_px", IMAGES_AT_MOST)
    rows = [
        (
            str(i["image_id"]),
            str(i["observations"]),
            number(i["rms_px"]),
            number(i["rms_own_px"]),
            *(number(x, 2) for x in i["attitude_error_arcsec"]),
            *(number(x, 2) for x in i["position_error_m"]),
            number(i.get("statistic"), 2),
        )
        for i in found
    ]
    head = (
        "image",
        "sightings",
        "rms, px",
        "own rms, px",
        *(f"attitude {axis}, arcsec" for axis in "xyz"),
        *(f"position {axis}, m" for axis in "xyz"),
        "statistic",
    )
    note = (
        "Attitude and position are each image's own errors as the adjustment finds them, the statistic their misfit in "
        "sigmas; own rms is what is left."
    ) + (f" The worst first; {left} more are left out here." if left > 0 else "")
    return (Table("Images", head, rows, note=note),)


def markers(document: Document) -> tuple[Table, ...]:
    """Each marker's residuals, the worst first."""
    found, left = _worst(document, "landmarks", "rms_own_px", LISTED_AT_MOST)
    rows = [
        (
            str(row["landmark_id"]),
            str(row["observations"]),
            number(row["rms_px"]),
            number(row["rms_own_px"]),
        )
        for row in found
    ]
    note = f"The worst first; {left} more are in residuals.csv." if left > 0 else "The worst first."
    return (Table("Markers", ("marker", "sightings", "rms, px", "own rms, px"), rows, note=note),)


def _worst(document: Document, kind: str, key: str, most: int) -> tuple[list[Document], int]:
    """So many of the sighted images or landmarks, the largest ``key`` first, and how many more there are."""
    sighted = [row for row in document[kind] if row["observations"] > 0]
    found = sorted(sighted, key=lambda row: -(row[key] or 0.0))[:most]
    return found, len(sighted) - len(found) + int(document.get("not_listed", {}).get(kind, 0))


def reliability(c: Calibration) -> tuple[tuple[str, ...], tuple[()], tuple[Table, ...]]:
    """Test, control and largest hidden error of the sightings that fit worst."""
    s = c.snooping
    if s is None or not c.status.usable:
        return (), (), ()
    images, landmarks = c.campaign.images.ids, c.campaign.landmarks.ids
    order = np.argsort(-s.statistic, kind="stable")[:LISTED_AT_MOST]
    sightings = c.campaign.sightings
    rows = [
        (
            images[sightings.image[i]],
            landmarks[sightings.landmark[i]],
            _role(c, int(i)),
            number(float(s.statistic[i]), 2),
            *(number(float(w), 2) for w in s.w[i]),
            number(float(s.redundancy[i]), 2),
            *(number(float(px), 2) for px in s.detectable_px[i]),
            number(float(s.effect_E[i] / ARCSEC), 2),
        )
        for i in order
    ]
    head = (
        "image",
        "marker",
        "role",
        "statistic",
        "w, column",
        "w, row",
        "redundancy",
        "detectable, column, px",
        "detectable, row, px",
        "effect, arcsec",
    )
    words = (
        "The statistic is the misfit of a sighting in sigmas if it is tested alone, w the same for its column and row. "
        "Redundancy is the share of its information that the others control. An error of the detectable size is found "
        "with 80 % power at the level 0.1 %; one just below it would turn the answer by the effect.",
    )
    left = sightings.image.size - len(rows)
    note = f"The worst first; {left} more are in residuals.csv." if left > 0 else "The worst first."
    marked = frozenset(k for k, row in enumerate(rows) if row[2] == "rejected")
    return words, (), (Table("Sightings", head, rows, text_columns=3, marked=marked, note=note),)


def _role(c: Calibration, row: int) -> str:
    if c.campaign.sightings.check[row]:
        return "check"
    return "control" if c.residuals.used[row] else "rejected"
