"""Units at the edge: multiply by these to come inside (SI, radians), divide to go out."""

from __future__ import annotations

from math import pi

DEG = pi / 180.0
ARCMIN = DEG / 60.0
ARCSEC = DEG / 3600.0
MM = 1e-3
UM = 1e-6

C_LIGHT = 299_792_458.0
"""Speed of light, m/s (exact)."""

LEAST_SIGMA, MOST_SIGMA = 1e-6, 1e7
"""Of a sigma in the unit that a user writes; beyond them squares and their ratios leave what doubles can add up."""
