"""Which mounting to use until the next campaign: the table of rules.

    python benchmarks/policies.py --runs 400

Each row is a kind of mission: five years, a campaign a month; the figures are the rms of the mounting in use over the
month that follows each campaign.  Significance decides worst: it waits until an error is large.
"""

from __future__ import annotations

import argparse

import numpy as np

from starplumb.mission.policies import Mission, compared

ROWS = (
    Mission(1.0, 0.0, 0.0, 0),
    Mission(1.0, 0.3, 0.0, 0),
    Mission(1.0, 0.3, 1.5, 1),
    Mission(3.0, 0.3, 1.5, 1),
    Mission(0.5, 0.5, 3.0, 2),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    rules = "first | newest | newest if significant | mean | issued"
    print(f'| sigma of a campaign | walk a month | yearly | jumps of 5" | {rules} |')
    print("|---|---|---|---|---|---|---|---|---|")
    for k, kind in enumerate(ROWS):
        found = compared(kind, np.random.default_rng([arguments.seed, k]), arguments.runs)
        figures = " | ".join(f'{value:.2f}"' for value in found.values())
        print(f'| {kind.sigma}" | {kind.walk}" | {kind.yearly}" | {kind.jumps} | {figures} |', flush=True)


if __name__ == "__main__":
    main()
