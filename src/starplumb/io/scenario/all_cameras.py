"""The images chosen of a scenario of several cameras, as all of them take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...plan.choice.views import Sites, Views
from ...plan.error_catalogue import Flight
from ...plan.rigs import together
from ...plan.scenario import Scenario
from ...table.geometry import observe
from .candidates import Stage, by_site, ground, marked, unmarked
from .errors import error_sources
from .parts import camera_of, mounted

Index = NDArray[np.int64]

FEWEST = 2
"""Sightings of a camera, from which its mounting can be found."""


def of_all_cameras(s: Stage, views: Views, sites: Sites, picks: Index) -> Scenario | None:
    """The scenario of the images ``picks`` (n,) of the first camera with those that the others take at the same times,
    of cameras that see markers then; None where none does."""
    picks, on = np.sort(picks), ground(s, sites)
    bare, C_EC, site = unmarked(s, views, picks), mounted(s.config), views.site[picks]
    parts = {}
    for (name, (section, _)), C in zip(s.config.optics.items(), C_EC, strict=True):
        seen = marked(s, replace(bare, camera=camera_of(section, s.folder), C_EK=C), sites, site, on)
        if seen.sightings.image.size >= FEWEST:
            parts[name] = seen
    if len(parts) < 2 or next(iter(parts)) != next(iter(s.config.optics)):
        return None
    kept = np.array([name in parts for name in s.config.optics])
    C_KC = C_EC[0].mT @ C_EC[kept]
    campaign = together(list(parts.values()), list(parts), C_KC, one_site=on is not None)
    number = np.tile(np.unique(views.pass_of[picks], return_inverse=True)[1], len(parts))
    sources = error_sources(s.config, Flight(observe(campaign), campaign, number))
    if on is not None:
        sources = tuple(by_site(source, s.config, on.site) for source in sources)
    return Scenario.of(campaign, sources, description=s.config.scenario.description)
