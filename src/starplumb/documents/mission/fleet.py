"""``fleet.json``: many campaigns, and the satellites that they are of."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..document import Document, Number, Numbers3, Part


class FleetCampaign(Part):
    """What came of a campaign: ``result`` is the folder of its result, null where there is none; ``archived`` null
    where no archive was asked for."""

    campaign: str
    status: str
    message: str
    result: str | None
    resumed: bool
    archived: bool | None
    failed: bool
    id: str | None = None


class FleetSatellite(Part):
    """A mounting as seen from the time of the latest campaign of all: the rms error across the line of sight over the
    30 days from then of the one in use (of the foretold one where none was issued), its age, sigma, what to do; the
    surest change, and the last campaigns about the axis that moved most."""

    satellite: str
    from_: str = Field(alias="from")
    to: str
    campaigns: int
    last: str
    age_days: float
    loss_m: Number
    loss_arcsec: float
    issued: bool
    sigma_arcsec: Numbers3
    change: str | None
    change_p: Number
    action: Literal["keep", "issue", "calibrate"]
    calibrate_by: str | None
    recent_arcsec: list[float]


class FleetDocument(Document):
    """What ``starplumb calibrate`` prints of several campaigns, satellites with the largest expected loss first."""

    schema_: Literal["starplumb-fleet/1"] = Field(alias="schema")
    archive: str | None
    campaigns: list[FleetCampaign]
    satellites: list[FleetSatellite]
