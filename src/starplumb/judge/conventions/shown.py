"""What the files of a campaign show of themselves, as mistakes that no residual needs to tell."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from ...estimators.campaign_table import table_of
from ...estimators.gls import Gls
from ...estimators.protocol import Status
from ...physics.errors import InputError
from ...table.campaign import Campaign
from ..files.digits import with_rounding
from ..files.findings import findings_of_files
from .mistake import Mistake

WORDS = {
    "digits": ("digits", "the numbers of a table have too few digits for the stated sigmas"),
    "sampling": ("sampling", "the attitude is sampled too coarsely for the motion"),
    "scatter": ("sampling", "the samples of the attitude scatter by more than its stated sigma"),
    "sample": ("sample", "a sample of the attitude contradicts its neighbours"),
    "trackers": ("tracker", "the star trackers contradict each other"),
    "horizon": ("horizon", "landmarks lie below the horizon of their image"),
    "same place": ("places", "a place is listed under several ids"),
}
"""Of each kind of evidence: the kind of mistake it is, and the mistake in words."""


def shown_by_files(campaign: Campaign, told: Collection[str]) -> Iterator[Mistake]:
    """What weakens the answer of the campaign as it stands, but for the kinds that are ``told`` already."""
    with np.errstate(all="ignore"):
        try:
            o = table_of(campaign)
            estimate = Gls()(o, campaign.C_EK)
        except (InputError, np.linalg.LinAlgError):
            return
        if not Status(int(estimate.status)).usable or estimate.covariance_E is None:
            return
        found = findings_of_files(campaign, o, estimate.C_EK, estimate.covariance_E)
    for evidence in found:
        kind, what = WORDS.get(evidence.kind, ("", ""))
        if kind and kind not in told and (evidence.weakens or evidence.refuses):
            mistake = Mistake(f"{kind}.files", what, evidence.remedy, evidence=evidence.sentence)
            yield replace(mistake, undo=with_rounding) if kind == "digits" else mistake
