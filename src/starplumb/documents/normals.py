"""``normals.json``: additive normal equations of a campaign, image by image, over named unknowns; and their sum."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Annotated, Any, Literal, Self

import numpy as np
from annotated_types import Ge, Len
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ..estimators.fit import Fit
from ..judge.calibrate import Calibration
from ..judge.parameters.separability import of_camera
from ..judge.snooping import fit_at
from ..mission.cameras import about_camera
from ..mission.joint import KNOWN_TOGETHER, MOUNTING, TIE, Equations, Joint, Known, joint, summed
from ..physics import so3
from ..physics.errors import InputError
from ..physics.timescales import format_iso
from ..physics.units import ARCSEC
from ..solve.normals import ImageNormals, image_normals
from ..table.cameras.known import RANGE
from ..table.parameter_names import UNITS, unit_of
from .cameras.turned import Turned, turned_of
from .document import Document, Finite, Matrix3, Part, require_shape, require_times
from .numbers import numbers

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NORMALS_SCHEMA = "starplumb-normals/1"
MOST_IMAGES = 2_000
"""Images up to which the file is written: it takes half a millisecond for each."""
MOST_NUMBERS = 500_000
"""Entries of all equations up to which the file is written (10 MB): with more it would be larger than what it is of."""
SAME_PLACE_M = 1e-3
"""Places of one landmark in two campaigns may differ by so much and still be the same."""
LANDMARK = "landmark["
SURVEY_AXES = ("east", "north", "up")


class Unknown(Part):
    """A block of unknowns: its name and unit, the value about which the equations are, and what is ``expected`` of it
    beforehand with which covariance (null: nothing is known).  The mounting turns by it, ``exp(x) matrix``, and that of
    a further camera, ``mounting[NAME]``, by ``exp(x) exp(reference)``; of a landmark it is the surveyed place with its
    error."""

    name: str
    unit: str
    reference: Annotated[list[Finite], Len(1)]
    expected: list[Finite]
    covariance: list[list[Finite]] | None

    @model_validator(mode="after")
    def _of_one_size(self) -> Self:
        n = len(self.reference)
        require_shape(f"{self.name}.expected", self.expected, (n,))
        if self.covariance is not None:
            require_shape(f"{self.name}.covariance", self.covariance, (n, n))
        return self


class ImageEquations(Part):
    """Normal equations of one image over blocks by name: upper triangle of the information, row by row, and vector;
    ``sightings`` is a digest of its marks.  Of several cameras those of a moment, with the digests of the images
    ``also`` taken then: the errors that these share are eliminated."""

    image_id: str
    time: str
    unknowns: list[str]
    information: list[Finite]
    vector: Annotated[list[Finite], Len(1)]
    constant: Finite
    count: Annotated[int, Ge(0)]
    sightings: str | None = None
    also: dict[str, str] | None = None

    @model_validator(mode="after")
    def _of_one_size(self) -> Self:
        n = len(self.vector)
        require_shape(f"{self.image_id}.information", self.information, (n * (n + 1) // 2,))
        return self


class NormalsDocument(Document):
    """``normals.json``; the unknowns of an image are ``z + A x`` about the references, with least squares at
    ``x = -N^-1 b``."""

    schema_: Literal["starplumb-normals/1"] = Field(alias="schema")
    campaign: str
    camera: str | None = None
    matrix: Matrix3
    unknowns: list[Unknown]
    images: list[ImageEquations]

    @model_validator(mode="after")
    def _names_what_it_has(self) -> Self:
        """Every block of an image is one of the unknowns, each of which stands once, and its vector has their size."""
        size = {unknown.name: len(unknown.reference) for unknown in self.unknowns}
        if len(size) != len(self.unknowns) or size.get(MOUNTING) != 3:
            raise ValueError(f"unknowns: found a name twice, or no {MOUNTING} of three, wanted each once")
        if self.images:
            require_times([image.time for image in self.images])
        for image in self.images:
            if not size.keys() >= set(image.unknowns):
                raise ValueError(f"{image.image_id}.unknowns: found a name that is not among the unknowns")
            n = sum(size[name] for name in image.unknowns)
            require_shape(f"{image.image_id}.vector", image.vector, (n,))
        return self


def normals_document(calibration: Calibration) -> dict[str, Any] | None:
    """``normals.json`` of a usable answer as a dictionary; None where the method's equations are not known, or there
    are too many of them."""
    c, unknowns = calibration, calibration.estimate.unknowns
    if not c.status.usable or unknowns is None or len(c.campaign.images.ids) > MOST_IMAGES:
        return None
    o, used = c.observations, c.residuals.used
    named = _named_landmarks(c, len(unknowns.names) + len(o.common_of or ()))
    if named is None:
        return None
    fit = _about_errors(fit_at(unknowns, o, c.campaign.C_EK, c.estimate, used))
    turned = turned_of(c)
    common, scale = _common(fit, c.campaign.landmarks.sources or ("",), turned)
    places = [_place(c, int(i)) for i in named]
    names = [unknown["name"] for unknown in common]
    together = _known_together(c, turned)
    return {
        "schema": NORMALS_SCHEMA,
        "campaign": c.campaign.name,
        **({} if turned is None else {"camera": turned.names[0]}),
        "matrix": numbers(c.estimate.C_EK),
        "unknowns": [*common, *together, *places],
        "images": [_image(c, one, names, scale, turned) for one in image_normals(fit.whole, named)],
    }


def _about_errors(fit: Fit) -> Fit:
    """The fit about the errors of the images, as its answer has them: about none the directions of the design are off
    by them, which is little of a mounting, and more of a camera's against the first, known a hundred times better."""
    errors = fit.whole.image_errors(fit.step(), np.array(False))
    return replace(fit, state=replace(fit.state, errors=errors))


