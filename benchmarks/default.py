"""Of how many good campaigns does the default give the answer of `gls`, and what does it cost?

    python benchmarks/default.py --campaigns 1000 --seed 40000

Campaigns as `planted_faults.py` draws them: orbit, camera, passes, sampling, markers and sigmas all vary, 1 to 30
images.  The two answers are the same where they are nearer than a millionth of a sigma.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from planted_faults import deliver, drawn

from starplumb.estimators.campaign_table import table_of
from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.physics import so3

SAME = 1e-6


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--campaigns", type=int, default=1000)
    options.add_argument("--seed", type=int, default=40000)
    asked = options.parse_args()
    spent, other = np.zeros(2), []
    for number in range(asked.campaigns):
        campaign = deliver(drawn(np.random.default_rng([asked.seed, number])))
        table = table_of(campaign).select(~campaign.sightings.check)
        answers = []
        for k, method in enumerate((Gls(), Default())):
            start = time.process_time()
            answers.append(method(table, campaign.C_EK))
            spent[k] += time.process_time() - start
        plain, found = answers
        apart = so3.log(found.C_EK @ plain.C_EK.mT) / plain.sigma_E
        if not np.max(np.abs(apart)) < SAME:
            other.append(f"{number} ({np.max(np.abs(apart)):.2g} sigma)")
    same, cost = asked.campaigns - len(other), spent[1] / spent[0]
    print(f"{same} of {asked.campaigns} have the answer of gls, at {cost:.2f} times its cost")
    print(f"others: {', '.join(other) or 'none'}")


if __name__ == "__main__":
    main()
