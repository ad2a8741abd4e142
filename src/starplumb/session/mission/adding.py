"""Results and campaigns on their way into an archive: read, checked against each other, and made into rows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...documents.normals import NormalsDocument
from ...documents.result import Image, ResultDocument
from ...io.archive.blobs import is_digest
from ...io.archive.records import digest
from ...io.archive.rows import ImageRow, Instrument, NewCampaign
from ...io.text.files import read_text, show
from ...io.text.write import json_text
from ...physics import so3
from ...physics.errors import InputError
from ...physics.timescales import parse
from ...physics.units import ARCSEC, DEG
from ..mounting import require_set
from ..result import Result

SAME_ARCSEC = 1e-3
"""Mountings of a result and of the normal equations beside it that differ by more are of two results."""


@dataclass(frozen=True)
class Coming:
    """A campaign that is to be added, and the folders in which its files may be."""

    row: NewCampaign
    folders: tuple[Path, ...]
    notices: tuple[str, ...] = ()


def coming(what: Result | str | Path, satellite: str | None, default: str) -> Coming:
    """What is to be added: a Result, the path of a ``result.json``, of its folder, or of a ``campaign.toml``.

    It is of ``satellite``, of the one that it states where that is None, else of ``default``.  A campaign is calibrated
    by default.  Raises InputError where it is none of these.
    """
    if isinstance(what, Result):
        path = what.campaign.path
        folders = () if path is None else (path.parent,)
        return Coming(
            row_of(json_text(what.document), what.normals, (satellite, default), "the result"), folders
        )
    path = Path(what)
    path = _within(path) if path.is_dir() else path
    if path.suffix.lower() == ".toml":
        from ..calibration import calibrate
        from ..campaign import read_campaign

        campaign = read_campaign(path)
        found = coming(calibrate(campaign), satellite, default)
        return Coming(found.row, found.folders, campaign.notices)
    return _of_result(path, satellite, default)


def _within(folder: Path) -> Path:
    for name in ("result.json", "campaign.toml"):
        if (folder / name).is_file():
            return folder / name
    raise InputError(f"{folder}: found neither result.json nor campaign.toml in it, wanted one of them")


def _of_result(path: Path, satellite: str | None, default: str) -> Coming:
    text, beside = read_text(path), path.with_name("normals.json")
    document = ResultDocument.from_json(text, str(path))
    if document.usable:
        require_set(path, document, ["normals.json"])
    normals = None
    if document.usable and beside.is_file():
        normals = NormalsDocument.from_json(read_text(beside), str(beside))
        apart = so3.log(np.array(normals.matrix) @ document.C_EK.T) / ARCSEC
        if np.max(np.abs(apart)) > SAME_ARCSEC:
            raise InputError(
                f"{beside}: found equations about another mounting than that of {path.name}, wanted those of one "
                "result; calibrate again"
            )
    row = row_of(text, None if normals is None else normals.to_dict(), (satellite, default), str(path))
    return Coming(row, (path.absolute().parent.parent, path.absolute().parent))


def row_of(
    text: str, normals: Mapping[str, Any] | None, of: tuple[str | None, str], name: str
) -> NewCampaign:
    """The row of a result, as the text of ``result.json``, and of its normal equations, of a satellite or else of
    another.  Raises InputError, which calls the result by its ``name``, where it is none of this starplumb."""
    result = ResultDocument.from_json(text, name)
    if not result.inputs or result.span is None:
        raise InputError(
            f"{name}: found a result that does not say from which files, or of which time, wanted one of this starplumb"
        )
    equations = None if normals is None else NormalsDocument.of(normals)
    for file, one in result.inputs.items():
        if not is_digest(one):
            raise InputError(
                f"{name}, inputs: found {show(one)} of {show(file)}, wanted sha256: and its 64 digits"
            )
    inputs, options = sorted(result.inputs.values()), options_of(result)
    satellite = next(name for name in (of[0], result.satellite, of[1]) if name is not None)
    first, last = parse([result.span.first, result.span.last], "UTC").tolist()
    images = {i.image_id: i for i in result.images or ()}
    each = [] if equations is None else equations.images
    of_image = {
        name: digest for e in each for name, digest in [(e.image_id, e.sightings), *(e.also or {}).items()]
    }
    return NewCampaign(
        digest(inputs, options),
        digest(inputs),
        Instrument(satellite, result.mounting.from_, result.mounting.to),
        _name(result, equations, name),
        first,
        last,
        json.dumps(result.software, sort_keys=True),
        result.method,
        options,
        result.status,
        result.C_EK,
        result.covariance_E,
        text,
        result.inputs,
        [_image(image, of_image.get(image.image_id)) for image in images.values()],
        [] if equations is None else _unknowns(equations),
        [] if equations is None else _normals(equations),
    )


def _name(result: ResultDocument, equations: NormalsDocument | None, name: str) -> str:
    if result.campaign is not None:
        return result.campaign
    return name if equations is None else equations.campaign


def options_of(result: ResultDocument) -> dict[str, Any]:
    """What a result was asked for beyond its inputs: method, further parameters with their sigmas, and motion."""
    model = None if result.motion is None else result.motion.model
    return {
        "method": result.method,
        "estimate": [[p.name, p.unit, p.prior_sigma] for p in result.parameters or ()],
        "drift": "none" if model is None else model.asked,
    }


def _image(image: Image, sightings: str | None) -> ImageRow:
    return ImageRow(
        image.image_id,
        0 if image.time is None else int(parse([image.time], "UTC")[0]),
        None if image.argument_of_latitude_deg is None else DEG * image.argument_of_latitude_deg,
        None if image.sun_beta_deg is None else DEG * image.sun_beta_deg,
        image.temperatures_c or {},
        image.statistic,
        image.observations,
        sightings,
    )


def _unknowns(equations: NormalsDocument) -> Sequence[tuple[str, str, Any, Any, Any]]:
    return [
        (u.name, u.unit, np.array(u.reference), np.array(u.expected), _square(u.covariance))
        for u in equations.unknowns
    ]


def _square(covariance: list[list[float]] | None) -> Any:
    return None if covariance is None else np.array(covariance)


def _normals(equations: NormalsDocument) -> Sequence[tuple[str, Sequence[str], Any, Any, float, int]]:
    return [
        (i.image_id, i.unknowns, np.array(i.information), np.array(i.vector), i.constant, i.count)
        for i in equations.images
    ]
