"""Do the check points, which are in no solution, agree with the answer?

Added to the solution, n points that are as stated raise its chi-square by a chi-square of 2 n degrees of freedom: the
errors that they share with the control points (of their images and markers, of the survey) are accounted for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...estimators.protocol import AlignmentEstimate
from ...estimators.usable import EXACT
from ...table.campaign import Campaign
from ..snooping import Snooping
from ..trust import IMPLAUSIBLE_P, Finding, probability

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ALONE = 5.0
"""Misfit, in sigmas, from which a single check point is wrong by itself: once in 270 000."""
FEW = 1.0 / 3.0
"""Share of the check points up to which wrong ones are wrong labels or places, and the others decide."""
ABSURD = 10.0
"""Misfit over what is stated from which nothing bounds what is wrong."""
HELD = 10.0
"""Sigmas of the answer beyond which the check points are asked alone: what they do not determine stays as it is."""


def compared(campaign: Campaign, used: Mask) -> Mask:
    """Check points (n,) that tell something of an answer by the sightings ``used`` (n,): not those of images that it
    leaves out, whose attitude or labels are wrong for them too."""
    s, images = campaign.sightings, len(campaign.images.ids)
    has, kept = (np.bincount(s.image[rows], minlength=images) > 0 for rows in (~s.check, used))
    return np.asarray(s.check & campaign.landmarks.surveyed[s.landmark] & ~(has & ~kept)[s.image])


def of_check_points(
    campaign: Campaign, fit: Fit, estimate: AlignmentEstimate, snooping: Snooping | None
) -> list[Finding]:
    """What the check points say of an answer whose ``fit`` leaves them out; nothing where sightings are not tested."""
    check = compared(campaign, fit.table.weight > 0.0)
    if snooping is None or not np.any(check):
        return []
    wrong = check & (snooping.statistic > ALONE)
    few = 0 < np.sum(wrong) <= FEW * np.sum(check)
    if few and _together(fit, estimate, check & ~wrong) is None:
        return [_alone(campaign, check, wrong, snooping)]
    found = _together(fit, estimate, check)
    return [] if found is None else [found]


def _together(fit: Fit, estimate: AlignmentEstimate, decide: Mask) -> Finding | None:
    """What check points (n,) that contradict the answer as a whole mean for it."""
    from ...solve.probability import chdtrc

    used, n = fit.table.weight > 0.0, int(np.sum(decide))
    added = float(_weighted(fit, used | decide).solve().chi2 - fit.solve().chi2)
    # residuals of the control points that are larger than stated are told elsewhere
    dof = int(estimate.degrees_of_freedom or 0)
    stated = 1.0 if estimate.chi2 is None or dof <= 0 else max(1.0, float(estimate.chi2) / dof)
    p = float(chdtrc(2 * n, added / stated))
    factor = float(np.sqrt(max(added, 0.0) / stated / (2 * n)))
    if not p < IMPLAUSIBLE_P or factor <= EXACT:
        return None
    found = (
        f"the {n} check points contradict the answer: together they lie {factor:.2g} times as far off as the control "
        f"points and the stated errors allow ({probability(p)}); look at what differs between the two (survey, labels, "
        "part of the image)"
    )
    if factor > ABSURD:
        return Finding(f"{found}; nothing bounds what is wrong: run starplumb diagnose", True, refutes=True)
    reach_E = _answer_of(fit, decide)
    return Finding(f"{found}; the interval holds their answer too", True, reach_E=reach_E)


def _weighted(fit: Fit, chosen: Mask) -> Fit:
    """The same adjustment of other sightings (n,)."""
    return replace(fit, table=replace(fit.table, weight=np.where(chosen, 1.0, 0.0)))


def _answer_of(fit: Fit, decide: Mask) -> Array:
    """Turn (3,) rad about E from the answer to that of the check points alone."""
    answer = fit.solve()
    alone = replace(_weighted(fit, decide).whole, prior=(answer.information / HELD**2, answer.x))
    return np.asarray((alone.solution.x - answer.x)[:3])


def _alone(campaign: Campaign, check: Mask, wrong: Mask, snooping: Snooping) -> Finding:
    """A few check points that are wrong by themselves: nothing rests on them."""
    s, worst = campaign.sightings, int(np.argmax(np.where(wrong, snooping.statistic, 0.0)))
    place = f"{campaign.landmarks.ids[s.landmark[worst]]} in {campaign.images.ids[s.image[worst]]}"
    count = int(np.sum(wrong))
    which = f"are wrong by themselves (the worst is {place}" if count > 1 else f"is wrong by itself ({place}"
    return Finding(
        f"{count} of {int(np.sum(check))} check points {which}, "
        f"{float(snooping.statistic[worst]):.3g} sigma): look at their labels and places; the others agree with the "
        "answer",
        False,
    )
