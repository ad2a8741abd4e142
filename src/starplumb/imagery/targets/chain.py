"""From raw images and surveyed targets to sightings; or to detections, where it is not known which target is which.

A target is looked for where the model mounting puts it, as far around as its error may reach.  Where every place found
lies within reach of one target only and every target has one place within reach, in all images, they are sightings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import C_JT, itrf_to_geodetic
from ...table.appearance import Seen, appearance
from ...table.campaign import Campaign
from ...table.geometry import project
from ..acquisition import REACH
from ..chain import MeasuredImage, Memory, Wanted, remembered, sigma_in_camera, told
from ..chips import Chip
from ..pictures import Picture
from ..scene import Raw
from ..search import Found
from ..verdicts import Candidate, Verdict
from .fit import Noise
from .measuring import Sought, Target, Tell, targets_of
from .shape import Shape

Array = NDArray[np.float64]

BEYOND_PX = 8.0
"""How far beyond its reach a target is looked for: optics and orbit err too."""
_PROBE_M = 20.0


@dataclass(frozen=True)
class Targets:
    """What was measured: the images, whether it is known which target is which (``labelled``), and the noise and blur
    of each image, None where it could not be read."""

    images: tuple[MeasuredImage, ...]
    labelled: bool
    noise: tuple[tuple[Noise, float] | None, ...]


@dataclass(frozen=True)
class TargetScene:
    """The images of a campaign with their pixels, and its landmarks, all of one ``shape``.

    ``noise`` is the camera's, None for one that each image tells; targets are ``bright`` or of either sign.
    """

    campaign: Campaign
    raws: Sequence[Raw]
    shape: Shape
    noise: Noise | None
    bright: bool = True
    saturation_dn: float | None = None


def measure_targets(
    scene: TargetScene,
    covariance_E: Array,
    own_E: Array,
    wanted: Wanted,
    tell: Tell = lambda done: None,
    memory: Memory | None = None,
) -> Targets:
    """The targets of all images; ``covariance_E`` and ``own_E`` (3, 3) as of :func:`measure_images`; ``tell`` hears how
    many images are done; what ``memory`` recalls is not measured again."""
    C_EK = scene.campaign.C_EK
    sigma_K = np.hypot(sigma_in_camera(C_EK, covariance_E), sigma_in_camera(C_EK, own_E))
    seen = []
    for image in range(len(scene.raws)):
        seen.append(remembered(memory, image, partial(SeenTargets.of, scene, image, sigma_K)))
        tell(image + 1)
    labelled = any(one.pairs for one in seen) and not any(one.ambiguous for one in seen)
    images = tuple(one.measured(scene, labelled, sigma_K, wanted) for one in seen)
    return Targets(images, labelled, tuple(one.noise for one in seen))


@dataclass(frozen=True)
class SeenTargets:
    """An image: what stands out in it, where its landmarks are expected, pairs of both within reach, and whether one
    has several."""

    image: int
    found: tuple[Target, ...]
    noise: tuple[Noise, float] | None
    landmark: NDArray[np.int64]
    expected: Array
    reach_px: float
    pairs: tuple[tuple[int, int], ...]
    ambiguous: bool
    reason: str = ""

    @classmethod
    def of(cls, scene: TargetScene, image: int, sigma_K: Array) -> SeenTargets:
        from ...physics.errors import InputError

        landmark, expected, reach = _expected(scene, image, sigma_K)
        try:
            found, noise, width = targets_of(scene.raws[image], _sought(scene, image, landmark))
        except InputError as error:
            return cls(image, (), None, landmark, expected, reach, (), False, str(error))
        good = [k for k, target in enumerate(found) if not target.why]
        at = np.array([found[k].pixel for k in good]).reshape(-1, 2)
        near = np.linalg.norm(expected[:, None] - at, axis=-1) <= reach
        pairs = tuple((int(i), good[j]) for i, j in zip(*np.nonzero(near), strict=True))
        several = bool(np.any(near.sum(axis=0) > 1) or np.any(near.sum(axis=1) > 1))
        return cls(image, tuple(found), (noise, width), landmark, expected, reach, pairs, several)

    def measured(self, scene: TargetScene, labelled: bool, sigma_K: Array, wanted: Wanted) -> MeasuredImage:
        """The image with a chip for each place, and with names for each landmark that was expected."""
        C_EK = scene.campaign.C_EK
        start = Found(C_EK, len(self.pairs), len(self.expected), self.reason)
        if self.reason:
            return MeasuredImage(self.image, C_EK, start, (), reason=self.reason)
        owner = {found: which for which, found in self.pairs} if labelled else {}
        chips = [self._chip(scene, k, target, owner) for k, target in enumerate(self.found)]
        if labelled:
            chips += self._missing(scene, len(chips))
        if not any(chip.candidate.verdict == Verdict.USED for chip in chips):
            reason = (
                f"no target is found in it; {len(self.expected)} were expected within {self.reach_px:.0f} px"
            )
            return MeasuredImage(self.image, C_EK, start, tuple(chips), reason=reason)
        if not labelled:
            return MeasuredImage(self.image, C_EK, start, tuple(chips))
        return told(scene.campaign, self.image, start, chips, sigma_K, wanted)

    def _chip(self, scene: TargetScene, k: int, target: Target, owner: dict[int, int]) -> Chip:
        name = scene.campaign.images.ids[self.image]
        candidate = Candidate(self.image, k, target.place, target.pixel, Verdict.USED)
        if target.why:
            candidate = replace(candidate, verdict=Verdict(target.word), reason=target.why)
        elif owner:
            candidate = self._labelled(scene, candidate, owner.get(k))
        label = candidate.landmark or f"{name}-{k:03d}"
        picture = Picture(name, label, None, target.window.astype(np.float32))
        if (fit := target.fit) is not None:
            residual = (target.window - fit.model).astype(np.float32)
            picture = replace(picture, reference=fit.model.astype(np.float32), residual=residual)
            width, strength = fit.width_px, fit.strength
            candidate = replace(candidate, blur_px=width, gain=strength, covariance_px2=fit.covariance_px2)
        return Chip(candidate, picture)

    def _labelled(self, scene: TargetScene, candidate: Candidate, which: int | None) -> Candidate:
        """The sighting of a landmark, or something that none of them is."""
        if which is None:
            reason = f"no target was expected within {self.reach_px:.0f} px of it"
            return replace(candidate, verdict=Verdict.NO_REFERENCE, reason=reason)
        k = int(self.landmark[which])
        landmarks = scene.campaign.landmarks
        return replace(candidate, place=self.expected[which], p_J=landmarks.r_J[k], landmark=landmarks.ids[k])

    def _missing(self, scene: TargetScene, first: int) -> list[Chip]:
        """The landmarks that were expected inside the image and not found."""
        columns, rows = scene.raws[self.image].size_px
        there = {which for which, _ in self.pairs}
        out: list[Chip] = []
        for which, place in enumerate(self.expected):
            if which in there or np.any(place < 0.0) or np.any(place > [columns - 1.0, rows - 1.0]):
                continue
            k = int(self.landmark[which])
            reason = f"nothing that stands out within {self.reach_px:.0f} px of where it was expected"
            missing = Candidate(self.image, first + len(out), place, place, Verdict.NO_MATCH, reason)
            landmarks = scene.campaign.landmarks
            out.append(Chip(replace(missing, p_J=landmarks.r_J[k], landmark=landmarks.ids[k]), None))
        return out


def _expected(scene: TargetScene, image: int, sigma_K: Array) -> tuple[NDArray[np.int64], Array, float]:
    """Landmarks (n,) that an image may show, their pixels (n, 2) by the model mounting, and how far these may err."""
    campaign = scene.campaign
    columns, rows = scene.raws[image].size_px
    middle = 0.5 * np.array([columns - 1.0, rows - 1.0])
    _, slope = campaign.camera.tan_from_px(middle[0], middle[1])
    pixel = float(np.linalg.norm(slope[:, 0]))
    turned = sigma_K[2] * float(np.linalg.norm(middle))
    reach = REACH * (float(np.hypot(*sigma_K[:2])) / np.sqrt(2.0) / pixel + turned) + BEYOND_PX
    found = appearance(campaign, campaign.C_EK, image, campaign.landmarks.r_J, skip=True)
    inside = np.all((found.pixel >= -0.5) & (found.pixel <= np.array([columns, rows]) - 0.5), axis=-1)
    near = np.all((found.pixel > -reach) & (found.pixel < np.array([columns, rows]) + reach), axis=-1)
    # what lies beside the image has a place beside it, or none that means anything
    beside = (found.seen == Seen.BESIDE) & near & ~inside
    which = np.flatnonzero((found.seen == Seen.YES) | beside)
    return which, found.pixel[which], reach


def _sought(scene: TargetScene, image: int, landmark: NDArray[np.int64]) -> Sought:
    """The form as this image shows it: metres on the ground at its landmarks as pixels."""
    campaign = scene.campaign
    if not landmark.size or scene.shape.reach_m == 0.0:
        return Sought(scene.shape, np.eye(2), scene.noise, scene.bright, scene.saturation_dn)
    p_J = campaign.landmarks.r_J[landmark].mean(axis=0)
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    C = C_JT(latitude, longitude)
    ends = p_J + _PROBE_M * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) @ C.T
    columns, rows = scene.raws[image].size_px
    start = np.tile(0.5 * np.array([columns - 1.0, rows - 1.0]), (3, 1))
    pixel = project(campaign, campaign.C_EK, np.full(3, image), ends, start)
    px_from_m = ((pixel[1:] - pixel[0]) / _PROBE_M).T
    return Sought(scene.shape, px_from_m, scene.noise, scene.bright, scene.saturation_dn)
