"""Products of vendors: which vendor a file is from, and the campaign folder that is made from it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...estimators.gls import Gls
from ...physics.errors import EpochError, InputError
from ...physics.timescales import format_iso
from ...table.campaign import Campaign, Landmarks, Sightings
from ...table.geometry import observe
from ..campaign.marks.landmarks import read_landmarks
from ..campaign.marks.markers import Grid, read_observations
from ..campaign.write import write_campaign
from ..tables.cells import PRINTABLE
from ..text.files import show
from ..text.visible import IN_NAME
from .csm.product import read_csm
from .digitalglobe import read_digitalglobe
from .digitalglobe_geo import Optics
from .dimap import read_dimap
from .join import Named, joined
from .metadata_files import one_metadata_file, vendor_of
from .pinhole import read_pinhole
from .vendor import CORNERS_AGREE_M, AttitudeChoice, Product, Sigma, corners_missed

CORNER_LIMIT_M = 50_000.0
"""A product whose model misses its own corners by more than this was read wrongly: neither a nominal mounting nor the
unknown height of a corner explains that much."""


def read_product(
    path: Path, attitude: AttitudeChoice = "vendor", optics: Optics | None = None, band: str | None = None
) -> Product:
    """A product of any vendor that is read: a DIMAP file, a DigitalGlobe XML file or any of its text files, or the
    folder that holds one of them.

    Raises InputError for another kind of file, and for a choice that the product does not have.
    """
    path = one_metadata_file(path)
    if (vendor := vendor_of(path)) in ("CSM", "pinhole"):
        if optics is not None or attitude != "vendor" or band is not None:
            raise InputError(
                f"{path}: found optics, attitude or band beside a sensor model, wanted none: it has its own"
            )
        return read_csm(path) if vendor == "CSM" else read_pinhole(path)
    if vendor_of(path) == "DIMAP":
        if optics is not None:
            raise InputError(f"{path}: found optics stated for a DIMAP product, wanted none: it has its own")
        return read_dimap(path, attitude, band)
    if attitude != "vendor":
        raise InputError(f'{path}: found attitude "{attitude}", wanted "vendor": the product has no other')
    return read_digitalglobe(path, optics, band)


def import_product(
    path: Path,
    out: Path,
    *,
    attitude: AttitudeChoice = "vendor",
    sigma_m: Sigma | None = None,
    sigma_arcsec: Sigma | None = None,
    optics: Optics | None = None,
    band: str | None = None,
    corners: tuple[float, float] | None = None,
    landmarks: Path | None = None,
    observations: Path | None = None,
    image_id: str | None = None,
) -> list[str]:
    """Write the campaign folder ``out`` of the product at ``path``; returns notices for the user.

    ``attitude``: the vendor's own or, of DIMAP telemetry, ``filtered`` or ``raw`` quaternions. ``sigma_m`` and
    ``sigma_arcsec`` are needed where the product states none, and go before those it states. ``optics`` for a
    DigitalGlobe product without .GEO. Landmarks and their sightings come from the tables ``landmarks`` and
    ``observations``, or are the product's own ``corners`` with the stated sigmas (m, pixels); else the tables are
    empty, to be filled in. ``image_id`` is the image's name in ``observations``, by default the product's.
    Raises InputError for anything unusable and where ``out`` holds a campaign already; nothing is written then.
    """
    wanted = Wanted(attitude, sigma_m, sigma_arcsec, optics, band, corners)
    names = () if image_id is None else (image_id,)
    return import_products([path], out, wanted, landmarks, observations, names)


@dataclass(frozen=True)
class Wanted:
    """What a user wants of every product; as for :func:`import_product`."""

    attitude: AttitudeChoice = "vendor"
    sigma_m: Sigma | None = None
    sigma_arcsec: Sigma | None = None
    optics: Optics | None = None
    band: str | None = None
    corners: tuple[float, float] | None = None

    def of(self, path: Path, image_id: str | None, several: bool, notices: list[str]) -> Campaign:
        """The campaign of a product, with its corners if they are wanted; with the name of their image if there are
        those of ``several``."""
        product = read_product(path, self.attitude, self.optics, self.band)
        product = replace(product, name=image_id or product.name)
        if re.search(IN_NAME, product.name):
            raise InputError(f"{path}: found the name {show(product.name)}, wanted {PRINTABLE}")
        campaign = product.campaign(self.sigma_m, self.sigma_arcsec)
        notices += [*product.notices, *_coverage(product, campaign), *_corner_check(product, campaign)]
        if self.corners is None:
            return campaign
        if several and product.corners is not None:
            names = tuple(f"{product.name}-{name}" for name in product.corners.names)
            product = replace(product, corners=replace(product.corners, names=names))
        return _with_corners(product, campaign, *self.corners)


def import_products(
    paths: Sequence[Path],
    out: Path,
    wanted: Wanted,
    landmarks: Path | None = None,
    observations: Path | None = None,
    image_ids: Sequence[str] = (),
) -> list[str]:
    """Write one campaign of several products of one camera, as :func:`import_product` does of one."""
    require_free(out)
    notices: list[str] = []
    parts = named_campaigns(paths, wanted, image_ids, notices)
    campaign = joined(parts) if len(parts) > 1 else parts[0].campaign
    campaign = _with_landmarks(campaign, wanted.corners, landmarks, observations, notices)
    sources = ", ".join(part.name for part in parts)
    write_campaign(out, campaign, comment=f"imported from {sources}, attitude: {wanted.attitude}", new=True)
    return notices


def named_campaigns(
    paths: Sequence[Path], wanted: Wanted, image_ids: Sequence[str], notices: list[str], several: bool = False
) -> list[Named]:
    """The campaign of each product by the name of its file."""
    if image_ids and len(image_ids) != len(paths):
        counts = f"found {len(image_ids)} names for {len(paths)} products"
        raise InputError(f"image_id: {counts}, wanted one for each, with commas between")
    found = [one_metadata_file(path) for path in paths]
    names = image_ids or (None,) * len(paths)
    more = several or len(paths) > 1
    return [
        Named(path.name, wanted.of(path, name, more, notices))
        for path, name in zip(found, names, strict=True)
    ]


def require_free(out: Path) -> None:
    """Refuse to overwrite a campaign: its tables may hold a user's work."""
    for name in ("campaign.toml", "landmarks.csv", "observations.csv"):
        if (out / name).exists():
            raise InputError(f"{out / name}: found it there already, wanted a folder without a campaign")


