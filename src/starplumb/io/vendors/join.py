"""Several campaigns of one camera as one: their images, orbits and attitudes side by side, nothing averaged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.camera import Camera
from ...physics.errors import InputError
from ...physics.series import Attitude, Bursts, Ephemeris, Orientation, seconds
from ...physics.trackers import FusedAttitude
from ...table.campaign import Campaign, Images, Landmarks, Sightings
from ...table.coverage import covered
from ...table.geometry import stations
from ..tables.cells import Array
from ..text.files import show

Epochs = NDArray[np.int64]

SAME_PX = 0.01
"""Look directions of one camera, read from two products, agree to this."""
SAME_TURN = 1e-8
"""Mountings of one camera, rad: a centimetre on the ground from 1000 km."""
SAME_M = 0.01
"""By no more may a camera's place in an image change where its orbit stands beside others."""
_ROWS = 9
"""Rows of a line scanner's image at which that is looked at."""


@dataclass(frozen=True)
class Named:
    """A campaign and what messages call it."""

    name: str
    campaign: Campaign


def joined(parts: Sequence[Named]) -> Campaign:
    """One campaign of all: cameras, mountings, corrections and sigmas must be those of the first, whose frame holds.

    Where series overlap, each is used about its own images.  Raises InputError where the campaigns contradict each
    other, for an id that stands for two things, and where joining would move a camera.
    """
    first = parts[0].campaign
    for other in parts[1:]:
        _require_alike(parts[0], other)
    spans = [_span(part) for part in parts]
    order = sorted(range(len(parts)), key=lambda i: spans[i][0])
    ordered, ends = [parts[i] for i in order], [spans[i] for i in order]
    images, index = _images(parts)
    landmarks, sightings = _marks(parts, index)
    whole = replace(
        first,
        camera=_widest(parts),
        ephemeris=_orbit(ordered, ends),
        attitude=_attitude(ordered, ends, first.one_attitude.frame),
        images=images,
        landmarks=landmarks,
        sightings=sightings,
        orientation=next((p.campaign.orientation for p in parts if p.campaign.orientation), None),
    )
    for part, start in zip(parts, index, strict=True):
        _require_unmoved(part, whole, start)
    return whole


def _require_alike(a: Named, b: Named) -> None:
    """What one campaign has once must be the same in both."""
    first, other = a.campaign, b.campaign
    if isinstance(first.attitude, FusedAttitude) or isinstance(other.attitude, FusedAttitude):
        raise InputError(f"{a.name}: found several star trackers, wanted one attitude to join others with")
    differ = f"{b.name}: found"
    if first.camera.scans != other.camera.scans or not _same_camera(first, other):
        raise InputError(
            f"{differ} another camera than that of {a.name} (its pixels look elsewhere), wanted products of one camera "
            "in a campaign"
        )
    if np.linalg.norm(so3.log(first.C_EK @ other.C_EK.mT)) > SAME_TURN:
        raise InputError(f"{differ} another model mounting than that of {a.name}, wanted the same")
    if first.corrections != other.corrections:
        other_ones = (
            f"an attitude with other corrections than that of {a.name} (light time, aberration, refraction)"
        )
        raise InputError(f"{differ} {other_ones}, wanted the same")
    for key, x, y in (
        ("sigma_m", first.sigma_position, other.sigma_position),
        ("sigma_arcsec", first.cov_attitude_E, other.cov_attitude_E),
    ):
        if x.shape != y.shape or not np.allclose(x, y, rtol=1e-9, atol=0.0):
            raise InputError(
                f"{differ} another {key} than that of {a.name}, wanted one for the campaign ({key})"
            )
    if first.position_frame != other.position_frame:
        found = f"{other.position_frame} beside {first.position_frame}"
        raise InputError(f"{differ} positions in {found}, wanted one frame for the sigmas of a campaign")


def _same_camera(a: Campaign, b: Campaign) -> bool:
    columns = min(a.camera.size_px[0], b.camera.size_px[0])
    rows = min(a.camera.size_px[1], b.camera.size_px[1]) if not a.camera.scans else 1.0
    column, row = (x.ravel() for x in np.meshgrid(np.linspace(0, columns - 1, 257), [0.0, rows - 1.0]))
    (x, slope), (y, _) = a.camera.tan_from_px(column, row), b.camera.tan_from_px(column, row)
    pixel = (
        np.sqrt(np.abs(np.linalg.det(slope)))
        if not a.camera.scans
        else np.linalg.norm(slope[..., 0], axis=-1)
    )
    return bool(np.max(np.linalg.norm(x - y, axis=-1) / pixel) < SAME_PX)


def _widest(parts: Sequence[Named]) -> Camera:
    """The camera with the most columns, and rows for the longest image."""
    camera = max((part.campaign.camera for part in parts), key=lambda camera: camera.size_px[0])
    rows = max(part.campaign.camera.size_px[1] for part in parts)
    return cast("Camera", replace(cast("Any", camera), size_px=(camera.size_px[0], rows)))


