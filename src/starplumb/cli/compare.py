"""``starplumb compare``: every method on one campaign, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options.common import CampaignArgument, StartOption
from .options.outside import Choice, OutsideOption
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose


def compare(
    campaign: CampaignArgument,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder that receives compare.json.")
    ] = None,
    start: StartOption = "closed-form",
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """All methods on one campaign: correction, sigma, difference from gls, time, and what each leaves out.

    Examples:

      starplumb compare demo/campaign.toml

      starplumb compare campaign.toml --json --out results
    """
    from ..session.campaign import read_campaign
    from ..session.comparison import MARK
    from ..session.comparison import compare as run

    speak = Output(json, quiet, verbose)
    found = read_campaign(campaign, outside.value)
    if out is not None:
        require_place(out, [MARK[0]], found.loaded.sources, MARK)
    comparison = run(found, lambda answers, total: speak.watched(answers, "Comparing", total), start)
    speak.notices(found.notices)
    if out is not None:
        comparison.save(out)
    speak.document(comparison.document)
    speak.shown(comparison, *([] if out is None else [f"written: {out / 'compare.json'}"]))
    comparison.raise_if_unusable()
