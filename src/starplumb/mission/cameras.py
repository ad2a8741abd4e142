"""A campaign of several cameras from where one of them stands: what is said of its mounting is said of any of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.units import ARCSEC
from .joint import CAMERA, MOUNTING, Equations, Known

Array = NDArray[np.float64]


def block_of(camera: str) -> str:
    """The block of a further camera's mounting."""
    return f"{CAMERA}{camera}]"


def about_camera(part: Equations, first: str, camera: str, widest: float) -> Equations:
    """The equations with another camera's mounting as *the* mounting, that of the ``first`` one being a further one's;
    of a campaign without that camera all are further ones'.

    What was known of the first one's mounting beforehand is left out but for ``widest`` (rad), how far off it can be at
    all.
    """
    if camera == first:
        return part
    own, zero = block_of(camera), np.zeros(3)
    blocks, C_EK = {}, part.C_EK
    for name, known in part.blocks.items():
        if name == MOUNTING:
            v = so3.log(part.C_EK) / ARCSEC
            blocks[block_of(first)] = Known(v, v, (widest / ARCSEC) ** 2 * np.eye(3))
        elif name == own:
            blocks[MOUNTING], C_EK = Known(zero, zero, None), so3.exp(ARCSEC * known.reference)
        else:
            blocks[name] = known
    called = {MOUNTING: block_of(first), own: MOUNTING}
    together = part.together
    if together is not None:
        together = replace(together, names=tuple(called.get(name, name) for name in together.names))
    return replace(part, C_EK=C_EK, blocks=blocks, together=together)
