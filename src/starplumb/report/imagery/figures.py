"""Figures of what was measured: a map of each image's chips, and the histogram of their residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ...imagery.verdicts import Verdict
from ..amounts import histogram as density
from ..amounts import normalised
from ..charts.chart import Axis, Chart, Dots, Line, Mark, Role, Shape
from ..page import Figure

Document = Mapping[str, Any]
Part = Mapping[str, Any]

MARKS: Mapping[str, tuple[Shape, Role]] = {
    "control": ("o", "three"),
    "check": ("D", "three"),
    Verdict.OUTLIER: ("x", "two"),
    Verdict.CHANGED: ("<", "two"),
    Verdict.NO_MATCH: (">", "two"),
    Verdict.CLOUD: ("^", "one"),
    Verdict.WATER: ("v", "one"),
    Verdict.NO_TEXTURE: ("s", "four"),
    Verdict.SATURATED: ("*", "four"),
    Verdict.EDGE: ("+", "muted"),
    Verdict.NO_REFERENCE: (".", "muted"),
    "not used": (".", "ink"),
}
"""Marker and colour of each role or verdict: told apart without colours too."""
LINE = 0.06
"""Length of the largest residual's line, in widths of the image."""
WIDEST = 5.0
BINS = 41


def _kind(c: Part) -> str:
    verdict = str(c["verdict"])
    return str(c["role"]) if c["role"] is not None else "not used" if verdict == Verdict.USED else verdict


def image_map(document: Document, image: Part) -> Figure:
    """Where an image's chips lie, marked by their verdict, with the residuals of those used."""
    name, (columns, rows) = image["image_id"], image["size_px"]
    mine = [c for c in document["candidates"] if c["image_id"] == name]
    largest, residuals = _residuals(mine, columns)
    groups = [(kind, [c for c in mine if _kind(c) == kind]) for kind in MARKS]
    marks: tuple[Mark, ...] = (*residuals, *(_dots(found, kind) for kind, found in groups if found))
    x = Axis("column (px)", -0.5, columns - 0.5)
    y = Axis("row (px)", -0.5, rows - 0.5, reverse=True)
    chart = Chart(x, y, marks, equal=True, title=name)
    counts = f"{image['used']} of {image['candidates']} chips used"
    said = f"{name}: {counts}" + (f"; the longest line is {largest:.2g} px" if largest else "")
    number = next(k for k, each in enumerate(document["images"]) if each["image_id"] == name)
    return Figure(chart, f"map{number}", f"Map of {name}: {counts}.", f"{said}.")


def _dots(found: list[Part], kind: str) -> Dots:
    x, y = (np.array([c[key] for c in found], dtype=np.float64) for key in ("column_px", "row_px"))
    shape, role = MARKS[kind]
    tips = [str(c["landmark_id"]) for c in found]
    return Dots(x, y, role, shape, f"{kind} {len(found)}", tips)


def _residuals(mine: list[Part], columns: int) -> tuple[float, tuple[Line, ...]]:
    """The longest residual, px, 0 for none, and lines from the chips along their residuals."""
    used = [c for c in mine if c["role"] is not None and c["residual_column_px"] is not None]
    if not used:
        return 0.0, ()
    at = np.array([[c["column_px"], c["row_px"]] for c in used])
    left = np.array([[c["residual_column_px"], c["residual_row_px"]] for c in used])
    largest = float(np.linalg.norm(left, axis=1).max())
    end = at + LINE * columns / (largest or 1.0) * left
    x, y = np.stack([at, end, np.full_like(at, np.nan)], axis=1).reshape(-1, 2).T
    return largest, (Line(x, y, "ink", width=0.9),)


def histogram(document: Document) -> Iterator[Figure]:
    """Residuals over their sigmas beside the normal law, where there are any."""
    used = [c for c in document["candidates"] if c["role"] is not None and c["normalised"] is not None]
    z = np.array([c["normalised"] for c in used]).ravel()
    if not z.size:
        return
    h = normalised("normalised", "residual over its sigma", z, WIDEST, BINS)
    far = int(np.sum(np.abs(z) > WIDEST))
    beyond = f"; {far} beyond {WIDEST:g} stand at the ends" if far else ""
    caption = f"{z.size} residuals of {len(used)} chips{beyond}."
    yield density(h, "Histogram of normalised residuals beside the normal law.", caption)