def _coverage(product: Product, campaign: Campaign) -> list[str]:
    """A notice where orbit or attitude do not reach over all rows; InputError where they reach over none."""
    notices = []
    for what, t_ns in (("orbit", product.orbit_t_ns), ("attitude", product.attitude_t_ns)):
        if product.frame_camera is not None:
            continue  # its epoch is one of the samples
        rows = campaign.images.row_at(0, t_ns[[0, -1]])
        first, last = max(float(rows.min()), 0.0), min(float(rows.max()), product.rows - 1.0)
        if first > last:
            span = " to ".join(format_iso(t_ns[[0, -1]], "UTC"))
            raise InputError(
                f"{product.path}: found its {what} from {span} UTC, wanted it to cover the image"
            )
        if first > 0.0 or last < product.rows - 1.0:
            covered = f"rows {int(np.ceil(first))} to {int(last)} of 0 to {product.rows - 1}"
            notices.append(f"{product.path}: its {what} covers the {covered} only")
    return notices


def _corner_check(product: Product, campaign: Campaign) -> list[str]:
    """How well the product's own model meets the corners it states; InputError where it misses them widely."""
    corners = product.corners
    if corners is None:
        return []
    try:
        worst = corners_missed(product, campaign)
    except EpochError:
        return []  # rows that the attitude does not cover are already reported
    if not worst <= CORNER_LIMIT_M:
        found = (
            f"its corners {worst / 1e3:.0f} km"
            if np.isfinite(worst)
            else "a look direction that misses the Earth,"
        )
        raise InputError(
            f"{product.path}: found {found} away from where it says, wanted a model that meets them"
        )
    if not corners.have_heights:
        return []
    return [f"{product.path}: with the model mounting its own corners are met within {worst:.4g} m"]


def _contradiction(product: Product, missed: float) -> InputError:
    return InputError(
        f"{product.path}: found corners that the product's own geometry misses by {missed:.4g} m, wanted ones within "
        f"{CORNERS_AGREE_M:g} m: their pixels or heights are not those of this image; use landmarks of your own"
    )


def _with_landmarks(
    campaign: Campaign,
    corners: tuple[float, float] | None,
    landmarks: Path | None,
    observations: Path | None,
    notices: list[str],
) -> Campaign:
    """The campaign with the landmarks the user gives, or as it is."""
    if (landmarks is None) != (observations is None):
        raise InputError(
            f"{landmarks or observations}: found landmarks or observations alone, wanted both tables"
        )
    if landmarks is not None and observations is not None:
        if corners is not None:
            raise InputError(
                f"{landmarks}: found landmarks beside the product's corners, wanted one of the two"
            )
        marks = read_landmarks(landmarks, notices)
        grid = Grid(*campaign.camera.size_px, 0.0)
        seen, _ = read_observations(observations, campaign.images.ids, marks.ids, grid, notices)
        return replace(campaign, landmarks=marks, sightings=seen)
    if corners is None:
        notices.append("landmarks.csv and observations.csv hold no rows yet: fill them in")
    return campaign


def _with_corners(product: Product, campaign: Campaign, sigma_m: float, sigma_px: float) -> Campaign:
    """The product's corners as landmarks; the product located them with its own mounting, so this recovers it."""
    corners = product.corners
    if corners is None or not corners.have_heights:
        raise InputError(f"{product.path}: found no corners with heights, wanted a table of landmarks")
    if product.own_mounting and (missed := corners_missed(product, campaign)) > CORNERS_AGREE_M:
        raise _contradiction(product, missed)
    for name, sigma in (("sigma_m", sigma_m), ("sigma_px", sigma_px)):
        if not (np.isfinite(sigma) and sigma > 0.0):
            raise InputError(f"corners: found the {name} {sigma:g}, wanted a positive number")
    c = len(corners.names)
    covariance = np.broadcast_to(sigma_m**2 * np.eye(3), (c, 3, 3))
    cornered = replace(
        campaign,
        landmarks=Landmarks(corners.names, corners.r_J, np.array(covariance)),
        sightings=Sightings(
            np.zeros(c, dtype=np.int64),
            np.arange(c),
            corners.column_px,
            corners.row_px,
            np.full(c, float(sigma_px)),
            np.zeros(c, dtype=np.bool_),
        ),
    )
    if not product.own_mounting:
        turned = replace(product, C_EK=Gls()(observe(cornered), product.C_EK).C_EK)
        if (missed := corners_missed(turned, campaign)) > CORNERS_AGREE_M:
            raise _contradiction(product, missed)
    return cornered
