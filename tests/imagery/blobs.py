"""Ground whose every blur is known in closed form: a sum of Gaussian hills."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Blobs:
    """Hills at ``place`` (n, 2) of width ``width`` (n,) pixels and height ``height`` (n,)."""

    place: np.ndarray
    width: np.ndarray
    height: np.ndarray

    @classmethod
    def draw(cls, rng, extent_px=90.0, count=160):
        place = rng.uniform(-0.5 * extent_px, 0.5 * extent_px, (count, 2))
        return cls(place, rng.uniform(1.2, 6.0, count), rng.normal(0.0, 1.0, count))

    def at(self, x, y, blur_px=0.0):
        """The ground at places (...) seen under a Gaussian of this width."""
        width2 = self.width**2 + blur_px**2
        r2 = (x[..., None] - self.place[:, 0]) ** 2 + (y[..., None] - self.place[:, 1]) ** 2
        return np.exp(-0.5 * r2 / width2) @ (self.height * self.width**2 / width2)

    def on(self, n, step=1.0, place=(0.0, 0.0)):
        """The ground on a grid (n, n) around a middle from which its origin lies at ``place``: hills are products."""
        along = (np.arange(n) - 0.5 * (n - 1)) * step
        x, y = (
            np.exp(-0.5 * ((along[:, None] - place[i] - self.place[:, i]) / self.width) ** 2) for i in (0, 1)
        )
        return (self.height * y) @ x.T

    def slopes(self, x, y):
        """d/dx and d/dy at places (...)."""
        dx, dy = x[..., None] - self.place[:, 0], y[..., None] - self.place[:, 1]
        hill = self.height * np.exp(-0.5 * (dx**2 + dy**2) / self.width**2) / self.width**2
        return -np.sum(hill * dx, axis=-1), -np.sum(hill * dy, axis=-1)


def grid(n, step=1.0):
    """Places x, y (n, n) around the middle."""
    y, x = (np.mgrid[:n, :n] - 0.5 * (n - 1)) * step
    return x, y
