"""``starplumb check``: everything read and checked, nothing solved."""

from __future__ import annotations

from ..options.common import CampaignArgument
from ..options.outside import Choice, OutsideOption
from ..output import Json, Output, Quiet, Verbose


def check(
    campaign: CampaignArgument,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Read and check a campaign without solving anything: exit status 0 where it can be calibrated, 2 where not.

    Spans and gaps of orbit and attitude, frames, rates, counts, which markers are seen, the digits of the numbers
    against the stated sigmas, and how far the model mounting misses its marks.

    Examples:

      \b
      starplumb check campaign.toml

      \b
      starplumb check campaign.toml --json
    """
    from ...session.campaign import read_campaign
    from ...session.check import check as run

    speak = Output(json, quiet, verbose)
    found = run(read_campaign(campaign, outside.value))
    speak.notices(found.document["notices"])
    speak.document(found.document)
    speak.show(*map(speak.table, found.tables), *found.told)
    speak.detail(*(f"{name}: {digest}" for name, digest in found.document["inputs"].items()))
    found.raise_if_unusable()
