"""Further products into a campaign that is there: its tables grow, and what its user wrote in campaign.toml stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...disk.staging import completed
from ...physics.camera import LineScanCamera
from ...physics.errors import InputError
from ...physics.units import ARCSEC
from ...table.campaign import Campaign
from ..campaign.read import LoadedCampaign, load_campaign
from ..campaign.write import campaign_files
from ..text.files import read_text
from ..text.write import publish
from .join import Named, joined
from .metadata_files import one_metadata_file
from .product import Wanted, named_campaigns

_TABLES = ("ephemeris", "attitude", "landmarks", "images", "observations")


def import_into(
    folder: Path, paths: Sequence[Path], wanted: Wanted, image_ids: Sequence[str] = ()
) -> list[str]:
    """Add products to the campaign in ``folder``; returns notices for the user.

    The products must be of its camera.  A sigma that neither the product nor ``wanted`` states is the campaign's.
    Raises InputError for anything unusable; nothing is written then.
    """
    path = folder / "campaign.toml"
    if completed(folder):
        return [
            f"{path}: completed the import that was killed while its files were put in place; no other was added"
        ]
    loaded = load_campaign(path)
    _require_plain(path, loaded)
    notices: list[str] = []
    stated = replace(
        wanted,
        sigma_m=wanted.sigma_m or _several(loaded.campaign.sigma_position),
        sigma_arcsec=wanted.sigma_arcsec or _stated_arcsec(loaded.campaign),
    )
    parts = [Named(str(path), loaded.campaign), *named_campaigns(paths, stated, image_ids, notices, True)]
    whole = joined(parts)
    files = campaign_files(whole, loaded.config.campaign.time_scale)
    publish(
        folder, files | {"campaign.toml": _edited(path, whole)}, inputs=list(map(one_metadata_file, paths))
    )
    return notices


def _several(sigma: object) -> tuple[float, float, float]:
    x, y, z = np.asarray(sigma, dtype=np.float64).tolist()
    return x, y, z


def _stated_arcsec(campaign: Campaign) -> tuple[float, float, float] | None:
    if campaign.cov_attitude_E.ndim != 2:
        return None
    return _several(np.sqrt(np.diagonal(campaign.cov_attitude_E)) / ARCSEC)


def _require_plain(path: Path, loaded: LoadedCampaign) -> None:
    """Raise InputError where the campaign's tables are not as import writes them: they could not be written again."""
    config = loaded.config
    if config.observations is None or config.attitude is None:
        raise InputError(
            f"{path}: found no [observations] or no [attitude], wanted a campaign that import wrote"
        )
    for key in _TABLES:
        section = getattr(config, key)
        declared = section.declared(key)
        if section.file != f"{key}.csv" or declared.columns or declared.keep or declared.time:
            found = f"found {key} in a file of its own form"
            raise InputError(
                f"{path}: {found}, wanted {key}.csv as import writes it: add the product by hand"
            )
    written = (config.ephemeris.frame, config.ephemeris.units.position, config.attitude.source)
    if written != ("ITRF", "m", loaded.campaign.one_attitude.frame):
        raise InputError(
            f"{path}: found orbit or attitude in other frames or units than import writes: add the product by hand"
        )


def _edited(path: Path, campaign: Campaign) -> str:
    """campaign.toml with what the further products change: the size of images and how far samples are joined."""
    import tomlkit

    document = tomlkit.parse(read_text(path))
    if isinstance(campaign.camera, LineScanCamera) and np.isfinite(campaign.camera.size_px[1]):
        document["camera"]["image_size_px"] = [int(n) for n in campaign.camera.size_px]
    for key, gap_s in (("ephemeris", campaign.ephemeris.gap_s), ("attitude", campaign.one_attitude.gap_s)):
        if gap_s is not None:
            document[key]["max_gap_s"] = gap_s
    return tomlkit.dumps(document)
