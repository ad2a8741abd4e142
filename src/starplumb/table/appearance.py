"""Where places on the ground appear in an image, and which of them do not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..physics.earth import C_JT, itrf_to_geodetic
from ..physics.series import Bursts
from ..physics.trackers import FusedAttitude
from .campaign import Campaign
from .coverage import covered
from .equation import in_front, predict
from .geometry import ROW_TOLERANCE_PX, apparent, middle_px, scan_step, stations

Array = NDArray[np.float64]

_MOST_STEPS = 30
MOST_ROWS = 10_000_000
"""So many rows an image of unknown length has at most; what is beyond is another image, or a slip of the pen."""
_NODES = 65
"""Rows at which the beginning of what is covered is looked for."""
_FIELD = 1.5
"""Directions so many times farther out than the border of the image are not asked of the lens: it may fold there."""


class Seen(IntEnum):
    """Whether a place appears in an image, or why it does not."""

    YES = 0
    BESIDE = 1
    BELOW_HORIZON = 2
    NOT_COVERED = 3


@dataclass(frozen=True)
class Appearance:
    """Pixels (n, 2) of n places in one image and whether each appears (n,); of others the pixel is of no use."""

    pixel: Array
    seen: NDArray[np.int64]


def appearance(campaign: Campaign, C_EK: Array, image: int, p_J: Array, skip: bool = False) -> Appearance:
    """Where places p_J (n, 3) appear in an image.

    A frame camera needs one evaluation; in a line scanner's rows a place is looked for by Newton's method, which does
    not leave the rows that orbit and attitude cover.  Raises EpochError where they do not cover the image, or
    where a place may lie in rows that they do not cover, unless ``skip``.
    """
    n = len(p_J)
    span = row_span(campaign, image)
    if span is None:
        if not skip:
            stations(campaign, np.array([image]), middle_px(campaign, np.array([image]))[:, 1])
        return Appearance(np.full((n, 2), np.nan), np.full(n, Seen.NOT_COVERED))
    pixel, found, at_end = (_on_frame if not campaign.camera.scans else _on_scan)(
        campaign, C_EK, image, p_J, span
    )
    columns, rows = campaign.camera.size_px
    with np.errstate(invalid="ignore"):
        inside = np.all((pixel >= -0.5) & (pixel <= np.array([columns, rows]) - 0.5), axis=-1)
        if not np.isfinite(rows):
            inside = (pixel[:, 0] >= -0.5) & (pixel[:, 0] <= columns - 0.5)
    seen = np.where(found & inside, Seen.YES, Seen.BESIDE)
    seen = np.where(at_end & ~found, Seen.NOT_COVERED, seen)
    seen = np.where(_risen(campaign, image, pixel, p_J), seen, Seen.BELOW_HORIZON)
    if not skip and np.any(seen == Seen.NOT_COVERED):
        row = span[0] - 1.0 if pixel[np.argmax(seen == Seen.NOT_COVERED), 1] <= span[0] else span[1] + 1.0
        stations(campaign, np.array([image]), np.array([row]))
    return Appearance(pixel, seen)


def _on_frame(
    campaign: Campaign, C_EK: Array, image: int, p_J: Array, _span: tuple[float, float]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels of a frame camera, and which lie before it within reach of its lens."""
    camera, index = campaign.camera, np.full(len(p_J), image)
    e_E = apparent(campaign, stations(campaign, index, np.zeros(len(p_J))), p_J)["e_E"]
    ahead = in_front(C_EK, e_E)
    xy_K = np.where(ahead[:, None], predict(C_EK, e_E), 0.0)
    columns, rows = camera.size_px
    edge = np.array([[0.0, 0.0], [columns, 0.0], [0.0, rows], [columns, rows]])
    corner, _ = camera.tan_from_px(edge[:, 0], edge[:, 1])
    reach = _FIELD * np.linalg.norm(corner, axis=-1).max()
    ahead &= np.linalg.norm(xy_K, axis=-1) <= reach
    return camera.px_from_tan(np.where(ahead[:, None], xy_K, 0.0)), ahead, np.zeros(len(p_J), np.bool_)


