"""What may not stand side by side in an archive: sightings that would count twice, one landmark at two places."""

from __future__ import annotations

import sqlite3

import numpy as np

from ...mission.joint import CAMERA
from ...physics.errors import InputError
from .rows import NewCampaign

SAME_PLACE_M = 1e-3
"""Places of one landmark in two campaigns may differ by so much and still be the same."""
_SEVERAL = "EXISTS(SELECT 1 FROM unknown u WHERE u.campaign = c.id AND u.name GLOB 'mounting[[]*')"
_STANDS = "c.status IN ('ok', 'weak') AND NOT EXISTS(SELECT 1 FROM withdrawn w WHERE w.campaign = c.id)"


def known(database: sqlite3.Connection, campaign: NewCampaign) -> bool:
    """Whether a campaign is there already.

    Raises InputError where it was withdrawn, and where it cannot stand beside another one.
    """
    same = database.execute(
        "SELECT w.reason FROM campaign c LEFT JOIN withdrawn w ON w.campaign = c.id WHERE c.id = ?",
        (campaign.id,),
    ).fetchone()
    if same is not None:
        if same[0] is not None:
            raise InputError(
                f"campaign {campaign.name!r}: found it withdrawn ({same[0]}); what is withdrawn stays so, "
                "wanted other inputs or options"
            )
        return True
    if campaign.status in ("ok", "weak"):
        _require_other_inputs(database, campaign)
        _require_other_sightings(database, campaign)
        _require_one_place(database, campaign)
    return False


def _require_other_inputs(database: sqlite3.Connection, campaign: NewCampaign) -> None:
    found = database.execute(
        "SELECT c.id, c.method FROM campaign c WHERE c.inputs = ? AND c.satellite = ? AND c.frame_from = ? "
        f"AND c.frame_to = ? AND {_STANDS}",
        (campaign.inputs_id, *campaign.instrument.key),
    ).fetchone()
    if found is not None:
        raise InputError(
            f"campaign {campaign.name!r}: found the same inputs as {found[0][:12]} ({found[1]}), with other options; "
            f"they would count twice, wanted {found[0][:12]} withdrawn first"
        )


def _require_other_sightings(database: sqlite3.Connection, campaign: NewCampaign) -> None:
    satellite, camera, tracker = campaign.instrument.key
    several = any(name.startswith(CAMERA) for name, *_ in campaign.unknowns)
    for image in campaign.images:
        found = database.execute(
            "SELECT c.id, c.name FROM image i JOIN campaign c ON c.id = i.campaign "
            "WHERE i.t_ns = ? AND i.sightings = ? AND c.satellite = ? AND c.frame_to = ? "
            f"AND (c.frame_from = ? OR {_SEVERAL} OR ?) AND {_STANDS}",
            (image.t_ns, image.sightings, satellite, tracker, camera, several),
        ).fetchone()
        if found is not None:
            raise InputError(
                f"campaign {campaign.name!r}: found the sightings of image {image.image_id} in {found[0][:12]} "
                f"({found[1]}) too; they would count twice, wanted {found[0][:12]} withdrawn first"
            )


def _require_one_place(database: sqlite3.Connection, campaign: NewCampaign) -> None:
    """The landmarks of a satellite: one place and one survey under one id."""
    for name, _, reference, _, covariance in campaign.unknowns:
        if not name.startswith("landmark[") or covariance is None:
            continue
        found = database.execute(
            "SELECT u.reference, u.covariance, c.id, c.name FROM unknown u JOIN campaign c ON c.id = u.campaign "
            f"WHERE u.name = ? AND c.satellite = ? AND {_STANDS} LIMIT 1",
            (name, campaign.instrument.satellite),
        ).fetchone()
        if found is None:
            continue
        place, P = np.frombuffer(found[0], "<f8"), np.frombuffer(found[1], "<f8").reshape(3, 3)
        away = float(np.linalg.norm(place - reference))
        if away > SAME_PLACE_M:
            raise InputError(
                f"campaign {campaign.name!r}: found {name} {away:.3g} m from where {found[2][:12]} ({found[3]}) has "
                "it; wanted one place under one id, another id for another marker"
            )
        if not np.allclose(P, covariance, rtol=1e-6, atol=1e-9):
            raise InputError(
                f"campaign {campaign.name!r}: found {name} with other sigmas of its survey than {found[2][:12]} "
                f"({found[3]}) states; wanted one survey under one id"
            )
