"""Where the campaign was: its sites on a map with coastlines, and what is left over at each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...judge.calibrate import Calibration
from ...judge.residuals import rms
from ...physics.earth import itrf_to_geodetic
from ...physics.units import DEG
from ..charts.chart import Dots, Mark
from ..land import coast, region
from ..page import Figure, Table
from ..plots import Vectors, vectors
from ..text import counted, length, number

Array = NDArray[np.float64]
Index = NDArray[np.int64]

APART = 100e3
"""Metres from the first image of a site within which an image is of the same."""
LISTED = 40


@dataclass(frozen=True)
class Site:
    """Sightings in the solution whose images lie together: ``rows`` (k,), the centre, rad, and how many images."""

    rows: Index
    latitude: float
    longitude: float
    images: int

    @property
    def place(self) -> str:
        return (
            f"{abs(self.latitude / DEG):.2f}° {'N' if self.latitude >= 0.0 else 'S'}, "
            f"{abs(self.longitude / DEG):.2f}° {'E' if self.longitude >= 0.0 else 'W'}"
        )


def sites(c: Calibration) -> tuple[Site, ...]:
    """Images in the order of the campaign, each to the first site near it or to a new one."""
    s, used, r_J = c.campaign.sightings, c.residuals.used, c.campaign.landmarks.r_J
    rows_of: list[list[Index]] = []
    centres: list[Array] = []
    for image in np.unique(s.image[used]):
        rows = np.flatnonzero(used & (s.image == image))
        centre = r_J[s.landmark[rows]].mean(axis=0)
        near = [k for k, other in enumerate(centres) if np.linalg.norm(centre - other) < APART]
        if near:
            rows_of[near[0]].append(rows)
        else:
            centres.append(centre)
            rows_of.append([rows])
    return tuple(_site(c, rows) for rows in rows_of)


def _site(c: Calibration, parts: list[Index]) -> Site:
    rows = np.concatenate(parts)
    centre = c.campaign.landmarks.r_J[c.campaign.sightings.landmark[rows]].mean(axis=0)
    latitude, longitude, _ = itrf_to_geodetic(centre)
    return Site(rows, float(latitude), float(longitude), len(parts))


def site_map(c: Calibration, found: tuple[Site, ...]) -> tuple[Figure, ...]:
    """The sites with the mean error on the ground that is left at each."""
    if not found:
        return ()
    longitude = np.unwrap(np.array([site.longitude for site in found])) / DEG
    places = np.stack([longitude, np.array([site.latitude for site in found]) / DEG], axis=-1)
    means = np.array([np.mean(c.residuals.after_m[site.rows], axis=0) for site in found])
    read = [
        f"{site.place}: {length(float(np.hypot(*mean)))} of {counted(site.rows.size, 'sighting')} in "
        f"{counted(site.images, 'image')}"
        for site, mean in zip(found, means, strict=True)
    ]
    west, east, south, north = region(places)
    known = means[np.all(np.isfinite(means), axis=-1)]
    text = (
        f"The {counted(len(found), 'site')} with the mean error on the ground that is left at each after "
        f"the calibration: {length(rms(known))} rms per axis. Coastlines: Natural Earth."
    )
    under: tuple[Mark, ...] = (
        *coast(west, east, south, north),
        Dots(places[:, 0], places[:, 1], "one", filled=True, tips=read),
    )
    labels = ("longitude, deg", "latitude, deg")
    figure = vectors("sites", [Vectors("", places, means, read)], labels, "m", text, text, ground=under)
    (chart,) = figure.charts
    x, y = replace(chart.x, low=west, high=east), replace(chart.y, low=south, high=north)
    return (replace(figure, chart=replace(chart, x=x, y=y)),)


def site_table(c: Calibration, found: tuple[Site, ...]) -> tuple[Table, ...]:
    """What is left at each site; nothing where there is only one."""
    if len(found) < 2:
        return ()
    rows = [_row(c, site) for site in found[:LISTED]]
    left = len(found) - len(rows)
    note = f"An image is of a site where it lies within {APART / 1e3:.0f} km of its first image." + (
        f" {left} more sites are left out here." if left else ""
    )
    head = ("site", "images", "sightings", "mean east, m", "mean north, m", "rms, px", "own rms, px")
    return (Table("Sites", head, rows, note=note),)


def _row(c: Calibration, site: Site) -> tuple[str, ...]:
    r = c.residuals
    east, north = np.mean(r.after_m[site.rows], axis=0)
    sizes = (number(rms(px[site.rows])) for px in (r.after_px, r.fit_px))
    return (
        site.place,
        str(site.images),
        str(site.rows.size),
        number(float(east)),
        number(float(north)),
        *sizes,
    )
