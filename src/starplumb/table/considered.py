"""What a campaign does not estimate but does not know exactly either: parameters considered with a stated sigma.

Each is one draw for the whole campaign, that moves what its correction would move (:mod:`starplumb.table.parameters`):
it stands in the covariance of the answer, and is not estimated::

    z = H theta + A_c c + ...,    c ~ N(0, sigma^2)

``refraction`` is the part of the computed refraction by which that may be wrong.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ..physics.errors import ArgumentError
from ..physics.light import refraction_shift
from ..physics.units import LEAST_SIGMA, MOST_SIGMA
from .campaign import Campaign
from .error_sources import Source, as_stated
from .observations import Observations, first_of_image
from .parameter_names import GROUPS, of_sigmas, sigma_of
from .parameters import LookAngles, Optics, Parameter, TrackerMounting

Array = NDArray[np.float64]

REFRACTION = "refraction"
_PERCENT = re.compile(r"\s*\+?((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*%")


def considered(stated: Mapping[str, str], campaign: Campaign) -> tuple[tuple[str, float], ...]:
    """Names and sigmas (SI) of the section [consider] of a campaign: ``focal_length = "5um"``, a group such as
    ``look_angles = "0.4px"`` for each of its members, ``refraction = "10%"``.

    Raises InputError for a name that the camera has not, and for a sigma without unit.
    """
    members = {name: GROUPS.get(name, (name,)) for name in stated}
    try:
        _parameters(campaign, {member: 1.0 for each in members.values() for member in each})
    except ArgumentError as error:
        raise ArgumentError("consider", str(error).partition(": ")[2]) from None
    found: dict[str, float] = {}
    for name, text in stated.items():
        for member in members[name]:
            own = name == REFRACTION
            found[member] = _percent(text) if own else sigma_of(member, text, campaign, f"consider.{name}")
    return tuple(found.items())


def _percent(text: str) -> float:
    found = _PERCENT.fullmatch(text)
    percent = float(found[1]) if found else np.nan
    if not LEAST_SIGMA <= percent <= MOST_SIGMA:
        limits = f"{LEAST_SIGMA:g} to {MOST_SIGMA:g} %"
        wanted = f'wanted a positive part of the refraction such as "10%", {limits}'
        raise ArgumentError(f"consider.{REFRACTION}", f'found "{text}", {wanted}')
    return percent / 100.0


def _parameters(campaign: Campaign, sigmas: Mapping[str, float]) -> tuple[Parameter, ...]:
    return of_sigmas({name: sigma for name, sigma in sigmas.items() if name != REFRACTION}, campaign)


def considered_sources(campaign: Campaign, o: Observations) -> Iterator[Source]:
    """The sources of error of what a campaign considers, one draw each for all sightings."""
    sigmas = dict(campaign.considered)
    for parameter in _parameters(campaign, sigmas):
        yield source_of(parameter, np.array(parameter.sigma), o)
    if REFRACTION in sigmas:
        yield refraction(sigmas[REFRACTION], o)


def source_of(parameter: Parameter, sigma: Array, o: Observations) -> Source:
    """One draw for the campaign of the error of a parameter with the sigmas (s,): what was measured is off by minus
    what a correction moves."""
    name, all_of_image = parameter.names[0], np.zeros(o.n_images, dtype=np.int64)
    every = np.zeros(o.n, dtype=np.int64)
    if isinstance(parameter, Optics | LookAngles):
        moved = parameter.moves(o, np.zeros(sigma.size)).xy_K
        assert moved is not None
        label = "look angles" if isinstance(parameter, LookAngles) else "optics"
        return as_stated(label, "tangent", -moved * sigma, every)
    if isinstance(parameter, TrackerMounting):
        turned = np.where(parameter.images[:, None, None], np.diag(sigma), 0.0)
        return as_stated("trackers", "alpha_E", turned, all_of_image)
    if name == "time_offset_attitude":
        return as_stated("clock", "turn_E", -o.omega_E[..., None] * sigma, every)
    if name == "time_offset_orbit":
        return as_stated("clock", "rho_J", -first_of_image(o, o.v_J)[..., None] * sigma, all_of_image)
    if name == "time_offset":
        return as_stated("clock", "late_s", -np.full((o.n_images, 1, 1), sigma[0]), all_of_image)
    raise ValueError(f"the parameter {name} has no source of error")


def refraction(part: float, o: Observations) -> Source:
    """A part of the refraction by which it is wrong, for all sightings alike: it turns the line of sight."""
    shift_E = (o.C_EJ @ refraction_shift(o.p_J, o.r_J)[..., None])[..., 0] / o.range_m[..., None]
    turned = np.cross(o.e_E, shift_E)
    return as_stated(REFRACTION, "turn_E", part * turned[..., None], np.zeros(o.n, dtype=np.int64))
