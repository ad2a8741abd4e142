"""Campaigns of one mission, written as files: one site seen again and again, a mounting that may move between them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from problems import C_EK_TRUE, FRAME, truth
from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.series import Ephemeris
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.table.campaign import Campaign, some_of
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

DAY_NS = 86_400 * 10**9
MODEL = so3.exp(np.array([0.3, -0.2, 0.4]) * np.pi / 180.0) @ C_EK_TRUE


def whole(rng, images: int = 6, markers: int = 9, **options) -> Campaign:
    """One campaign of a site, measured."""
    true = truth(FRAME, images, markers, shared_site=True, **{"tilt_deg": 15.0, "yaw_deg": 60.0, **options})
    return earth_fixed(scene.measured(true, Errors.draw(observe(true), rng), MODEL))


def earth_fixed(campaign: Campaign) -> Campaign:
    """The same with its attitude from the Earth's axes, so that its files need no orientation of the Earth."""
    attitude = campaign.one_attitude
    C_EJ, _ = attitude.at(attitude.t_ns)
    fixed = replace(attitude, q_EF=so3.to_quaternion(C_EJ), frame="ITRF", orientation=None)
    return replace(campaign, attitude=fixed, orientation=None)


def part(campaign: Campaign, chosen: list[int], name: str) -> Campaign:
    """Some images of a campaign with their sightings."""
    s, images = campaign.sightings, campaign.images
    kept = np.isin(s.image, chosen)
    sightings = some_of(s, kept)
    sightings = replace(sightings, image=np.searchsorted(chosen, sightings.image))
    few = replace(images, ids=tuple(images.ids[i] for i in chosen), t_ns=images.t_ns[chosen])
    return replace(campaign, name=name, images=few, sightings=sightings)


def later(campaign: Campaign, days: float) -> Campaign:
    """The same scene so many days later: all of it is Earth-fixed, so that nothing else changes."""
    shift = round(days * DAY_NS)
    attitude = replace(campaign.one_attitude, t_ns=campaign.one_attitude.t_ns + shift)
    ephemeris = replace(campaign.ephemeris, t_ns=campaign.ephemeris.t_ns + shift)
    assert isinstance(ephemeris, Ephemeris)
    images = replace(campaign.images, t_ns=campaign.images.t_ns + shift)
    return replace(campaign, attitude=attitude, ephemeris=ephemeris, images=images)


def mission(
    rng, folder: Path, days: list[float], moved_arcsec: np.ndarray | None = None, images: int = 3, **options
) -> list[Path]:
    """``campaign.toml`` of campaigns of one surveyed site on so many days, the mounting turned by ``moved_arcsec``
    (n, 3) at each."""
    true = truth(FRAME, images, 9, shared_site=True, **{"tilt_deg": 15.0, "yaw_deg": 60.0, **options})
    table = observe(true)
    site = Errors.draw(table, rng).pi_J
    paths = []
    for k, day in enumerate(days):
        errors = replace(Errors.draw(table, rng), pi_J=site)
        if moved_arcsec is not None:
            # an attitude that is off by exp(a) shows a mounting of exp(a) C_EK_TRUE
            errors = replace(errors, alpha_E=errors.alpha_E + moved_arcsec[k] * ARCSEC)
        found = later(earth_fixed(scene.measured(true, errors, MODEL)), day)
        named = replace(found, name=f"day {day:g}")
        paths.append(write_campaign(folder / f"c{k}", named, tracker="star_tracker"))
    return paths


@contextmanager
def without_triggers(database: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    """Rows can be changed within; the tables are then as they were."""
    triggers = database.execute("SELECT name, sql FROM sqlite_master WHERE type = 'trigger'").fetchall()
    for name, _ in triggers:
        database.execute(f"DROP TRIGGER {name}")
    yield database
    for _, sql in triggers:
        database.execute(sql)


@contextmanager
def tampered(path: Path) -> Iterator[sqlite3.Connection]:
    """The database of an archive for one who changes what is there."""
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("PRAGMA ignore_check_constraints=ON")
        with without_triggers(database):
            yield database
