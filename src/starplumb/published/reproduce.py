"""All published tables by name, recomputed on request."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from .. import __version__
from ..physics.errors import ArgumentError, InputError, did_you_mean
from .comparison import Comparison
from .lebedev2012 import sensitivity, totals
from .lebedev_images import images_max, images_sigma
from .lebedev_projective import algorithm1
from .tables import NAMES
from .tkachenko2019 import changes, first_correction, residuals

SCHEMA = "starplumb-reproduce/1"
MARK = ("reproduce.json", SCHEMA)
MIN_TRIALS = 200
"""Two series of the 100 runs of which each figure of the paper stems."""


def table1(trials: int, rng: np.random.Generator) -> Comparison:
    return residuals("table1", "two_images", trials, rng)


def table2(trials: int, rng: np.random.Generator) -> Comparison:
    return residuals("table2", "one_image", trials, rng)


TABLES: dict[str, Callable[[int, np.random.Generator], Comparison]] = {
    "table1": table1,
    "table2": table2,
    "table3": first_correction,
    "table4": changes,
    "sensitivity": sensitivity,
    "totals": totals,
    "algorithm1": algorithm1,
    "images-sigma": images_sigma,
    "images-max": images_max,
}
"""How each table of ``tables.NAMES`` is recomputed, with a number of runs and a generator."""


def reproduce(names: Iterable[str], trials: int, seed: int) -> Iterator[Comparison]:
    """Recompute the named tables, one after the other; each draws from a generator of its own, keyed by seed and name.

    Raises InputError for a name that no table has, and for too few runs.
    """
    wanted = list(names) or list(TABLES)
    unknown = [name for name in wanted if name not in TABLES]
    if unknown:
        hint = did_you_mean(unknown[0], TABLES)
        raise InputError(
            f"reproduce: found the table {unknown[0]!r}, wanted one of {', '.join(TABLES)}{hint}"
        )
    if trials < MIN_TRIALS:
        raise ArgumentError(
            "trials", f"found {trials}, wanted {MIN_TRIALS} or more (they come in series of 100)"
        )
    for name in wanted:
        yield TABLES[name](trials, np.random.default_rng([seed, list(NAMES).index(name)]))


def verdicts(comparisons: Iterable[Comparison]) -> Counter[str]:
    """How many rows got each verdict."""
    return Counter(row.verdict for table in comparisons for row in table.rows if row.verdict is not None)


def document(comparisons: Iterable[Comparison], trials: int, seed: int) -> dict[str, Any]:
    """``reproduce.json``."""
    tables = list(comparisons)
    return {
        "schema": SCHEMA,
        "trials": trials,
        "seed": seed,
        "verdicts": dict(verdicts(tables)),
        "tables": [table.document() for table in tables],
        "software": {"starplumb": __version__},
    }
