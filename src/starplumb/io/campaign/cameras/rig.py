"""The cameras of a campaign as its physics needs them: the first, and all of them where they have names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....physics.camera import Camera
from ....physics.errors import InputError
from ....table.cameras.rig import Rig
from ....table.campaign import Images
from ...tables.cells import Array
from ...tables.read import TableSource
from ..attitude import model_mounting
from ..camera import pixel_shift, read_camera
from ..config import CampaignConfig
from ..files import look_angles_key
from ..fixed_frames import CAMERA, way
from ..marks.markers import Grid

Index = NDArray[np.int64]


@dataclass(frozen=True)
class Optics:
    """Cameras by name, their model mountings ``C_EC`` (k, 3, 3), and the places of their pixels."""

    cameras: dict[str, Camera]
    C_EC: Array
    grids: tuple[Grid, ...]
    named: bool

    @property
    def first(self) -> Camera:
        return next(iter(self.cameras.values()))

    @property
    def several(self) -> bool:
        return len(self.cameras) > 1

    def of_image(self, images: Images) -> Index:
        """Which camera took each image (m,).  Raises InputError where the table of images does not say."""
        names = list(self.cameras)
        if images.camera is None:
            if self.several:
                raise InputError(
                    f"{images.name}: found no column camera, wanted it for several [[cameras]], with one of "
                    f"{', '.join(names)} for each image"
                )
            return np.zeros(len(images.ids), dtype=np.int64)
        return np.array([names.index(name) for name in images.camera], dtype=np.int64)

    def rig(self, images: Images) -> Rig | None:
        """All of them, where they have names."""
        if not self.named:
            return None
        C_KC = np.concatenate([np.eye(3)[None], self.C_EC[0].mT @ self.C_EC[1:]])
        return Rig(tuple(self.cameras), tuple(self.cameras.values()), C_KC, self.of_image(images))


def read_optics(config: CampaignConfig, tables: Mapping[str, TableSource], notices: list[str]) -> Optics:
    """The cameras of [camera] or [[cameras]]."""
    cameras, mountings, grids = {}, [], []
    frames = config.joined_frames
    for name, (section, mounting) in config.optics.items():
        cameras[name] = read_camera(section, tables.get(look_angles_key(config, name)), notices)
        mountings.append(_in_E(config, model_mounting(mounting, frames, name), name))
        grids.append(Grid(*cameras[name].size_px, shift_px=pixel_shift(section)))
    return Optics(cameras, np.stack(mountings), tuple(grids), config.cameras is not None)


def _in_E(config: CampaignConfig, C: Array, name: str) -> Array:
    """A mounting to the frame that the campaign's first one leads to."""
    mounting, frames = config.optics[name][1], config.joined_frames
    at_camera = mounting.source in {CAMERA, *frames.joined(name)}
    other = mounting.target if at_camera else mounting.source
    return C if other == config.tracker else way(frames, config.tracker, other) @ C