def _named_landmarks(c: Calibration, others: int) -> Index | None:
    """Landmarks whose places are among the unknowns: all that are used, for other campaigns may see them, or those seen
    again if that would be too many numbers; None where even these are."""
    o, used = c.observations, c.residuals.used
    times = np.bincount(o.landmark[used], minlength=o.n_landmarks)
    for least, most in ((1, MOST_NUMBERS // 4), (2, MOST_NUMBERS)):
        named = np.flatnonzero(times >= least)
        seen = np.bincount(o.image[used][np.isin(o.landmark[used], named)], minlength=o.n_images)
        if np.sum((3.0 + others + 3.0 * seen) ** 2) <= 2 * most:
            return named
    return None


def _common(fit: Fit, surveys: Sequence[str], turned: Turned | None) -> tuple[list[dict[str, Any]], Array]:
    """The unknowns that all images may have, as the adjustment orders them, and what one of each is in SI."""
    names, shared = fit.unknowns.names, fit.table.common_of or ()
    units = [unit_of(name) for name in names]
    scale = np.array([ARCSEC] * 3 + [UNITS[unit] for unit in units] + [1.0] * len(shared))
    information, step = fit.whole.prior
    reference = np.concatenate([np.zeros(3), fit.state.values, np.zeros(len(shared))])
    known = bool(np.any(information[:3, :3]))
    # of several cameras the first one's part of what is known: less than all of it, never more
    P = np.asarray(np.linalg.inv(information)[:3, :3] / ARCSEC**2) if known else None
    blocks = [_block(MOUNTING, "arcsec", np.zeros(3), step[:3] / ARCSEC, P)]
    labels = [*names, *_shared_labels(shared, surveys)]
    cameras = {} if turned is None else dict(zip(turned.at[:, 0].tolist(), _cameras(turned), strict=True))
    for k, (label, unit) in enumerate(zip(labels, [*units, *[""] * len(shared)], strict=True), start=3):
        if k in cameras:
            blocks.append(cameras[k])
        if of_camera(label):
            continue
        variance = 1.0 / (information[k, k] * scale[k] ** 2)
        at = reference[k] / scale[k]
        blocks.append(
            _block(label, unit, np.array([at]), np.array([at + step[k] / scale[k]]), np.array([[variance]]))
        )
    return blocks, scale


def _cameras(turned: Turned) -> Iterator[dict[str, Any]]:
    """The blocks of further cameras' mountings: what is known beforehand is that the model is not far off."""
    for name, v in zip(turned.blocks[1:], turned.references(), strict=True):
        yield _block(name, "arcsec", v, v, (RANGE / ARCSEC) ** 2 * np.eye(3))


def _known_together(c: Calibration, turned: Turned | None) -> list[dict[str, Any]]:
    """What was known beforehand of all mountings with one covariance, where that was."""
    known = c.observations.rig_known
    if turned is None or known is None:
        return []
    expected = so3.log(c.campaign.C_EK @ known.C_KC @ turned.C_EC.mT).reshape(-1) / ARCSEC
    zero = np.zeros(expected.size)
    return [_block(KNOWN_TOGETHER, "arcsec", zero, expected, known.covariance_E / ARCSEC**2)]


def _shared_labels(shared: Sequence[str], surveys: Sequence[str]) -> Iterator[str]:
    """Names of errors in common: those of a survey, which other campaigns have too, by its name."""
    of_survey = iter([f"survey[{name}] {axis}" for name in dict.fromkeys(surveys) for axis in SURVEY_AXES])
    for k, name in enumerate(shared):
        yield next(of_survey) if name == "survey" else f"shared[{name} {k + 1}]"


def _sightings(c: Calibration, image: int) -> str:
    """Digest of the marks of an image that are used: by which another campaign with the same ones is known."""
    s, ids = c.campaign.sightings, c.campaign.landmarks.ids
    mine = np.flatnonzero(c.residuals.used & (s.image == image))
    rows = sorted(
        f"{ids[i]} {x!r} {y!r}"
        for i, x, y in zip(
            s.landmark[mine].tolist(), s.column_px[mine].tolist(), s.row_px[mine].tolist(), strict=True
        )
    )
    return sha256("\n".join(rows).encode()).hexdigest()[:16]


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
    return _block(_landmark(c, landmark), "m", r_J, r_J, P)


def _landmark(c: Calibration, landmark: int) -> str:
    """The name of a landmark's place; nobody else knows that of a tie point, which is the campaign's own."""
    kind = LANDMARK if c.campaign.landmarks.surveyed[landmark] else TIE
    return f"{kind}{c.campaign.landmarks.ids[landmark]}]"


def _image(
    c: Calibration, one: ImageNormals, names: Sequence[str], scale: Array, turned: Turned | None
) -> dict[str, Any]:
    turn, images = c.campaign.turn_E, c.campaign.images
    one = one if turn is None else one.moved(turn[one.image])  # the data know of no motion
    s = np.concatenate([scale, np.ones(3 * one.landmarks.size)])
    taken, also = [one.image], {}
    if turned is not None:
        mine = c.residuals.used & (c.observations.image == one.image)
        taken = np.unique(c.campaign.sightings.image[mine]).tolist()
        there = np.isin(np.arange(len(turned.names)), np.asarray(c.observations.camera)[mine])
        one, stays = turned.of_moment(one, there)
        s, absent = s[stays], {name for name, seen in zip(turned.blocks, there, strict=True) if not seen}
        names = [name for name in names if name not in absent]
        also = {"also": {images.ids[i]: _sightings(c, i) for i in taken[1:]}}
    N = one.information * s[:, None] * s
    landmarks = [_landmark(c, int(i)) for i in one.landmarks]
    return {
        "image_id": images.ids[taken[0]],
        "time": format_iso(images.t_ns[one.image : one.image + 1], "UTC")[0],
        "unknowns": [*names, *landmarks],
        "information": numbers(N[np.triu_indices(s.size)]),
        "vector": numbers(one.vector * s),
        "constant": one.constant,
        "count": one.count,
        "sightings": _sightings(c, taken[0]),
        **also,
    }


def equations_of(document: NormalsDocument, number: int = 0, camera: str | None = None) -> Equations:
    """The equations of a campaign over unknowns by name, as its first camera or another one has them; what its images
    share is its own, by its ``number``."""
    blocks = {
        _called(u.name, number): Known(
            np.array(u.reference),
            np.array(u.expected),
            None if u.covariance is None else np.array(u.covariance),
        )
        for u in document.unknowns
    }
    images = (
        (
            [_called(name, number) for name in image.unknowns],
            symmetric(np.array(image.information), len(image.vector)),
            np.array(image.vector),
            image.constant,
            image.count,
        )
        for image in document.images
    )
    whole, first = summed(np.array(document.matrix), blocks, images), document.camera
    return whole if first is None or camera is None else about_camera(whole, first, camera, RANGE)


def symmetric(upper: Array, size: int) -> Array:
    """The matrix (size, size) of its upper triangle, row by row."""
    N = np.zeros((size, size))
    N[np.triu_indices(size)] = upper
    return N + np.triu(N, 1).T


def joined(documents: Sequence[NormalsDocument]) -> Joint:
    """Sum of the normal equations of campaigns, what is known beforehand added once.

    Unknowns of one name are one unknown, errors shared within a campaign its own.  Raises InputError where a landmark
    of one name has another place or another survey.
    """
    _require_one_place(documents)
    camera = documents[0].camera
    return joint([equations_of(document, k, camera) for k, document in enumerate(documents)])


def _called(name: str, k: int) -> str:
    """The name of an unknown among several campaigns: what is shared within the k-th is its own."""
    return f"{name} of campaign {k + 1}" if name.startswith("shared[") else name


def _require_one_place(documents: Sequence[NormalsDocument]) -> None:
    places: dict[str, Unknown] = {}
    for document in documents:
        for unknown in document.unknowns:
            known = places.setdefault(unknown.name, unknown)
            if unknown.name.startswith(LANDMARK) and not same_place(
                np.array(known.reference),
                np.array(known.covariance),
                np.array(unknown.reference),
                np.array(unknown.covariance),
            ):
                raise InputError(
                    f"campaign {document.campaign!r}: found {unknown.name} at another place than before, or of another "
                    "survey; wanted one landmark under one name"
                )


def same_place(a_J: Array, P_a: Array, b_J: Array, P_b: Array) -> bool:
    """Whether two places (3,) m with covariances (3, 3) of their survey may be those of one landmark."""
    close = np.max(np.abs(a_J - b_J)) <= SAME_PLACE_M
    return bool(close and np.allclose(P_a, P_b, rtol=1e-6, atol=1e-9))