def _on_scan(
    campaign: Campaign, C_EK: Array, image: int, p_J: Array, span: tuple[float, float]
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels at which places cross the line of detectors, which were found, and which would lie in rows of the image
    that are not covered."""
    index = np.full(len(p_J), image)
    pixel = middle_px(campaign, index)
    columns = campaign.camera.size_px[0]
    found, beyond = np.zeros(len(p_J), np.bool_), np.zeros(len(p_J))
    ahead = np.ones(len(p_J), np.bool_)
    pixel[:, 1] = np.clip(pixel[:, 1], *span)
    for _ in range(_MOST_STEPS):
        directions = apparent(campaign, stations(campaign, index, pixel[:, 1]), p_J)
        ahead = in_front(C_EK, directions["e_E"])
        step = np.nan_to_num(scan_step(campaign, C_EK, pixel, directions), nan=0.0, posinf=1e9, neginf=-1e9)
        moved = pixel + step
        bounded = np.stack(
            [np.clip(moved[:, 0], -columns, 2.0 * columns), np.clip(moved[:, 1], *span)], axis=-1
        )
        beyond = moved[:, 1] - bounded[:, 1]
        still = np.all(np.abs(bounded - pixel) < ROW_TOLERANCE_PX, axis=-1)
        pixel = bounded
        found = still & (np.abs(beyond) < ROW_TOLERANCE_PX) & ahead
        if still.all():
            break
    first, last = _own_rows(campaign, image)
    short = ((beyond < 0.0) & (span[0] > first)) | ((beyond > 0.0) & (span[1] < last))
    reached = np.where(beyond < 0.0, pixel[:, 1] + beyond >= first, pixel[:, 1] + beyond <= last)
    across = (pixel[:, 0] >= -0.5) & (pixel[:, 0] <= columns - 0.5)
    return pixel, found, short & reached & across & ahead


def _own_rows(campaign: Campaign, image: int) -> tuple[float, float]:
    """First and last row that an image is known to have; none beyond row 0 where its end is not stated."""
    rows, table = campaign.camera.size_px[1], campaign.images.table_of(image)
    if table is not None:
        return max(-0.5, float(table.row[0]) - 0.5), min(rows - 0.5, float(table.row[-1]) + 0.5)
    return (-0.5, rows - 0.5) if np.isfinite(rows) else (0.0, 0.0)


def row_span(campaign: Campaign, image: int) -> tuple[float, float] | None:
    """First and last row of an image that orbit and attitude cover, as far as the image goes; None where none is."""
    images = campaign.images
    if not campaign.camera.scans or images.line_period_s is None:
        return (0.0, 0.0) if covered(campaign, np.array([image]), np.zeros(1)).all() else None
    first, last = _own_rows(campaign, image)
    nodes = np.linspace(first, last, _NODES) if last > first else _nearest_rows(campaign, image)
    good = covered(campaign, np.full(nodes.size, image), nodes)
    if not good.any():
        return None
    anchor = images.exposed(np.array([image]), nodes[[int(np.argmax(good))]])
    ends_ns = _burst(campaign, anchor)
    ends = np.sort(images.row_at(image, ends_ns))
    ends = np.clip(ends, first, last) if last > first else np.clip(ends, -0.5, MOST_ROWS)
    return float(ends[0]), float(ends[1])


def _nearest_rows(campaign: Campaign, image: int) -> Array:
    """Row 0 of an image of unknown length, and the first later one at a sample of the attitude, if it has that many."""
    images = campaign.images
    period = 1.0 if images.line_period_s is None else float(images.line_period_s[image])
    late_ns = np.concatenate([attitude.t_ns for attitude in campaign.attitudes]) - images.t_ns[image]
    rows = late_ns * 1e-9 / period
    within = rows[(rows >= 0.0) & (rows <= MOST_ROWS)]
    return np.array([0.0, within.min()] if within.size else [0.0])


def _burst(campaign: Campaign, t_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Beginning and end (2,) of the samples without a gap around an epoch (1,), of orbit and attitude alike."""
    attitude = campaign.attitude
    if isinstance(attitude, FusedAttitude):
        pointing = [tracker.attitude.bursts for tracker in attitude.trackers if tracker.covers(t_ns).all()]
    else:
        pointing = [attitude.bursts]
    widest = _ends(pointing, t_ns)
    orbit = _ends([campaign.ephemeris.bursts], t_ns)
    return np.array([max(widest[0], orbit[0]), min(widest[1], orbit[1])])


def _ends(bursts: Iterable[Bursts], t_ns: NDArray[np.int64]) -> tuple[int, int]:
    """The earliest beginning and the latest end of the bursts around an epoch (1,)."""
    ends = []
    for each in bursts:
        nearest = int(np.argmin(np.abs(each.t_ns - t_ns)))
        first, last = each.bounds
        ends.append((int(each.t_ns[first[nearest]]), int(each.t_ns[last[nearest]])))
    return min(first for first, _ in ends), max(last for _, last in ends)


def _risen(campaign: Campaign, image: int, pixel: Array, p_J: Array) -> NDArray[np.bool_]:
    """Whether the camera stands above the horizon of places (n, 3)."""
    rows = np.nan_to_num(pixel[:, 1]) if campaign.camera.scans else np.zeros(len(p_J))
    r_J = stations(campaign, np.full(len(p_J), image), rows).r_J
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    up_J = C_JT(latitude, longitude)[..., 2]
    return np.asarray(np.vecdot(r_J - p_J, up_J) > 0.0)
