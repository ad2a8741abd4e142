"""A campaign of several cameras, seen by moments and by single cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..campaign import Campaign, some_of

Index = NDArray[np.int64]


def moments(campaign: Campaign) -> Index:
    """The first image (m,) that was taken at the same time as each image, row for row: cameras that image together have
    the errors of attitude and orbit in common."""
    images = campaign.images
    columns = [images.t_ns]
    if images.line_period_s is not None:
        columns.append(images.line_period_s.view(np.int64))
    if images.row_times is not None:
        tables = [None if table is None else (*table.row, *table.late_ns) for table in images.row_times]
        columns.append(np.array([tables.index(table) for table in tables]))
    _, first, back = np.unique(np.stack(columns, axis=-1), axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[back.reshape(-1)])


def of_camera(campaign: Campaign, k: int) -> Campaign:
    """The campaign of one camera alone: its sightings, among the same images and landmarks."""
    rig = campaign.rig
    if rig is None:
        return campaign
    seen = some_of(campaign.sightings, rig.of_image[campaign.sightings.image] == k)
    C_EK = campaign.C_EK if k == 0 else campaign.C_EK @ rig.C_KC[k]
    alone = replace(campaign, camera=rig.cameras[k], C_EK=C_EK, rig=None, sightings=seen)
    return alone if k == 0 else replace(alone, sigma_mounting=None, covariance_mounting=None)
