"""What ``archive verify`` says: the rows of an archive against each other, their results and the kept files."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ...io.archive import blobs, rows, unite, verification
from ...io.archive.equations import equations
from ...io.archive.rows import Entry, ImageRow
from ...io.archive.store import opened
from ...physics.errors import InputError
from .adding import row_of

SAME = 1e-12
"""Numbers of a row and of its result that differ by less are the same: other versions of NumPy convert them so."""
_IN_BOTH = ("inputs_id", "first_ns", "last_ns", "software", "method", "status")
"""What a campaign's row and its result say in the same words."""


def verify_document(path: Path) -> dict[str, Any]:
    """What ``starplumb archive verify --json`` prints."""
    with opened(path) as database:
        database.text_factory = lambda data: data.decode(errors="replace")
        ids = database.execute("SELECT id, name FROM campaign ORDER BY first_ns, id").fetchall()
        inputs = {id_: rows.inputs_of(database, id_) for id_, _ in ids}
        lost = {id_: _lost(path, named) for id_, named in inputs.items()}
        found = list(verification.faults(database))
        for id_, name in ids:
            called = verification.label("campaign", id_, name)
            found += [f"{called}: {fault}" for fault in _of_campaign(database, id_)]
            found += [f"{called}: {fault}" for fault in _of_kept(path, inputs[id_], lost[id_])]
        left = unite.unnamed(database, blobs.all_kept(path))
    return {
        "schema": "starplumb-archive-verify/1",
        "archive": str(path),
        "campaigns": len(ids),
        "faults": found,
        "not_kept": {id_: names for id_, names in lost.items() if names},
        "left_over": left,
    }


def _lost(path: Path, inputs: dict[str, str]) -> list[str]:
    """Inputs that are not kept, or no longer as they were."""
    return [name for name, digest in inputs.items() if not blobs.is_kept(path, digest)]


def _of_kept(path: Path, inputs: dict[str, str], lost: list[str]) -> Iterator[str]:
    for name in lost:
        if blobs.is_there(path, inputs[name]):
            yield f"what is kept of {name} is not what its digest says"


def _of_campaign(database: sqlite3.Connection, id_: str) -> Iterator[str]:
    """In what a campaign's rows are not what its result says."""
    try:
        entry, text = rows.entry(database, id_), rows.result_text(database, id_)
        images = {image.image_id: image for image in rows.images_of(database, id_)}
        if entry.summable:
            list(equations(database, [entry], entry.instrument.frame_from))
        stated = row_of(text, None, (entry.instrument.satellite, ""), "its result")
    except (ValueError, LookupError, InputError) as error:
        yield " ".join(str(error).split())
        return
    names = [*_other_words(entry, stated), *_other_numbers(entry, stated)]
    if rows.inputs_of(database, id_) != stated.inputs:
        names.append("input")
    if names:
        yield f"its result says another {', another '.join(names)}"
    yield from _other_images(images, {image.image_id: image for image in stated.images})


def _other_words(entry: Entry, stated: rows.NewCampaign) -> Iterator[str]:
    for name in _IN_BOTH:
        if getattr(entry, name) != getattr(stated, name):
            yield name
    if entry.instrument != stated.instrument:
        yield "mounting.from or to"
    if stated.name != "its result" and entry.name != stated.name:
        yield "name"
    for name, value in json.loads(json.dumps(stated.options)).items():
        if name in entry.options and entry.options[name] != value:
            yield f"option {name}"


def _other_numbers(entry: Entry, stated: rows.NewCampaign) -> Iterator[str]:
    for name in ("C_EK", "covariance_E"):
        here, there = getattr(entry, name), getattr(stated, name)
        if (here is None) != (there is None) or (here is not None and not _same(here, there)):
            yield {"C_EK": "mounting", "covariance_E": "covariance"}[name]


def _same(here: Any, there: Any) -> bool:
    return bool(np.allclose(here, there, rtol=SAME, atol=SAME * float(np.max(np.abs(there)))))


def _other_images(here: dict[str, ImageRow], there: dict[str, ImageRow]) -> Iterator[str]:
    for id_ in sorted(here.keys() ^ there.keys()):
        yield f"its result has {'no' if id_ in here else 'an'} image {id_}"
    for id_ in sorted(here.keys() & there.keys()):
        other = [
            field.name
            for field in fields(ImageRow)
            if field.name != "sightings"
            and not _equal(getattr(here[id_], field.name), getattr(there[id_], field.name))
        ]
        if other:
            yield f"its result says another {', another '.join(other)} of image {id_}"


def _equal(here: Any, there: Any) -> bool:
    if isinstance(here, float) and isinstance(there, int | float):
        return _same(here, there)
    return bool(here == there)
