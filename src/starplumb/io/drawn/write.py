"""A campaign of raw images and a reference to its folder, as ``starplumb measure`` reads it without any extra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...disk.publish import Content, publish
from ...ground.grid import Terrain
from ...physics import so3
from ...physics.units import DEG
from ...table.campaign import Campaign
from ..campaign.toml_text import document_text
from ..campaign.write import campaign_files, campaign_sections

Array = NDArray[np.float64]
Grey = NDArray[np.uint8] | NDArray[np.uint16]

RAW, ORTHO, DEM = "raw_{image_id}.png", "ortho.png", "dem.asc"


@dataclass(frozen=True)
class OrthoPicture:
    """An orthoimage of grey values (r, c), the northernmost row first.

    ``corner`` is the longitude and latitude, deg, of the centre of its first pixel, ``step`` the size of its pixels;
    ``sigma_m`` what errs in it east and north and in the heights, alike over ``correlation_length_m``.
    """

    grey: NDArray[np.uint8]
    corner: tuple[float, float]
    step: tuple[float, float]
    sigma_m: Sequence[float]
    correlation_length_m: float

    @property
    def world_file(self) -> str:
        """The six lines that lay it on the ground."""
        lines = (self.step[0], 0.0, 0.0, -self.step[1], *self.corner)
        return "".join(f"{value!r}\n" for value in lines)


def write_imagery(
    folder: Path,
    campaign: Campaign,
    raws: Sequence[NDArray[np.uint16]],
    ortho: OrthoPicture,
    dem: Terrain,
    saturation_dn: int,
    *,
    C_EK_true: Array,
    comment: str = "",
    schema: str = "",
) -> Path:
    """Write a simulated campaign without sightings, a raw image (r, c) for each of its images, orthoimage and heights,
    all files or none; returns the path of ``campaign.toml``.

    ``C_EK_true`` is noted as the truth, ``comment`` heads campaign.toml and ``schema`` lies beside it.
    """
    unseen = ("landmarks", "observations")
    sections = [section for section in campaign_sections(campaign, "UTC") if section[0] not in unseen]
    sections += [
        ("imagery", {"files": RAW, "saturation_dn": saturation_dn}),
        ("reference", _reference(ortho)),
        ("truth", {"quaternion_xyzw": so3.to_quaternion(C_EK_true)}),
    ]
    tables = campaign_files(campaign, "UTC")
    files: dict[str, Content] = {
        name: text for name, text in tables.items() if name not in (f"{table}.csv" for table in unseen)
    }
    for name, raw in zip(campaign.images.ids, raws, strict=True):
        files[RAW.format(image_id=name)] = partial(_png, raw)
    files[ORTHO] = partial(_png, ortho.grey)
    files["ortho.pgw"] = ortho.world_file
    files[DEM] = ascii_grid(dem)
    text = document_text(sections, comment)
    if schema:
        files["campaign.schema.json"] = schema
        text = f"#:schema campaign.schema.json\n{text}"
    publish(folder, files | {"campaign.toml": text})  # last: it marks that the others are there
    return folder / "campaign.toml"


def _reference(ortho: OrthoPicture) -> dict[str, object]:
    return {
        "files": [ORTHO],
        "crs": "EPSG:4326",
        "dem": DEM,
        "heights": "ellipsoidal",
        "sigma_m": [float(sigma) for sigma in ortho.sigma_m],
        "correlation_length_m": ortho.correlation_length_m,
    }


def _png(grey: Grey, path: Path) -> None:
    from PIL import Image

    Image.fromarray(grey).save(path, format="PNG")


def ascii_grid(dem: Terrain) -> str:
    """Heights as an Esri ASCII grid in degrees, to the centimetre, -9999 where there is none."""
    rows, columns = dem.height.shape
    step = -dem.step[0] / DEG, dem.step[1] / DEG
    head = {
        "ncols": columns,
        "nrows": rows,
        "xllcenter": dem.longitude / DEG,
        "yllcenter": dem.latitude / DEG - (rows - 1) * step[0],
        "dx": step[1],
        "dy": step[0],
        "nodata_value": -9999,
    }
    known = np.where(np.isfinite(dem.height), dem.height, -9999.0)
    body = [" ".join(f"{height:.2f}" for height in row) for row in known.tolist()]
    return "\n".join([*(f"{key} {value!r}" for key, value in head.items()), *body, ""])
