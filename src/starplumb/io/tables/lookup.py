"""Names to their places in a list, a million at a time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

Index = NDArray[np.int64]

WORTHWHILE = 1 << 16
"""Known names from which on PyArrow, where it is installed, is quicker than a dictionary, which no cache then holds."""


def places(names: Sequence[str], known: Sequence[str]) -> Index:
    """Place (n,) of each of n names among the known ones, which are distinct; -1 for one that is not among them."""
    if len(known) >= WORTHWHILE:
        try:
            return by_arrow(names, known)
        except ImportError:
            pass
    return by_dictionary(names, known)


def by_dictionary(names: Sequence[str], known: Sequence[str]) -> Index:
    """``places`` by Python's own hash table."""
    place = dict(zip(known, range(len(known)), strict=True))
    return np.fromiter(map(place.get, names, repeat(-1)), dtype=np.int64, count=len(names))


def by_arrow(names: Sequence[str], known: Sequence[str]) -> Index:
    """``places`` by PyArrow's. Raises ImportError without it."""
    import pyarrow
    from pyarrow import compute

    text = pyarrow.large_string()
    found = compute.index_in(pyarrow.array(names, text), value_set=pyarrow.array(known, text))
    return np.asarray(found.fill_null(-1).to_numpy(), dtype=np.int64)