def _span(part: Named) -> tuple[int, int]:
    """First and last epoch (ns) of the images of a campaign, as far as it is covered."""
    image, rows = _looked_at(part.campaign)
    good = covered(part.campaign, image, rows)
    if not good.any():
        raise InputError(f"{part.name}: found no image that its attitude and orbit cover, wanted one")
    t_ns = part.campaign.images.exposed(image[good], rows[good])
    return int(t_ns.min()), int(t_ns.max())


def _looked_at(campaign: Campaign) -> tuple[NDArray[np.int64], Array]:
    """Images and rows (n,) that stand for all that is exposed."""
    m, rows = len(campaign.images.ids), campaign.camera.size_px[1]
    last = rows - 1.0 if campaign.camera.scans and np.isfinite(rows) else 0.0
    image, row = np.meshgrid(np.arange(m), np.linspace(0.0, last, _ROWS), indexing="ij")
    marks = campaign.sightings
    return np.concatenate([image.ravel(), marks.image]), np.concatenate([row.ravel(), marks.row_px])


def _images(parts: Sequence[Named]) -> tuple[Images, list[int]]:
    """All images, and the place of the first of each part among them."""
    ids: list[str] = []
    index = []
    for part in parts:
        index.append(len(ids))
        if again := [name for name in part.campaign.images.ids if name in ids]:
            raise InputError(
                f"{part.name}: found the image {show(again[0])} that the campaign has already, wanted another name "
                "(--image-id)"
            )
        ids += part.campaign.images.ids
    every = [part.campaign.images for part in parts]
    for name in ("tracker", "passes", "sessions", "sigma_time_s"):
        if any(getattr(images, name) is not None for images in every):
            raise InputError(
                f"{parts[0].name}: found a column {name} of the images, wanted none: add rows by hand"
            )
    period = [images.line_period_s for images in every if images.line_period_s is not None]
    rows = [each for images in every for each in images.row_times or (None,) * len(images.ids)]
    return Images(
        tuple(ids),
        np.concatenate([images.t_ns for images in every]),
        np.concatenate(period) if period else None,
        every[0].name,
        row_times=tuple(rows) if any(each is not None for each in rows) else None,
    ), index


def _marks(parts: Sequence[Named], index: Sequence[int]) -> tuple[Landmarks, Sightings]:
    """All landmarks, those of one id and one place once, and all sightings."""
    place: dict[str, int] = {}
    r_J: list[Array] = []
    covariance_J: list[Array] = []
    seen = []
    for part, start in zip(parts, index, strict=True):
        marks, s = part.campaign.landmarks, part.campaign.sightings
        for i, name in enumerate(marks.ids):
            k = place.setdefault(name, len(place))
            if k == len(r_J):
                r_J.append(marks.r_J[i])
                covariance_J.append(marks.covariance_J[i])
            elif np.linalg.norm(r_J[k] - marks.r_J[i]) > 1e-3:
                found = f"found the landmark {show(name)} at another place than before"
                raise InputError(f"{part.name}: {found}, wanted one id for one place")
        of = np.array([place[name] for name in marks.ids], dtype=np.int64)
        seen.append(replace(s, image=s.image + start, landmark=of[s.landmark]))
    sources = parts[0].campaign.landmarks.sources
    if sources is not None and len(sources) != len(place):
        raise InputError(
            f"{parts[0].name}: found a column source of the landmarks, wanted none: add rows by hand"
        )
    landmarks = replace(
        parts[0].campaign.landmarks,
        ids=tuple(place),
        r_J=np.array(r_J).reshape(-1, 3),
        covariance_J=np.array(covariance_J).reshape(-1, 3, 3),
    )
    return landmarks, Sightings.joined(seen)


def _orbit(parts: Sequence[Named], ends: Sequence[tuple[int, int]]) -> Ephemeris:
    orbits = [part.campaign.ephemeris for part in parts]
    chosen = _chosen([orbit.t_ns for orbit in orbits], ends, [orbit.r_J for orbit in orbits], parts, "orbit")
    t_ns = np.concatenate([orbit.t_ns[rows] for orbit, rows in zip(orbits, chosen, strict=True)])
    r_J = np.concatenate([orbit.r_J[rows] for orbit, rows in zip(orbits, chosen, strict=True)])
    v = [orbit.v_J[rows] for orbit, rows in zip(orbits, chosen, strict=True) if orbit.v_J is not None]
    v_J = np.concatenate(v) if len(v) == len(orbits) else None
    gap_s = _gap([orbit.bursts for orbit in orbits], t_ns)
    return Ephemeris(t_ns, r_J, v_J, gap_s, orbits[0].name)


