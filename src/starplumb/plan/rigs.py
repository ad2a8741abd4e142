"""True scenes of several cameras that image together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..table.cameras.rig import Rig
from ..table.campaign import Campaign, Landmarks, Sightings

Array = NDArray[np.float64]


def together(parts: Sequence[Campaign], names: Sequence[str], C_KC: Array, *, one_site: bool) -> Campaign:
    """One campaign of parts (k,), each of one camera by its name, with the images, attitude and orbit of the first.

    ``C_KC`` (k, 3, 3) takes coordinates from each camera's frame to that of the first.  All see the landmarks of
    ``one_site``, or each its own.
    """
    m, L = len(parts[0].images.ids), 0 if one_site else len(parts[0].landmarks.ids)
    begin = np.cumsum([0, *(len(part.landmarks.ids) for part in parts)]) * (L > 0)
    seen = [
        replace(p.sightings, image=p.sightings.image + k * m, landmark=p.sightings.landmark + begin[k])
        for k, p in enumerate(parts)
    ]
    images, of_image = parts[0].images, np.repeat(np.arange(len(parts)), m)
    period = images.line_period_s
    images = replace(
        images,
        ids=tuple(f"{image}-{name}" for name in names for image in images.ids),
        t_ns=np.tile(images.t_ns, len(parts)),
        line_period_s=None if period is None else np.tile(period, len(parts)),
        camera=tuple(names[k] for k in of_image.tolist()),
    )
    rig = Rig(tuple(names), tuple(part.camera for part in parts), C_KC, of_image)
    landmarks = parts[0].landmarks if one_site else _all(parts, names)
    return replace(parts[0], landmarks=landmarks, images=images, sightings=Sightings.joined(seen), rig=rig)


def _all(parts: Sequence[Campaign], names: Sequence[str]) -> Landmarks:
    """The landmarks of all parts, those of each camera by its name."""
    return Landmarks(
        tuple(f"{i}-{name}" for name, part in zip(names, parts, strict=True) for i in part.landmarks.ids),
        np.concatenate([part.landmarks.r_J for part in parts]),
        np.concatenate([part.landmarks.covariance_J for part in parts]),
    )
