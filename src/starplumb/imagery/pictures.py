"""What is kept of a chip for the eye."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Picture:
    """A chip: the ``reference`` as it was predicted and the raw ``window`` (n, n); what the match left, ``residual``,
    with its ``weight``; the correlation ``surface`` (k, k) around the place that was predicted, in steps of a pixel,
    with its ``peak`` (2,), x and y from its middle; ``covariance_px2`` (2, 2).  None for what there is not."""

    image_id: str
    landmark_id: str
    reference: Image | None
    window: Image
    residual: Image | None = None
    weight: Image | None = None
    surface: Image | None = None
    peak: tuple[float, float] | None = None
    covariance_px2: tuple[tuple[float, float], tuple[float, float]] | None = None