def _attitude(
    parts: Sequence[Named], ends: Sequence[tuple[int, int]], frame: Literal["GCRF", "ITRF"]
) -> Attitude:
    """The series of all, from the Earth-fixed or the inertial frame."""
    series = [part.campaign.one_attitude for part in parts]
    orientation = next((each.orientation for each in series if each.orientation is not None), None)
    q = [_in_frame(each, frame, orientation) for each in series]
    q = [each * np.sign(each[:, 3:] + 1e-300) for each in q]
    chosen = _chosen([each.t_ns for each in series], ends, q, parts, "attitude")
    t_ns = np.concatenate([each.t_ns[rows] for each, rows in zip(series, chosen, strict=True)])
    q_EF = np.concatenate([each[rows] for each, rows in zip(q, chosen, strict=True)])
    step = max(each.quaternion_step for each in series)
    gap_s = _gap([each.bursts for each in series], t_ns)
    inertial = orientation if frame == "GCRF" else None
    return Attitude(t_ns, q_EF, frame, inertial, gap_s, series[0].name, quaternion_step=step)


def _in_frame(series: Attitude, frame: str, orientation: Orientation | None) -> Array:
    """Quaternions (n, 4) from the Earth-fixed or the inertial frame."""
    if series.frame == frame:
        return series.q_EF
    assert orientation is not None, "an inertial series knows the orientation of the Earth"
    C_EF = so3.from_quaternion(series.q_EF)
    C_IJ = orientation.C_IJ(series.t_ns)
    return so3.to_quaternion(C_EF @ (C_IJ if frame == "ITRF" else C_IJ.mT))


def _chosen(
    t_ns: Sequence[Epochs],
    ends: Sequence[tuple[int, int]],
    values: Sequence[Array],
    parts: Sequence[Named],
    what: str,
) -> list[NDArray[np.int64]]:
    """The samples of each series, in the order of their images, that are used: all, or those about its own images."""
    low = [np.iinfo(np.int64).min] * len(t_ns)
    high = [np.iinfo(np.int64).max] * len(t_ns)
    for i, (a, b) in enumerate(pairwise(range(len(t_ns)))):
        if t_ns[a][-1] < t_ns[b][0]:
            continue
        if ends[a][1] < ends[b][0]:
            low[b] = (ends[a][1] + ends[b][0]) // 2
            high[a] = low[b] - 1
        elif _one_series(t_ns[a], t_ns[b], values[a], values[b]):
            low[b] = int(t_ns[a][-1]) + 1
        else:
            found = f"found images and {what} that overlap in time those of {parts[i].name} and differ"
            raise InputError(f"{parts[i + 1].name}: {found}, wanted products one after another")
    return [np.flatnonzero((t >= low[i]) & (t <= high[i])) for i, t in enumerate(t_ns)]


def _one_series(t_a: Epochs, t_b: Epochs, a: Array, b: Array) -> bool:
    """Whether two series have the same samples where they overlap, so that the second goes on from the first."""
    both, i, k = np.intersect1d(t_a, t_b, return_indices=True)
    overlap = np.sum(t_b <= t_a[-1])
    return bool(both.size == overlap and np.allclose(a[i], b[k], rtol=1e-12, atol=1e-12))


def _gap(bursts: Sequence[Bursts], t_ns: Epochs) -> float | None:
    """The largest spacing that is joined: as each series alone has it, and none between two of them."""
    alone = Bursts(t_ns)
    inside = max(float(np.max(_steps(each), initial=0.0)) for each in bursts)
    if inside <= alone.limit_s < min((each.limit_s for each in bursts), default=np.inf) * (1.0 + 1e-9):
        return None
    return 1.5 * inside if inside > 0.0 else None


def _steps(bursts: Bursts) -> Array:
    """Spacings (s) inside the bursts of a series."""
    joined_to_next = bursts.bounds[1][:-1] > np.arange(bursts.t_ns.size - 1)
    return np.asarray(seconds(np.diff(bursts.t_ns))[joined_to_next])


def _require_unmoved(part: Named, whole: Campaign, start: int) -> None:
    """Raise InputError where a camera does not stand in the whole as it does alone."""
    image, rows = _looked_at(part.campaign)
    good = covered(part.campaign, image, rows)
    alone = stations(part.campaign, image[good], rows[good])
    together = stations(whole, image[good] + start, rows[good])
    moved = np.linalg.norm(alone.r_J - together.r_J, axis=-1)
    turned = np.linalg.norm(so3.log(alone.C_EJ @ together.C_EJ.mT), axis=-1)
    if np.max(moved) > SAME_M or np.max(turned) > SAME_TURN:
        raise InputError(
            f"{part.name}: joined with the others its camera would move by {np.max(moved):.2g} m and turn by "
            f"{np.max(turned):.2g} rad, since samples of theirs lie between its own; import it into one of its own"
        )
