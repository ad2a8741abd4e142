"""What of the data contradicts an answer: other sightings, whole images, the ground; and which part fits worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..estimators.protocol import Rival
from ..estimators.robust import EVEN
from ..physics.errors import counted
from ..physics.units import ARCSEC
from ..solve.reliability import Tested
from ..table.campaign import Campaign
from ..table.observations import Observations
from .residuals import Accuracy
from .trust import Finding

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NOTICED = 0.15
"""Support of a rival answer, over that of the answer, from which on it weakens."""
IMAGES_OUT = 0.1
"""Share of the images up to which they may be rejected as a whole."""
MINORITY = 0.5
"""Share of the images rejected from which on those left are no majority: the answer is one of several."""
FEW_LEFT = 0.3
"""Share of the sightings below which those left may agree by chance, or because they lie together."""
FEW_IN_IMAGE = 3
"""Sightings left in most images below which, where more were rejected, they may agree by chance."""
WORSE = 1.5
"""Geolocation error of the control points after over before, from which on an answer is worse than none."""
CULPRIT_P = 1e-4
"""Probability by which the statistics of sightings, images and landmarks are compared."""


@dataclass(frozen=True)
class Support:
    """Sightings of a campaign ``offered`` (n,) to a solution, and those ``used`` (n,)."""

    campaign: Campaign
    observations: Observations
    offered: Mask
    used: Mask

    @property
    def counts(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sightings of each image (m,): offered and used."""
        image, m = self.observations.image, self.observations.n_images
        return np.bincount(image[self.offered], minlength=m), np.bincount(image[self.used], minlength=m)

    def images(self, chosen: Sequence[int] | NDArray[np.int64], most: int = 3) -> str:
        """Names of the first images."""
        names = [self.campaign.images.ids[int(i)] for i in chosen]
        return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def rival(support: Support, other: Rival | None) -> Finding | None:
    """Rejected sightings that agree on an answer of their own."""
    if other is None or float(other.support) < NOTICED:
        return None
    offered, used = support.counts
    lost = np.argsort(used - offered, kind="stable")[: int(other.images)]
    angle = float(np.linalg.norm(other.turn_E)) / ARCSEC
    found = (
        f"rejected sightings in {counted(int(other.images), 'image')} agree on another answer, {angle:.3g} arcsec "
        f"from this one, with {float(other.support):.0%} of its support"
    )
    cure = (
        f"look at images {support.images(lost)} for what is wrong in all of them alike (a misplaced reference image, "
        "labels shifted by one, a wrong time or attitude), and leave it out"
    )
    if float(other.support) >= EVEN:
        return Finding(f"{found}: the data do not tell which of the two is right; {cure}", True, refutes=True)
    return Finding(f"{found}: the interval holds both; {cure}", True, reach_E=other.turn_E)


def rejected_images(support: Support) -> Finding | None:
    """More images rejected as a whole than chance and single faults explain."""
    offered, used = support.counts
    out = np.flatnonzero((offered > 0) & (used == 0))
    total = int(np.sum(offered > 0))
    if out.size <= IMAGES_OUT * total:
        return None
    found = f"{out.size} of {counted(total, 'image')} ({support.images(out)}) are rejected as a whole"
    if out.size >= MINORITY * total:
        return Finding(
            f"{found}: those left are no majority, and an input that all images share may be wrong; run starplumb "
            "diagnose",
            True,
            refutes=True,
        )
    return Finding(
        f"{found}, more than a tenth: what makes them differ may be in the others too; look at their times and "
        "attitude, or run starplumb diagnose",
        True,
    )


def rejected_sightings(support: Support, p: float | None) -> Finding | None:
    """Too few sightings left to speak for an answer, or a minority that is scattered over the images or whose own
    chi-square is improbable (``p``)."""
    offered, used = int(np.sum(support.offered)), int(np.sum(support.used))
    minority = used < MINORITY * offered
    contradictory = minority and p is not None and p < CULPRIT_P
    left = support.counts[1][support.counts[1] > 0]
    scattered = minority and left.size > 0 and float(np.median(left)) < FEW_IN_IMAGE
    if used >= FEW_LEFT * offered and not (contradictory or scattered):
        return None
    return Finding(
        f"{offered - used} of {offered} sightings are rejected, and those left "
        f"{'do not agree either' if contradictory else 'may agree by chance'}: an input that all share may be wrong; "
        "run starplumb diagnose",
        True,
        refutes=True,
    )


def worse_on_the_ground(before: Accuracy | None, after: Accuracy | None) -> Finding | None:
    """Control points that are located worse after the correction than before it."""
    if before is None or after is None or after.rmse <= WORSE * before.rmse:
        return None
    return Finding(
        f"the control points are located worse after the correction ({after.rmse:.3g} m rms) than before it "
        f"({before.rmse:.3g} m): an input does not describe these images; run starplumb diagnose",
        True,
        refutes=True,
    )


def culprit(campaign: Campaign, o: Observations, tested: Tested, used: Mask) -> str:
    """The sighting, image or landmark with the largest statistic over its critical value, in words."""
    from ..solve.probability import chdtri

    def over(statistic: tuple[Array, NDArray[np.int64]]) -> Array:
        T, dof = statistic
        return np.where(dof > 0, T / chdtri(np.maximum(dof, 1), CULPRIT_P), 0.0)

    of_sightings = np.where(used, over(tested.sightings), 0.0)
    of_images, of_landmarks = over(tested.images), over(tested.landmarks)
    largest = [float(np.max(x, initial=0.0)) for x in (of_sightings, of_images, of_landmarks)]
    kind = int(np.argmax(largest))
    if kind == 1:
        i = int(np.argmax(of_images))
        return f"image {campaign.images.ids[i]} fits worst, at {np.sqrt(tested.images[0][i]):.3g} sigma"
    if kind == 2:
        q = int(np.argmax(of_landmarks))
        name = campaign.landmarks.ids[int(tested.repeated[q])]
        return f"landmark {name} fits worst, at {np.sqrt(tested.landmarks[0][q]):.3g} sigma"
    row = int(np.argmax(of_sightings))
    image, landmark = (
        campaign.images.ids[int(campaign.sightings.image[row])],
        campaign.landmarks.ids[int(o.landmark[row])],
    )
    statistic = np.sqrt(tested.sightings[0][row])
    return f"the sighting of landmark {landmark} in image {image} fits worst, at {statistic:.3g} sigma"
