"""Errors that several images may share: images close in time, and trackers that contradict each other."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from ...physics.trackers import FusedAttitude
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ..consistency import chi2_p
from ..trust import IMPLAUSIBLE_P
from .evidence import NOTICEABLE, Evidence, growth, listed, worst
from .image_errors import ImageErrors

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PARTS = {"attitude": slice(0, 3), "ephemeris": slice(3, 6)}
"""Where the errors of each section stand among those of an image."""
CLOSE_S = 60.0
"""Images nearer in time than this may well share the errors of tracker and orbit."""
ABSURD = 10.0
"""Trackers that disagree by this many times what their sigmas allow leave the answer without a bound."""


def close_in_time(campaign: Campaign, errors: ImageErrors, covariance_E: Array) -> Iterator[Evidence]:
    """Images close in time, where the campaign does not state who shares the errors of attitude or orbit."""
    missing = [
        section
        for section, stated in (
            ("attitude", campaign.attitude_errors.stated),
            ("ephemeris", campaign.position_errors.stated),
        )
        if not stated
    ]
    seen = np.flatnonzero(errors.seen)
    order = seen[np.argsort(campaign.images.t_ns[seen], kind="stable")]
    t = campaign.images.t_ns[order]
    close = np.diff(t) < CLOSE_S * 1e9
    if not missing or not np.any(close):
        return
    group = np.concatenate([[0], np.cumsum(~close)])
    kinds = tuple(part for name, part in _PARTS.items() if name in missing)
    further = _if_shared(errors, order, group, kinds) - _if_shared(
        errors, order, np.arange(order.size), kinds
    )
    if growth(covariance_E, further) <= NOTICEABLE:
        return
    members = [campaign.images.ids[i] for i in order[np.bincount(group)[group] > 1].tolist()]
    nearest = float(np.min(np.diff(t))) * 1e-9
    sections = " and ".join(f"[{section}]" for section in missing)
    whose = " and ".join(
        {"attitude": "the tracker", "ephemeris": "the orbit"}[section] for section in missing
    )
    yield Evidence(
        "shared errors",
        f"{len(members)} images less than a minute apart ({listed(members)}; the nearest {nearest:.2g} s) may "
        f"share one error of {whose}: the answer would be wrong by {worst(covariance_E, further)}",
        f'state in {sections} what has one error in common: shared_by = "image", "pass", "session" or "campaign"',
        covariance_E=further,
        rows=tuple(members),
    )


def _if_shared(errors: ImageErrors, order: Index, group: Index, kinds: tuple[slice, ...]) -> Array:
    """Covariance (3, 3) of the alignment by stated image errors, if images of one group had one draw in common."""
    G, total = errors.gains[order], np.zeros((3, 3))
    first = np.unique(group, return_index=True)[1]
    for part in kinds:
        sums = np.zeros((first.size, 3, 3))
        np.add.at(sums, group, G[:, :, part])
        total += np.sum(sums @ errors.stated[order[first], part, part] @ sums.mT, axis=0)
    return total


def _remedy(campaign: Campaign) -> str:
    named = campaign.images.tracker
    if named is not None and len(set(named)) > 1:
        return "use --estimate trackers"
    return (
        "add a column tracker to the table of images, which tracker each attitude is from (two or more), and use "
        "--estimate trackers"
    )


def trackers(
    campaign: Campaign, errors: ImageErrors, covariance_E: Array, estimated: Collection[str] = ()
) -> Iterator[Evidence]:
    """Trackers that disagree by more than their sigmas allow, unless their mountings are estimated."""
    attitude = campaign.attitude
    if not isinstance(attitude, FusedAttitude) or any(name.startswith("tracker") for name in estimated):
        return
    seen = np.flatnonzero(errors.seen)
    t_ns = campaign.images.t_ns[seen]
    seen, t_ns = (x[np.any(attitude.used(t_ns), axis=0)] for x in (seen, t_ns))
    if t_ns.size == 0:
        return
    residual, chi2 = attitude.residuals(t_ns), float(np.sum(attitude.disagreement(t_ns)))
    freedom = int(3 * np.sum(np.isfinite(residual[..., 0])) - 3 * t_ns.size)
    if chi2_p(chi2, freedom) > IMPLAUSIBLE_P:
        return
    angle = np.nan_to_num(np.linalg.norm(residual, axis=-1))
    j, i = np.unravel_index(np.argmax(angle), angle.shape)
    away = np.nan_to_num(residual).reshape(-1, 3)
    further = away.mT @ away / max(int(np.sum(np.isfinite(residual[..., 0]))), 1)
    times, name = np.sqrt(chi2 / freedom), attitude.trackers[j].name
    yield Evidence(
        "trackers",
        f"the star trackers disagree, {times:.2g} times what their sigmas allow: {name} lies "
        f"{angle[j, i] / ARCSEC:.3g} arcsec from their average at image {campaign.images.ids[seen[i]]}; the mounting "
        f"of one of them may be off, and the answer with it by {worst(covariance_E, further)}",
        _remedy(campaign),
        refuses=bool(times > ABSURD),
        covariance_E=further,
        rows=(campaign.images.ids[seen[i]],),
    )
