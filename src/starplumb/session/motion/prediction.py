"""The mounting at a time: what :func:`starplumb.predict` returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...documents.prediction import Prediction as Predicted
from ...documents.prediction import predicted
from ...documents.result import ResultDocument
from ...io.archive.store import is_archive
from ...io.text.files import read_text
from ...judge.trust import NORMAL_95
from ...physics import so3
from ...physics.errors import ArgumentError, EpochError, InputError
from ...physics.timescales import format_iso, moment
from ...physics.units import ARCSEC
from ...report.page import Table
from ..arguments import checked
from ..mounting import result_file
from ..result import Result
from ..show import Shown

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Prediction(Shown):
    """A mounting at a time with its covariance; ``document`` is what --json prints."""

    made_by: ClassVar[str] = "predict"

    document: dict[str, Any]

    @property
    def C_EK(self) -> Array:
        """The mounting (3, 3), from the camera to the star tracker."""
        return np.array(self.document["matrix"])

    @property
    def covariance_arcsec2(self) -> Array | None:
        """The covariance (3, 3) of its error about the star tracker's axes; None where the result states none."""
        stated = self.document["covariance_arcsec2"]
        return None if stated is None else np.array(stated)

    @property
    def notices(self) -> Sequence[str]:
        """What should be known of it."""
        return tuple(self.document["notices"])

    @property
    def tables(self) -> Sequence[Table]:
        d = self.document
        rows = [("turned from the result's matrix by", *(f"{x:.3f}" for x in d["correction_arcsec"]))]
        if d["sigma_arcsec"] is not None:
            rows.append(("sigma", *(f"{x:.3f}" for x in d["sigma_arcsec"])))
            rows.append(("95 % interval, +-", *(f"{x:.3f}" for x in d["interval_95_arcsec"])))
        caption = f"Mounting from {d['from']} to {d['to']} at {d['time']} {d['time_scale']}"
        return (Table(caption, ("arcsec about", "x", "y", "z"), rows),)

    @property
    def answer(self) -> Sequence[str]:
        """The quaternion."""
        return ("quaternion x y z w: " + " ".join(f"{q:.12f}" for q in self.document["quaternion_xyzw"]),)

    @property
    def sentences(self) -> Sequence[str]:
        return (*self.answer, *(f"note: {notice}" for notice in self.notices))


@checked
def predict(
    result: Result | str | Path,
    at: str,
    temperatures_c: Mapping[str, float] | None = None,
    satellite: str | None = None,
    camera: str | None = None,
) -> Prediction:
    """The mounting at a time and the covariance of its error, from a result or an archive alone.

    ``result`` is a Result, the path of a ``result.json``, of its folder, or of an archive, whose mounting is that
    which was issued for the time, else that of its trend (of ``satellite`` and ``camera``, where it has several); of a
    result of several cameras it is that of the first, or of ``camera``.
    ``at`` is an ISO 8601 time in UTC, the scale of the result; ``temperatures_c`` gives temperatures by name, for a
    mounting that moves with them.  Outside the span of the images the covariance grows, and a notice says so.  Raises
    InputError where the result must not be used, or the time is none.
    """
    if isinstance(result, str | Path) and is_archive(Path(result)):
        return Prediction(_of_archive(Path(result), at, satellite, camera))
    document, name = _document(result)
    if camera is not None and document.mountings:
        document = document.of_camera(camera)
    if not document.usable:
        raise InputError(
            f"{name}: status: found {document.status!r}, wanted a result whose mounting may be used (ok or weak)"
        )
    try:
        t_ns = moment(at, "UTC")
    except EpochError as error:
        raise ArgumentError("at", str(error)) from None
    found = predicted(document, t_ns, None, temperatures_c)
    return Prediction(_as_document(found, t_ns, (document.mounting.from_, document.mounting.to)))


def _as_document(found: Predicted, t_ns: int, frames: tuple[str, str]) -> dict[str, Any]:
    P = found.covariance_E
    sigma = None if P is None else np.sqrt(np.diagonal(P)) / ARCSEC
    return {
        "schema": "starplumb-prediction/1",
        "time": format_iso([t_ns], "UTC")[0],
        "time_scale": "UTC",
        "from": frames[0],
        "to": frames[1],
        "matrix": numbers(found.C_EK),
        "quaternion_xyzw": numbers(so3.to_quaternion(found.C_EK)),
        "correction_arcsec": numbers(found.turn_E / ARCSEC),
        "sigma_arcsec": None if sigma is None else numbers(sigma),
        "covariance_arcsec2": None if P is None else numbers(P / ARCSEC**2),
        "interval_95_arcsec": None if sigma is None else numbers(NORMAL_95 * sigma),
        "outside_span_s": found.outside_s,
        "notices": list(found.notices),
    }


def _of_archive(path: Path, at: str, satellite: str | None, camera: str | None) -> dict[str, Any]:
    from ..mission.archive import mounting_of
    from ..mission.known import time_of

    t_ns = time_of("at", at)
    found, instrument = mounting_of(path, t_ns, satellite, camera)
    return _as_document(found, t_ns, (instrument.frame_from, instrument.frame_to))


def _document(result: Result | str | Path) -> tuple[ResultDocument, str]:
    if isinstance(result, Result):
        return ResultDocument.of(result.document), "the result"
    path = result_file(Path(result))
    return ResultDocument.from_json(read_text(path), str(path)), str(path)
