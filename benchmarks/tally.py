"""Campaigns of every case of a benchmark, a row of its table each."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

Case = TypeVar("Case")


def tally(
    doc: str | None,
    header: str,
    cases: Sequence[Case],
    run: Callable[[Case, int, np.random.Generator], str],
) -> None:
    """Print the table: ``--campaigns`` of each case, drawn from ``--seed`` and the number of the case."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("--campaigns", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    print(header + "\n|" + "---|" * (header.count("|") - 1))
    for number, case in enumerate(cases):
        print(run(case, arguments.campaigns, np.random.default_rng([arguments.seed, number])), flush=True)
