"""The past repeated with today's program: every campaign of an archive from its own kept files, and what changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ... import __version__
from ...documents.numbers import numbers
from ...io.archive import blobs
from ...io.archive.rows import Entry, inputs_of
from ...io.archive.store import opened
from ...physics import so3
from ...physics.errors import StarplumbError
from ...physics.units import ARCSEC
from ..calibration import calibrate
from ..campaign import read_campaign
from ..result import Result

UNCHANGED = 0.01
"""Change, in sigmas, up to which an answer is the same: other versions of NumPy differ by less."""
DEPTH = 8
"""Folders below that of the kept files, so that names may lead some folders up."""


def rerun_document(archive: Path, entries: tuple[Entry, ...]) -> dict[str, Any]:
    """What ``starplumb archive rerun --json`` prints."""
    with opened(archive) as database:
        inputs = {entry.id: inputs_of(database, entry.id) for entry in entries}
    found, left = [], []
    for entry in entries:
        try:
            now = again(archive, entry, inputs[entry.id])
        except (StarplumbError, LookupError) as error:
            left.append({"id": entry.id, "name": entry.name, "reason": str(error)})
        else:
            found.append(_compared(entry, now))
    return {
        "schema": "starplumb-archive-rerun/1",
        "archive": str(archive),
        "software": __version__,
        "campaigns": found,
        "not_run": left,
    }


def again(archive: Path, entry: Entry, inputs: Mapping[str, str]) -> Result:
    """The result of a campaign's kept files with its own options.  Raises LookupError where files are not kept."""
    with TemporaryDirectory(prefix="starplumb-") as folder:
        base = Path(folder).joinpath(*"d" * DEPTH)
        written = [_written(archive, base, Path(folder), name, digest) for name, digest in inputs.items()]
        campaign = read_campaign(written[0])
        options = entry.options
        return calibrate(campaign, list(_estimated(options)), options["method"], drift=options["drift"])


def _written(archive: Path, base: Path, within: Path, name: str, digest: str) -> Path:
    """A kept file written where the campaign expects it."""
    if not blobs.is_kept(archive, digest):
        raise LookupError(f"{name} is not kept")
    path = base / name
    try:
        if PurePosixPath(name).is_absolute() or not path.resolve().is_relative_to(within.resolve()):
            raise LookupError(f"{name} lies elsewhere, not beside its campaign")
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            file.writelines(blobs.pieces(archive, digest))
    except (OSError, ValueError) as error:
        raise LookupError(f"{name[:60]!r} cannot be written where its campaign wants it ({error})") from None
    return path


def _estimated(options: Mapping[str, Any]) -> Iterator[str]:
    """The parameters that were estimated, as ``--estimate`` takes them."""
    for name, unit, sigma in options["estimate"]:
        yield name if sigma is None else f"{name}={sigma!r}{unit}"


def _compared(then: Entry, now: Result) -> dict[str, Any]:
    """What today's answer of a campaign is beside the one in the archive."""
    status, C, P = now.status, now.C_EK, then.covariance_E
    change = so3.log(C @ then.C_EK.T)
    sigmas = ratio = None
    if P is not None:
        sigma = np.sqrt(np.diagonal(P))
        sigmas = numbers(change / sigma)
        ratio = None if now.sigma_arcsec is None else numbers(now.sigma_arcsec * ARCSEC / sigma)
    moved = sigmas is None or max(map(abs, sigmas)) > UNCHANGED
    other = ratio is not None and max(abs(r - 1.0) for r in ratio) > UNCHANGED
    return {
        "id": then.id,
        "name": then.name,
        "software_then": then.software,
        "status_then": then.status,
        "status_now": status,
        "change_arcsec": numbers(change / ARCSEC),
        "change_sigmas": sigmas,
        "sigma_ratio": ratio,
        "changed": bool(status != then.status or (then.status in ("ok", "weak") and (moved or other))),
        "message": now.message,
    }
