"""Orientation correlation: where a piece of ground lies in an image, whatever the light, season and band of either.

Each pixel becomes its gradient with doubled angle, ``q = (g_x + i g_y)^2 / max(|g|^2, median |g|^2)``: a contrast that
is reversed is the same contrast, and a strong edge (a cloud's) weighs no more than a field's.  The correlation of two
such images is 1 where they agree and about 0 elsewhere.

Source: A. J. Fitch et al., Orientation correlation, British Machine Vision Conference (2002).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SCALE_PX = 1.0
"""Width of the Gaussian under which gradients are taken."""
RIM_PX = 3
"""Pixels at the border of an image whose gradients see beyond it."""


def orientation(image: Array, scale_px: float = SCALE_PX) -> Complex:
    """Orientations (h, w) of the gradients of an image (h, w), doubled, of strength 1 at most; 0 near pixels without
    data (NaN)."""
    from scipy.ndimage import binary_dilation, gaussian_filter

    known = np.isfinite(image)
    if not known.any():
        return np.zeros(image.shape, dtype=np.complex128)
    level = float(np.median(image[known]))
    filled = np.where(known, image, level) - level
    g = gaussian_filter(filled, scale_px, order=(0, 1)) + 1j * gaussian_filter(filled, scale_px, order=(1, 0))
    good = known if known.all() else ~binary_dilation(~known, iterations=int(np.ceil(3.0 * scale_px)))
    strength = g.real**2 + g.imag**2
    if not good.any() or not (limit := float(np.median(strength[good]))) > 0.0:
        limit = float(np.finfo(np.float64).tiny) + float(strength.max())
    return np.asarray(np.where(good, g**2 / np.maximum(strength, limit), 0.0), dtype=np.complex128)


def correlation(search: Complex, chip: Complex) -> Array:
    """Correlation of a chip (h, w) of orientations at every place wholly inside a search area (H, W).

    (H - h + 1, W - w + 1), normalised by the strength of both, as far as the chip reaches at each place: within -1 and
    1 whatever part of either has no data; 0 where less than a tenth of the chip meets data.
    """
    from scipy.fft import fft2, ifft2, irfft2, next_fast_len, rfft2

    H, W = search.shape
    h, w = chip.shape
    shape = [next_fast_len(H), next_fast_len(W)]
    inside = slice(0, H - h + 1), slice(0, W - w + 1)
    met = np.real(ifft2(fft2(search, shape) * np.conj(fft2(chip, shape))))[inside]

    def summed(a: Array, b: Array) -> Array:
        return np.asarray(irfft2(rfft2(a, shape) * np.conj(rfft2(b, shape)), shape)[inside])

    there, here = np.abs(search) ** 2, np.abs(chip) ** 2
    of_search = summed(there, (here > 0.0).astype(np.float64))
    of_chip = summed((there > 0.0).astype(np.float64), here)
    power = np.sqrt(np.maximum(of_search * of_chip, 0.0))
    enough = of_chip > 0.1 * max(float(here.sum()), 1e-12)
    return np.asarray(np.where(enough, met / np.maximum(power, 1e-12), 0.0))


def agreement(one: Complex, other: Complex, scale_px: float = 4.0) -> Array:
    """How well two images of orientations (h, w) agree around each pixel: 1 for the same, about 0 for unlike."""
    from scipy.ndimage import gaussian_filter

    met = gaussian_filter(np.real(one * np.conj(other)), scale_px, mode="nearest")
    power = gaussian_filter(np.abs(one * other), scale_px, mode="nearest")
    return np.asarray(met / np.maximum(power, 1e-6))
