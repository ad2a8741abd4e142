"""``normals.json``: additive normal equations of a campaign, image by image, over named unknowns; and their sum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..estimators.fit import Fit
from ..judge.calibrate import Calibration
from ..judge.snooping import fit_at
from ..physics import so3
from ..physics.errors import InputError
from ..physics.timescales import format_iso
from ..physics.units import ARCSEC
from ..solve.normals import ImageNormals, image_normals
from ..table.parameter_names import UNITS, unit_of
from .document import Document, Matrix3, Part
from .numbers import numbers

Array = NDArray[np.float64]

NORMALS_SCHEMA = "starplumb-normals/1"
MOST_IMAGES = 2_000
"""Images up to which the file is written: it takes half a millisecond for each."""
MOST_NUMBERS = 500_000
"""Entries of all equations up to which the file is written (10 MB): with more it would be larger than what it is of."""
SAME_PLACE_M = 1e-3
"""Places of one landmark in two campaigns may differ by so much and still be the same."""
MOUNTING = "mounting"


class Unknown(Part):
    """A block of unknowns: its name and unit, the value about which the equations are, and what is ``expected`` of it
    beforehand with which covariance (null: nothing is known).  The mounting turns by it, ``exp(x) matrix``; of a
    landmark it is the surveyed place with its error."""

    name: str
    unit: str
    reference: list[float]
    expected: list[float]
    covariance: list[list[float]] | None


class ImageEquations(Part):
    """Normal equations of one image over blocks by name: upper triangle of the information, row by row, and vector."""

    image_id: str
    time: str
    unknowns: list[str]
    information: list[float]
    vector: list[float]
    constant: float
    count: int


class NormalsDocument(Document):
    """``normals.json``; the unknowns of an image are ``z + A x`` about the references, with least squares at
    ``x = -N^-1 b``."""

    schema_: Literal["starplumb-normals/1"] = Field(alias="schema")
    campaign: str
    matrix: Matrix3
    unknowns: list[Unknown]
    images: list[ImageEquations]


def normals_document(calibration: Calibration) -> dict[str, Any] | None:
    """``normals.json`` of a usable answer as a dictionary; None where the method's equations are not known, or there
    are too many of them."""
    c, unknowns = calibration, calibration.estimate.unknowns
    if not c.status.usable or unknowns is None or len(c.campaign.images.ids) > MOST_IMAGES:
        return None
    o, used = c.observations, c.residuals.used
    again = np.flatnonzero(np.bincount(o.landmark[used], minlength=o.n_landmarks) > 1)
    seen = np.bincount(o.image[used][np.isin(o.landmark[used], again)], minlength=o.n_images)
    width = 3.0 + len(unknowns.names) + len(o.common_of or ()) + 3.0 * seen
    if np.sum(width**2) > 2 * MOST_NUMBERS:
        return None
    fit = fit_at(unknowns, o, c.campaign.C_EK, c.estimate, used)
    common, scale = _common(fit)
    places = [_place(c, int(i)) for i in again]
    names = [unknown["name"] for unknown in common]
    return {
        "schema": NORMALS_SCHEMA,
        "campaign": c.campaign.name,
        "matrix": numbers(c.estimate.C_EK),
        "unknowns": [*common, *places],
        "images": [_image(c, one, names, scale) for one in image_normals(fit.whole, again)],
    }


def _common(fit: Fit) -> tuple[list[dict[str, Any]], Array]:
    """The unknowns that all images may have, as the adjustment orders them, and what one of each is in SI."""
    names, shared = fit.unknowns.names, fit.table.common_of or ()
    units = [unit_of(name) for name in names]
    scale = np.array([ARCSEC] * 3 + [UNITS[unit] for unit in units] + [1.0] * len(shared))
    information, step = fit.whole.prior
    reference = np.concatenate([np.zeros(3), fit.state.values, np.zeros(len(shared))])
    known = bool(np.any(information[:3, :3]))
    P = np.asarray(np.linalg.inv(information[:3, :3]) / ARCSEC**2) if known else None
    blocks = [_block(MOUNTING, "arcsec", np.zeros(3), step[:3] / ARCSEC, P)]
    labels = [*names, *(f"shared[{name} {k + 1}]" for k, name in enumerate(shared))]
    for k, (label, unit) in enumerate(zip(labels, [*units, *[""] * len(shared)], strict=True), start=3):
        variance = 1.0 / (information[k, k] * scale[k] ** 2)
        at = reference[k] / scale[k]
        blocks.append(
            _block(label, unit, np.array([at]), np.array([at + step[k] / scale[k]]), np.array([[variance]]))
        )
    return blocks, scale


def _block(
    name: str, unit: str, reference: Array, expected: Array, covariance: Array | None
) -> dict[str, Any]:
    known = None if covariance is None else numbers(covariance)
    return {
        "name": name,
        "unit": unit,
        "reference": numbers(reference),
        "expected": numbers(expected),
        "covariance": known,
    }


def _place(c: Calibration, landmark: int) -> dict[str, Any]:
    r_J, P = c.campaign.landmarks.r_J[landmark], c.campaign.landmarks.covariance_J[landmark]
    return _block(f"landmark[{c.campaign.landmarks.ids[landmark]}]", "m", r_J, r_J, P)


def _image(c: Calibration, one: ImageNormals, names: Sequence[str], scale: Array) -> dict[str, Any]:
    turn = c.campaign.turn_E
    one = one if turn is None else one.moved(turn[one.image])  # the data know of no motion
    s = np.concatenate([scale, np.ones(3 * one.landmarks.size)])
    N = one.information * s[:, None] * s
    landmarks = [f"landmark[{c.campaign.landmarks.ids[int(i)]}]" for i in one.landmarks]
    return {
        "image_id": c.campaign.images.ids[one.image],
        "time": format_iso(c.campaign.images.t_ns[one.image : one.image + 1], "UTC")[0],
        "unknowns": [*names, *landmarks],
        "information": numbers(N[np.triu_indices(s.size)]),
        "vector": numbers(one.vector * s),
        "constant": one.constant,
        "count": one.count,
    }


@dataclass(frozen=True)
class Joint:
    """The least-squares solution of several campaigns: the mounting with its covariance about E, and chi-square of
    ``count`` numbers; ``values`` of all unknowns by name, in the units of the documents."""

    C_EK: Array
    covariance_E: Array
    chi2: float
    count: int
    values: Mapping[str, Array]


def joined(documents: Sequence[NormalsDocument]) -> Joint:
    """Sum of the normal equations of campaigns, what is known beforehand added once.

    Unknowns of one name are one unknown, errors shared within a campaign its own.  Raises InputError where a landmark
    of one name has another place or another survey.
    """
    blocks = _registered(documents)
    names = list(blocks)
    ends = np.cumsum([len(blocks[name].reference) for name in names])
    at = {
        name: np.arange(end - len(blocks[name].reference), end) for name, end in zip(names, ends, strict=True)
    }
    N, b = np.zeros((ends[-1], ends[-1])), np.zeros(ends[-1])
    constant, count, C_0 = 0.0, 0, np.array(documents[0].matrix)
    for name, block in blocks.items():
        if block.covariance is not None:
            W = np.linalg.inv(np.array(block.covariance))
            pull = np.array(block.reference) - np.array(block.expected)
            N[np.ix_(at[name], at[name])] += W
            b[at[name]] += W @ pull
            constant += float(pull @ W @ pull)
    for k, document in enumerate(documents):
        own = {unknown.name: unknown for unknown in document.unknowns}
        turn = so3.log(np.array(document.matrix) @ C_0.T) / ARCSEC
        for image in document.images:
            called = [_called(name, k) for name in image.unknowns]
            offset = [
                turn if name == MOUNTING else np.array(own[name].reference) - blocks[key].reference
                for name, key in zip(image.unknowns, called, strict=True)
            ]
            d, where = np.concatenate(offset), np.concatenate([at[key] for key in called])
            M, v = np.zeros((d.size, d.size)), np.array(image.vector)
            M[np.triu_indices(d.size)] = image.information
            M = M + np.triu(M, 1).T
            # about the common references: z + A (x - d)
            N[np.ix_(where, where)] += M
            b[where] += v - M @ d
            constant += image.constant - 2.0 * float(v @ d) + float(d @ M @ d)
            count += image.count
    P = np.linalg.inv(N)
    x = -P @ b
    values = {name: x[at[name]] + np.array(blocks[name].reference) for name in names}
    C = so3.exp(ARCSEC * x[at[MOUNTING]]) @ C_0
    covariance = ARCSEC**2 * P[np.ix_(at[MOUNTING], at[MOUNTING])]
    return Joint(C, covariance, constant + float(b @ x), count, values)


def _called(name: str, k: int) -> str:
    """The name of an unknown among several campaigns: what is shared within the k-th is its own."""
    return f"{name} of campaign {k + 1}" if name.startswith("shared[") else name


def _registered(documents: Sequence[NormalsDocument]) -> dict[str, Unknown]:
    """Every unknown by its name, with the reference and prior of the campaign that has it first."""
    blocks: dict[str, Unknown] = {}
    for k, document in enumerate(documents):
        for unknown in document.unknowns:
            name = _called(unknown.name, k)
            known = blocks.setdefault(name, unknown)
            if name.startswith("landmark[") and not _same(known, unknown):
                raise InputError(
                    f"campaign {document.campaign!r}: found {name} at another place than before, or of another "
                    "survey; wanted one landmark under one name"
                )
    return blocks


def _same(a: Unknown, b: Unknown) -> bool:
    place = np.max(np.abs(np.array(a.reference) - np.array(b.reference))) <= SAME_PLACE_M
    return bool(place and np.allclose(np.array(a.covariance), np.array(b.covariance), rtol=1e-6, atol=1e-9))
