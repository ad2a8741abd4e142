"""True scenes of several cameras that image together: the first of :mod:`problems`, others ahead of it and behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from problems import C_EK_TRUE, FRAME, SIGMAS, truth
from starplumb.io.campaign.marks.landmarks import TIE_M
from starplumb.physics import so3
from starplumb.physics.series import Attitude
from starplumb.physics.units import DEG
from starplumb.plan import scene
from starplumb.table.cameras.rig import Rig
from starplumb.table.cameras.views import of_camera
from starplumb.table.campaign import Campaign, Landmarks, Sightings
from starplumb.table.geometry import locate, project

FORE = so3.exp(np.array([22.0, 0.0, 0.0]) * DEG)
AFT = so3.exp(np.array([-22.0, 1.0, 90.0]) * DEG)
BAND = so3.exp(np.array([0.02, 0.3, 0.05]) * DEG)
"""C_KC of cameras that look 22 deg ahead of the first and behind it, the latter turned by a quarter about its axis;
and of another band beside it."""


def rig_truth(
    turns: Sequence[np.ndarray] = (FORE,),
    images: int = 6,
    markers: int = 8,
    apart_s: float = 0.0,
    sigmas: scene.Sigmas = SIGMAS,
) -> Campaign:
    """Every camera takes an image at each moment, with markers of its own; ``apart_s`` later than the one before."""
    first = _fixed_to_earth(truth(images=images, markers=markers, sigmas=sigmas))
    C_KC = np.stack([np.eye(3), *turns])
    parts, names = [], [chr(ord("A") + k) for k in range(len(C_KC))]
    draw = np.random.default_rng(images * 1000 + markers)
    for k, C in enumerate(C_KC):
        late = np.int64(round(1e9 * apart_s * k))
        times = replace(first.images, t_ns=first.images.t_ns + late)
        one = replace(first, C_EK=C_EK_TRUE @ C, images=times)
        pixel = draw.uniform(500.0, 11500.0, (images * markers, 2))
        height = draw.uniform(0.0, 1500.0, images * markers)
        parts.append(scene.mark_pixels(one, np.repeat(np.arange(images), markers), pixel, height, sigmas))
    return together(parts, names, C_KC)


def _fixed_to_earth(campaign: Campaign) -> Campaign:
    """With the attitude against the Earth, whose turning a file cannot have as the scene's stand-in has it."""
    series = campaign.one_attitude
    C_EJ, _ = series.at(series.t_ns)
    fixed = Attitude(series.t_ns, so3.to_quaternion(C_EJ), "ITRF", None, series.gap_s)
    return replace(campaign, attitude=fixed, orientation=None)


def together(parts: Sequence[Campaign], names: Sequence[str], C_KC: np.ndarray) -> Campaign:
    """One campaign of parts by one camera each, whose attitude and orbit are those of the first."""
    m, L = len(parts[0].images.ids), [len(part.landmarks.ids) for part in parts]
    begin = np.concatenate([[0], np.cumsum(L)])
    ids = tuple(f"{name}-{i}" for name, part in zip(names, parts, strict=True) for i in part.landmarks.ids)
    landmarks = Landmarks(
        ids,
        np.concatenate([part.landmarks.r_J for part in parts]),
        np.concatenate([part.landmarks.covariance_J for part in parts]),
    )
    seen = [
        replace(
            part.sightings, image=part.sightings.image + k * m, landmark=part.sightings.landmark + begin[k]
        )
        for k, part in enumerate(parts)
    ]
    of_image = np.repeat(np.arange(len(parts)), m)
    images = replace(
        parts[0].images,
        ids=tuple(f"{name}-{i}" for name, part in zip(names, parts, strict=True) for i in part.images.ids),
        t_ns=np.concatenate([part.images.t_ns for part in parts]),
        camera=tuple(names[k] for k in of_image),
    )
    rig = Rig(tuple(names), (FRAME,) * len(parts), C_KC, of_image)
    return replace(parts[0], landmarks=landmarks, images=images, sightings=Sightings.joined(seen), rig=rig)


def with_tie_points(campaign: Campaign, each: int, rng: np.random.Generator) -> Campaign:
    """The campaign of two cameras that look the same way, with so many true tie points in each pair of images, which
    both cameras see; what is known of their place is as good as nothing."""
    m, L = len(campaign.images.ids) // 2, len(campaign.landmarks.ids)
    first, second = (of_camera(campaign, k) for k in range(2))
    image, height = np.repeat(np.arange(m), each), rng.uniform(0.0, 1500.0, m * each)
    a = rng.uniform(3000.0, 9000.0, (image.size, 2))
    r_J = locate(first, first.C_EK, image, a[:, 0], a[:, 1], height)
    b = project(second, second.C_EK, image + m, r_J)
    inside = np.all((b > 0.0) & (b < 11999.0), axis=-1)
    image, r_J, n = image[inside], r_J[inside], int(np.sum(inside))
    landmark, sigma, check = np.arange(L, L + n), np.full(n, SIGMAS.pixel), np.zeros(n, dtype=bool)
    seen = [
        Sightings(at, landmark, px[inside, 0], px[inside, 1], sigma, check)
        for at, px in ((image, a), (image + m, b))
    ]
    stated = campaign.landmarks
    landmarks = Landmarks(
        (*stated.ids, *(f"tie{i}" for i in range(n))),
        np.concatenate([stated.r_J, r_J]),
        np.concatenate([stated.covariance_J, np.tile(TIE_M**2 * np.eye(3), (n, 1, 1))]),
        tie=np.arange(L + n) >= L,
    )
    return replace(campaign, landmarks=landmarks, sightings=Sightings.joined([campaign.sightings, *seen]))
