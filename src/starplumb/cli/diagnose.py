"""``starplumb diagnose``: which of the usual mistakes would explain the residuals."""

from __future__ import annotations

from .options.common import CampaignArgument
from .options.outside import Choice, OutsideOption
from .output import Json, Output, Quiet, Verbose


def diagnose(
    campaign: CampaignArgument,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Try the usual mistakes and say which one would explain the residuals.

    Quaternion order and direction, frames, time scales, pixels swapped, mirrored or binned, coordinates exchanged,
    heights above the geoid, units, clocks, optics, one wrong image, attitude sample or landmark: each is undone in
    turn, alone and, where one does not suffice, in pairs or with sightings left out, and the campaign calibrated again
    with all its shared errors. Nothing is written or changed.

    Examples:

      \b
      starplumb diagnose campaign.toml

      \b
      starplumb diagnose campaign.toml --json
    """
    from ..session.campaign import read_campaign
    from ..session.diagnosis import diagnose as run

    speak = Output(json, quiet, verbose)
    found = read_campaign(campaign, outside.value)
    speak.notices(found.notices)
    with speak.doing("undoing the usual mistakes, one after another"):
        diagnosis = run(found)
    speak.document(diagnosis.document)
    speak.show(speak.table(diagnosis.table(every=verbose)), *diagnosis.sentences)
