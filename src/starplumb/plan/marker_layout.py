"""Where markers lie: offsets on the ground or places in the image, laid out or drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def grid(columns: int, rows: int) -> Array:
    """Even grid over the square from -1 to 1, (columns rows, 2); a single column or row lies in the middle."""
    x, y = (np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in (columns, rows))
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def ring(count: int) -> Array:
    """Even ring of radius 1, (count, 2), the first at 45 deg so that four are the corners of a square."""
    angle = 0.25 * np.pi + 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def scattered(count: int, rng: np.random.Generator) -> Array:
    """Uniform draws from the square from -1 to 1, (count, 2)."""
    return rng.uniform(-1.0, 1.0, (count, 2))
