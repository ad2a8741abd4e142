"""Every method on one campaign, side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..documents.numbers import numbers
from ..estimators import METHODS, methods
from ..judge.compare import Answer, answers
from ..physics import so3
from ..physics.errors import AlignmentFailed
from ..physics.units import ARCSEC
from ..report.page import Table
from .arguments import Folder, checked
from .calibration import Starting
from .campaign import Campaign
from .frames import Frame
from .show import Shown

Array = NDArray[Any]
Watch = Callable[[Iterable[Answer], int], Iterable[Answer]]
"""Passes the answers on as they come, and shows how many of how many there are."""

SCHEMA = "starplumb-compare/1"
MARK = ("compare.json", SCHEMA)


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Shown):
    """What each method makes of a campaign: what :func:`starplumb.compare` returns."""

    campaign: Campaign
    answers: tuple[Answer, ...]

    @cached_property
    def document(self) -> dict[str, Any]:
        """``compare.json`` as a dictionary; numbers that a method does not state are None."""
        loaded = self.campaign.loaded
        return {
            "schema": SCHEMA,
            "campaign": loaded.campaign.name,
            "methods": [_entry(answer, loaded.C_EK_true) for answer in self.answers],
            "inputs": dict(loaded.inputs),
        }

    def raise_if_unusable(self) -> None:
        """Raise AlignmentFailed where the default method has no usable answer."""
        default = next(answer for answer in self.answers if answer.method == "default")
        if not default.status.usable:
            raise AlignmentFailed(f"{self.campaign.source}: {default.status.text}")

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``compare.json``."""
        from ..io.text.write import marked, publish

        mark = marked(MARK[0], self.document)
        publish(Path(folder), {}, mark=mark, inputs=self.campaign.loaded.sources)

    @property
    def frame(self) -> Frame:
        """A row for each method: status, correction and sigma about x, y, z of the star tracker, time."""
        rows = [(a.method, a.status.name.lower(), *_six(a), a.seconds) for a in self.answers]
        axes = [f"{what}_{axis}_arcsec" for what in ("correction", "sigma") for axis in "xyz"]
        columns = [list(column) for column in zip(*rows, strict=True)]
        return Frame("Methods", ("method", "status", *axes, "seconds"), tuple(columns))

    @property
    def tables(self) -> Sequence[Table]:
        truth = self.campaign.C_EK_true
        head = (
            "method",
            "",
            "correction",
            "sigma",
            "sigmas off gls",
            *(("error",) if truth is not None else ()),
            "ms",
        )
        rows = [_row(answer, truth, len(head)) for answer in self.answers]
        title = f"{self.campaign.name}: arcsec about the star tracker's axes"
        return (Table(title, head, rows, text_columns=2),)

    @property
    def sentences(self) -> Sequence[str]:
        return tuple(f"{a.method}: {'; '.join(a.remarks)}" for a in self.answers if a.remarks)


@checked
def compare(
    campaign: Campaign, watch: Watch = lambda found, _total: found, start: Starting = "closed-form"
) -> Comparison:
    """All methods on one campaign: correction, sigma, difference from gls, time, and what each leaves out.

    ``start="model"`` has those that start somewhere do so at the model mounting, as published, in place of the closed
    form.  Raises InputError where there is nothing to use.
    """
    campaign.require_observations()
    campaign.require_one_camera("the comparison of methods")
    found = answers(campaign.loaded.campaign, methods(start))
    return Comparison(campaign, tuple(watch(found, len(METHODS))))


def _error(answer: Answer, C_EK_true: Array) -> Array:
    return so3.log(answer.C_EK @ C_EK_true.mT)


def _arcsec(values: Array | None) -> Any:
    return None if values is None else numbers(values / ARCSEC)


def _six(a: Answer) -> tuple[float, ...]:
    """Correction and sigma, arcsec; NaN for what the method does not state."""
    nothing = (float("nan"),) * 3
    correction = _arcsec(a.correction_E) if a.status.usable else nothing
    return (*correction, *(_arcsec(a.sigma_E) or nothing))


def _entry(a: Answer, C_EK_true: Array | None) -> dict[str, Any]:
    usable = a.status.usable
    entry = {
        "method": a.method,
        "status": a.status.name.lower(),
        "correction_arcsec": _arcsec(a.correction_E) if usable else None,
        "sigma_arcsec": _arcsec(a.sigma_E),
        "naive_sigma_arcsec": _arcsec(a.naive_sigma_E),
        "difference_from_gls_sigma": numbers(a.from_gls) if usable else None,
        "seconds": a.seconds,
        "remarks": list(a.remarks),
    }
    if C_EK_true is not None:
        entry["error_arcsec"] = _arcsec(_error(a, C_EK_true)) if usable else None
    return entry


def _row(a: Answer, truth: Array | None, width: int) -> tuple[str, ...]:
    """A method's cells, three lines each: x, y, z."""
    if not a.status.usable:
        return (a.method, "", a.status.name.lower().replace("_", " "), *("",) * (width - 3))
    cells = [
        _column(a.correction_E / ARCSEC),
        "not stated" if a.sigma_E is None else _column(a.sigma_E / ARCSEC),
        _column(a.from_gls),
    ]
    if truth is not None:
        cells.append(_column(_error(a, truth) / ARCSEC))
    return (a.method, "x\ny\nz", *cells, f"{1e3 * a.seconds:.1f}")


def _column(values: Array) -> str:
    return "\n".join(f"{value:z.2f}" for value in values)
