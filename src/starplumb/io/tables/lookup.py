"""Places of names in a list, fast for a million of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from .arrow import TextColumn


def places(names: Sequence[str], known: Sequence[str]) -> NDArray[np.int64]:
    """Place (n,) of each of n names among the known ones, which are distinct; -1 for one that is not among them."""
    if isinstance(names, TextColumn):
        return names.places(known)
    place = dict(zip(known, range(len(known)), strict=True))
    return np.fromiter(map(place.get, names, repeat(-1)), dtype=np.int64, count=len(names))
