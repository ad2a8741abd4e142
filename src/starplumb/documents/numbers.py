"""Arrays as JSON can say them."""

from __future__ import annotations

from typing import Any

import numpy as np


def numbers(values: Any) -> Any:
    """Nested lists of floats; a number that is not finite becomes None, which JSON can say."""
    array = np.asarray(values, dtype=np.float64)
    finite = np.isfinite(array)
    if finite.all():
        return array.tolist()
    said = array.astype(object)
    said[~finite] = None
    return said.tolist()
