"""What becomes of campaigns with planted faults, and of good ones, in the hands of a user.

    python benchmarks/planted.py --campaigns 8 --good 500 --seed 9000

Each campaign is drawn at random (`planted_faults.py`), written to files, read and calibrated by default.  Wrong: usable
(exit status 0) and yet off by more than twice the half-width of its 95 % interval about some axis.  Absorbed: the same,
but without any other error the fault leaves a chi-square below 10, so that no test of these residuals could find it.
Said: of those that did not end `ok`, how many messages name the cause or send to `starplumb diagnose`.  Thresholds were
set on seeds below 1000.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from planted_faults import FAULTS, GOOD, Fault

import starplumb as sp
from starplumb.physics.units import ARCSEC

TRACE = 10.0
"""Chi-square of what a fault leaves without any other error, below which no test could find it."""


@dataclass(frozen=True)
class Outcome:
    """How one campaign ended: ``status``, its ``message``, and the largest error over the interval's half-width."""

    status: str
    message: str
    over: float
    absorbed: bool = False

    @property
    def ended(self) -> str:
        if self.status not in ("ok", "weak") or self.over <= 2.0:
            return self.status
        return "absorbed" if self.absorbed else "wrong"


def outcome(fault: Fault, seed: list[int], method: str | None) -> Outcome:
    """Plant a fault in a campaign's files and calibrate these."""
    with TemporaryDirectory() as folder:
        found = calibrated(fault, Path(folder), seed, method)
    if found.ended == "wrong" and fault.absorbable:
        with TemporaryDirectory() as folder:
            fault.plant(Path(folder), np.random.default_rng(seed), exact=True)
            bare = sp.calibrate(sp.read_campaign(Path(folder) / "campaign.toml"), method="gls")
        chi2 = bare.calibration.estimate.chi2
        return replace(found, absorbed=chi2 is not None and float(chi2) < TRACE)
    return found


def calibrated(fault: Fault, folder: Path, seed: list[int], method: str | None) -> Outcome:
    """As a user does."""
    truth = fault.plant(folder, np.random.default_rng(seed))
    try:
        campaign = sp.read_campaign(folder / "campaign.toml")
        result = sp.calibrate(campaign, **({} if method is None else {"method": method}))
    except sp.InputError as error:
        return Outcome("refused", str(error), np.nan)
    half = result.interval_95_arcsec
    if not result.usable or half is None:
        return Outcome(result.status, result.message, np.nan)
    error = np.abs(truth.error_E(result.campaign.loaded.campaign, result.C_EK)) / ARCSEC
    return Outcome(result.status, result.message, float(np.max(error / half)))


def outcomes(fault: Fault, campaigns: int, seed: list[int], method: str | None) -> list[Outcome]:
    """Of so many campaigns with a fault."""
    return [outcome(fault, [*seed, number], method) for number in range(campaigns)]


def row(name: str, found: list[Outcome], said: tuple[str, ...]) -> str:
    counts = Counter(one.ended for one in found)
    counts["no answer"] = counts["refuted"] + counts["singular"] + counts["not_converged"]
    cells = [str(counts[key] or "") for key in ("ok", "weak", "no answer", "refused", "absorbed", "wrong")]
    objected = [one for one in found if one.status not in ("ok", "refused")]
    named = sum(any(word in one.message for word in (*said, "starplumb diagnose")) for one in objected)
    told = f"{named} of {len(objected)}" if said and objected else ""
    return f"| {name} | {len(found)} | {' | '.join(cells)} | {told} |"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--campaigns", type=int, default=8, help="of each fault")
    options.add_argument("--good", type=int, default=500)
    options.add_argument("--seed", type=int, default=9000)
    options.add_argument("--method")
    options.add_argument("--only", default="", help="part of the faults' names")
    options.add_argument("--list", action="store_true", help="print every campaign that is not ok")
    asked = options.parse_args()
    warnings.simplefilter("ignore")
    ends = ["right as ok", "right as weak", "no answer (exit 3)", "refused (exit 2)", "absorbed", "wrong"]
    print(f"| {' | '.join(['planted', 'campaigns', *ends, 'said'])} |\n|{'---|' * 9}")
    start, total = time.process_time(), []
    for kind, fault in enumerate([GOOD, *FAULTS]):
        count = asked.good if fault is GOOD else asked.campaigns
        if asked.only not in fault.name or not count:
            continue
        found = outcomes(fault, count, [asked.seed, kind], asked.method)
        print(row(fault.name, found, fault.said), flush=True)
        total += [] if fault is GOOD else found
        for number, one in enumerate(found if asked.list else []):
            if one.ended != "ok":
                print(f"    {kind} {number} {one.ended} {one.status} {one.over:.2f} {one.message}")
    print(row("all planted", total, ()))
    print(f"\n{(time.process_time() - start):.0f} CPU s")


if __name__ == "__main__":
    main()
