"""The table of a campaign with every error that it states, those that images share included."""

from __future__ import annotations

from ..table.campaign import Campaign
from ..table.geometry import observe
from ..table.observations import Observations
from ..table.sharing import with_shared
from .wahba import Wahba


def table_of(campaign: Campaign) -> Observations:
    """:func:`starplumb.table.geometry.observe`, and what several sightings share, as it acts at the closed form.

    Raises EpochError where an exposure lies outside orbit or attitude, InputError for more shared errors than fit.
    """
    o = observe(campaign)
    return with_shared(campaign, o, lambda: Wahba()(o, campaign.C_EK).C_EK)
