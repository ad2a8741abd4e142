"""Images of a scenario with tie points: places at each site that nobody surveyed, measured in all its images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...physics.earth import C_JT, geodetic_to_itrf
from ...plan import scene
from ...plan.choice.views import Sites, Views
from ...plan.error_catalogue import Flight
from ...plan.scenario import Scenario
from ...table.campaign import Campaign, Landmarks, Sightings
from ...table.error_sources import UNIT_METRE, Source
from ...table.geometry import locate, observe
from .candidates import Stage, by_site, ground, marked, unmarked
from .errors import error_sources
from .parts import UNSTATED

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ACROSS = 5
"""Tie points along each side of a site's square of them."""
MIDDLE = 0.6
"""The square's part of the least extent of the images of the site, so that each shows most of it."""
UNKNOWN_M = 1e4
"""Sigma of a place that nobody surveyed: to the pixels of any camera as good as infinite."""


def tied_scenario(s: Stage, views: Views, sites: Sites, picks: Index) -> Scenario:
    """The scenario of the images ``picks`` (n,), each site with so many times so many tie points across, which are
    measured as well as markers wherever they are in the frame."""
    picks = np.sort(picks)
    on = ground(s, sites)
    bare, site = unmarked(s, views, picks), views.site[picks]
    known = marked(s, bare, sites, site, on)
    campaign = _joined(known, _tied(bare, sites, site))
    number = np.unique(views.pass_of[picks], return_inverse=True)[1]
    sources = error_sources(s.config, Flight(observe(campaign), campaign, number))
    L, n = len(known.landmarks.ids), len(campaign.landmarks.ids) - len(known.landmarks.ids)
    if on is not None:
        of = np.concatenate([on.site, np.zeros(n, dtype=np.int64)])
        sources = tuple(by_site(source, s.config, of) for source in sources)
    sources = tuple(_of_surveyed(source, L) for source in sources)
    return Scenario.of(campaign, (*sources, _places(L, n)), description=s.config.scenario.description)


def _tied(bare: Campaign, sites: Sites, site: Index) -> Campaign:
    """The images with the tie points of their sites alone."""
    places, of = [], np.unique(site)
    for k in of.tolist():
        places.append(_square(bare, np.flatnonzero(site == k), sites, k))
    each = ACROSS**2
    image = np.repeat(np.arange(site.size), each)
    landmark = (each * np.searchsorted(of, site)[:, None] + np.arange(each)).reshape(-1)
    return scene.mark_pairs(bare, np.concatenate(places), image, landmark, UNSTATED)


def _square(bare: Campaign, images: Index, sites: Sites, k: int) -> Array:
    """Places (ACROSS^2, 3) around a site, over the middle of its images."""
    columns, rows = (float(size) - 1.0 for size in bare.camera.size_px)
    latitude, longitude, height = float(sites.latitude[k]), float(sites.longitude[k]), float(sites.height[k])
    edges = [(0.5 * columns, 0.0), (0.5 * columns, rows), (0.0, 0.5 * rows), (columns, 0.5 * rows)]
    at = [
        locate(bare, bare.C_EK, images, np.full(images.size, c), np.full(images.size, r), height)
        for c, r in edges
    ]
    away = np.stack(at, axis=1) - geodetic_to_itrf(latitude, longitude, height)
    reach = np.linalg.norm((away @ C_JT(latitude, longitude))[..., :2], axis=-1)
    side = MIDDLE / np.sqrt(2.0) * float(np.min(reach)) * np.linspace(-1.0, 1.0, ACROSS)
    east, north = np.meshgrid(side, side)
    offsets = np.stack([east.reshape(-1), north.reshape(-1)], axis=-1)
    return scene.site_grid(latitude, longitude, height, offsets)


def _joined(known: Campaign, tied: Campaign) -> Campaign:
    """One campaign of the surveyed markers and the tie points."""
    L = len(known.landmarks.ids)
    landmarks = Landmarks(
        (*known.landmarks.ids, *(f"tie{i + 1:03d}" for i in range(len(tied.landmarks.ids)))),
        np.concatenate([known.landmarks.r_J, tied.landmarks.r_J]),
        np.concatenate([known.landmarks.covariance_J, tied.landmarks.covariance_J]),
    )
    more = replace(tied.sightings, landmark=tied.sightings.landmark + L)
    return replace(known, landmarks=landmarks, sightings=Sightings.joined([known.sightings, more]))


def _of_surveyed(source: Source, L: int) -> Source:
    """A survey has errors of the first L landmarks only."""
    if source.field != "pi_J":
        return source
    pattern = source.pattern.copy()
    pattern[..., L:, :, :] = 0.0
    return replace(source, pattern=pattern)


def _places(L: int, n: int) -> Source:
    """That of the n tie points after the L surveyed landmarks nothing is known."""
    pattern = np.concatenate([np.zeros((L, 3, 3)), np.tile(np.eye(3), (n, 1, 1))])
    words, labels = "place of a tie point, shared by its images", ("x", "y", "z")
    sigma = np.full(3, UNKNOWN_M)
    return Source(
        "tie points", words, "pi_J", pattern, np.arange(L + n), np.arange(3), sigma, labels, UNIT_METRE
    )
