"""What an answer rests on: how well a number that nobody estimated must be known for the answer to be as good as said.

With N the normal equations at the estimate, of what was estimated (a) and of further numbers (j) at zero, a value v of
one of these moves the answer by ``N_aa^-1 N_aj v``: it matters from where that is one sigma about some axis.  With the
numbers estimated instead, the sigma grows by what the inverse of all of N says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...estimators.fit import Fit
from ...physics.camera import FrameCamera, LineScanCamera
from ...physics.light import refraction_shift
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ...table.observations import Observations
from ...table.parameter_names import GROUPS, of_sigmas
from ...table.parameters import Moves, Parameter
from ..trust import Finding
from ..unmodelled import wider

Array = NDArray[np.float64]

KNOWN_PX, KNOWN_S, KNOWN_FOCAL = 1.0, 1e-3, 1e-4
"""To what a camera's description is known without more ado: pixels of look angles and principal point, seconds of its
clock, a part of the focal length..."""
KNOWN_REFRACTION = 0.3
"""...and a part of the refraction that is computed; of one that is not computed, all of it is wrong."""
HOPELESS = 100.0
"""Growth of a sigma from which estimating a number is no advice."""


@dataclass(frozen=True)
class RefractionPart:
    """A part of the computed refraction to be added to it."""

    names: tuple[str] = ("refraction",)
    sigma: tuple[float] = (np.inf,)
    range: tuple[float] = (100.0,)

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        return o.with_geometry(p_J=o.p_J + value[..., None, :] * refraction_shift(o.p_J, o.r_J))

    def moves(self, observations: Observations, value: Array) -> Moves:
        return Moves(shift_J=-refraction_shift(observations.p_J, observations.r_J)[..., None])


@dataclass(frozen=True)
class Unmodelled:
    """A quantity that is not estimated: its parameters, its ``key`` for ``--estimate`` (None: there is none), words,
    and a ``unit`` of ``size`` SI, in which it is ``known`` without more ado."""

    parameters: tuple[Parameter, ...]
    key: str | None
    words: str
    unit: str
    size: float
    known: float

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for parameter in self.parameters for name in parameter.names)


@dataclass(frozen=True)
class RestsOn:
    """How an answer rests on a quantity: its errors (k,) are from where it matters to each axis of E, in its unit, and
    ``sigma_E`` (3,) rad are the answer's if it is estimated."""

    of: Unmodelled
    matters: Array
    sigma_E: Array
    grown: Array

    @property
    def urgency(self) -> float:
        """To what it is known without more ado, over the size from which it matters."""
        return float(np.max(self.of.known / self.matters))

    @property
    def sentence(self) -> str:
        axis = int(np.argmin(self.matters))
        size = f"{self.matters[axis]:.2g} {self.of.unit}"
        known = f"{'xyz'[axis]} rests on {self.of.words} known to {size}"
        if self.of.key is None:
            return known
        if self.grown[axis] > HOPELESS:
            return f"{known}; these views cannot tell it"
        return f"{known}; --estimate {self.of.key} gives {self.sigma_E[axis] / ARCSEC:.2g} arcsec"


def rests_on(campaign: Campaign, fit: Fit, sigma_E: Array) -> tuple[RestsOn, ...]:
    """Of every quantity that is neither estimated nor considered, for an answer with the sigmas (3,) rad; the most
    urgent first."""
    tried = list(_unmodelled(campaign, {*fit.unknowns.names, *(name for name, _ in campaign.considered)}))
    if np.any(fit.table.batch) or not tried:
        return ()
    N = wider(fit, tuple(p for each in tried for p in each.parameters)).solve().information
    first = 3 + len(fit.unknowns.names)
    counts = [len(each.names) for each in tried]
    a = np.setdiff1d(np.arange(len(N)), np.arange(first, first + sum(counts)))
    alone = np.linalg.inv(N[np.ix_(a, a)])
    found, at = [], first
    for each, count in zip(tried, counts, strict=True):
        j = np.arange(at, at := at + count)
        turn = np.sqrt(np.sum((alone[:3] @ N[np.ix_(a, j)]) ** 2, axis=-1))
        both = np.concatenate([a, j])
        ratio = np.diagonal(np.linalg.inv(N[np.ix_(both, both)]))[:3] / np.diagonal(alone)[:3]
        grown = np.sqrt(
            np.where(ratio > 0.0, ratio, np.inf)
        )  # singular to the last digit: a sign of no meaning
        found.append(RestsOn(each, sigma_E / np.maximum(turn, 1e-300) / each.size, grown * sigma_E, grown))
    return tuple(sorted(found, key=lambda one: -one.urgency))


def finding_of_rests_on(found: tuple[RestsOn, ...]) -> list[Finding]:
    """The most urgent, where what is known without more ado is not enough; a sentence, which weakens nothing."""
    return [Finding(found[0].sentence, False)] if found and found[0].urgency > 1.0 else []


def _unmodelled(campaign: Campaign, known: set[str]) -> Iterator[Unmodelled]:
    """What could be estimated of the camera and its clock, and the refraction."""
    camera = None if campaign.several else campaign.camera  # optics are a camera's own
    if isinstance(camera, FrameCamera):
        mm, focal = 1e-3, camera.focal_length
        yield from _one(
            campaign, known, "focal_length", "the focal length", "mm", mm, KNOWN_FOCAL * focal / mm
        )
        yield from _one(campaign, known, "principal_point", "the principal point", "px", 1.0, KNOWN_PX)
    if isinstance(camera, LineScanCamera):
        words = "look angles at the ends of the line"
        yield from _one(campaign, known, "look_angles", words, "px", camera.pixel_rad, KNOWN_PX)
    clocks = {"time_offset", "time_offset_attitude", "time_offset_orbit"}
    if known.isdisjoint(clocks):
        yield from _one(campaign, known, "time_offset", "the images' times", "ms", 1e-3, KNOWN_S / 1e-3)
    if "refraction" not in known:
        computed = campaign.corrections.refraction
        words, enough = (
            ("the computed refraction", KNOWN_REFRACTION) if computed else ("a refraction of 0", 1.0)
        )
        yield Unmodelled((RefractionPart(),), None, words, "%", 0.01, 100.0 * enough)


def _one(
    campaign: Campaign, known: set[str], key: str, words: str, unit: str, size: float, enough: float
) -> Iterator[Unmodelled]:
    """A quantity by the key of ``--estimate``, where none of it is known."""
    names = GROUPS.get(key, (key,))
    if known.isdisjoint(names):
        yield Unmodelled(of_sigmas(dict.fromkeys(names, np.inf), campaign), key, words, unit, size, enough)
