"""The parameters a user asks for by name: ``focal_length``, ``time_offset=10ms``, ``look_x_2``...

A name alone frees the parameter; with ``=`` follows the sigma known beforehand, with its unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from ..physics.camera import FrameCamera, LineScanCamera
from ..physics.errors import ArgumentError, did_you_mean
from ..physics.units import ARCSEC, LEAST_SIGMA, MOST_SIGMA
from .campaign import Campaign
from .parameters import OPTICS, LookAngles, Optics, Parameter, TimeOffset, TrackerMounting

GROUPS = {
    "principal_point": ("principal_column", "principal_row"),
    "distortion": ("k1", "k2", "k3", "p1", "p2"),
    "look_angles": ("look_x_1", "look_x_2", "look_x_3", "look_y_2", "look_y_3"),
}
CLOCKS = ("time_offset", "time_offset_attitude", "time_offset_orbit")
UNITS = {
    "m": 1.0,
    "mm": 1e-3,
    "um": 1e-6,
    "px": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "arcsec": ARCSEC,
    "": 1.0,
}
_LOOK = re.compile(r"look_[xy]_[0-5]")
_SIGMA = re.compile(r"((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)([a-z]*)")


def parameters(texts: Sequence[str], campaign: Campaign) -> tuple[Parameter, ...]:
    """The parameters of a campaign that a user names, each with its sigma where one is stated.

    Raises InputError, one sentence, for a name the campaign's camera or images have not, and for a sigma without unit.
    """
    sigmas: dict[str, float] = {}
    for text in texts:
        name, _, stated = text.partition("=")
        for member in GROUPS.get(name, (name,)):
            if member in sigmas:
                raise ArgumentError("estimate", f"found {member!r} twice, wanted each parameter once")
            sigmas[member] = sigma_of(member, stated, campaign) if stated else np.inf
    return of_sigmas(sigmas, campaign)


def of_sigmas(sigmas: Mapping[str, float], campaign: Campaign) -> tuple[Parameter, ...]:
    """The parameters of a campaign with these names and sigmas (SI, infinite for a free one)."""
    optics = tuple(name for name in OPTICS if name in sigmas)
    looks = tuple(name for name in sigmas if _LOOK.fullmatch(name))
    clocks = tuple(name for name in CLOCKS if name in sigmas)
    rest = [name for name in sigmas if name not in (*optics, *looks, *clocks, "trackers")]
    if rest:
        names = ("focal_length", *GROUPS, *CLOCKS, "trackers")
        hint = did_you_mean(rest[0], names)
        raise ArgumentError("estimate", f"found {rest[0]!r}, wanted one or more of {', '.join(names)}{hint}")
    found: list[Parameter] = []
    if campaign.several and (optics or looks):
        name = (*optics, *looks)[0]
        raise ArgumentError(
            "estimate",
            f"found {name!r} in a campaign of several cameras, wanted it in that camera's own campaign",
        )
    if optics:
        found.append(_optics(campaign, optics, sigmas))
    if looks:
        found.append(_look_angles(campaign, looks, sigmas))
    found += [TimeOffset((name,), (sigmas[name],)) for name in clocks]
    if "trackers" in sigmas:
        found += _trackers(campaign, sigmas["trackers"])
    return tuple(found)


def unit_of(name: str) -> str:
    """Unit in which a parameter is written, the last part of its key in ``result.json``; empty for a pure number."""
    if name == "focal_length":
        return "mm"
    if name.startswith("principal"):
        return "px"
    if name.startswith("time"):
        return "ms"
    return "arcsec" if name.startswith(("tracker", "camera", "look")) else ""


def sigma_of(name: str, text: str, campaign: Campaign, key: str = "estimate") -> float:
    """A sigma with its unit, SI; ``key`` is what a message about it names."""
    unit = unit_of("tracker" if name == "trackers" else name)
    kinds = {
        "mm": ("m", "mm", "um"),
        "px": ("px",),
        "ms": ("s", "ms", "us"),
        "arcsec": ("arcsec", "px") if name.startswith("look") else ("arcsec",),
        "": ("",),
    }[unit]
    match = _SIGMA.fullmatch(text)
    found = np.nan
    if match is not None and match[2] in kinds:
        found = float(match[1]) * UNITS[match[2]]
        if name.startswith("look") and match[2] == "px" and isinstance(campaign.camera, LineScanCamera):
            found *= campaign.camera.pixel_rad
    if not LEAST_SIGMA <= found / UNITS[unit] <= MOST_SIGMA:
        form = f"a positive number with its unit ({', '.join(kinds)})" if unit else "a positive number"
        limits = f"{LEAST_SIGMA:g} to {MOST_SIGMA:g} {unit}".rstrip()
        raise ArgumentError(
            key, f"found {name}={text}, wanted {form} as sigma, {limits}, such as {name}=5{unit}"
        )
    return found


def _optics(campaign: Campaign, names: tuple[str, ...], sigmas: Mapping[str, float]) -> Optics:
    if not isinstance(campaign.camera, FrameCamera):
        raise ArgumentError(
            "estimate",
            f"found {names[0]!r}, wanted look_angles (or look_x_1 for the focal length) "
            "for a line-scan camera",
        )
    return Optics(campaign.camera, names, tuple(sigmas[name] for name in names))


def _look_angles(campaign: Campaign, names: tuple[str, ...], sigmas: Mapping[str, float]) -> LookAngles:
    if not isinstance(campaign.camera, LineScanCamera):
        raise ArgumentError(
            "estimate", f"found {names[0]!r}, wanted focal_length or distortion for a frame camera"
        )
    return LookAngles(campaign.camera, names, tuple(sigmas[name] for name in names))


def _trackers(campaign: Campaign, sigma: float) -> list[Parameter]:
    """A mounting of its own for every tracker but that of the first image."""
    labels = campaign.images.tracker
    if labels is None or len(set(labels)) < 2:
        raise ArgumentError(
            "estimate",
            "found 'trackers', wanted a column tracker in the table of images that names at least two",
        )
    names = list(dict.fromkeys(labels))
    member = np.array(labels)
    return [TrackerMounting(name, member == name, (sigma,) * 3) for name in names[1:]]
