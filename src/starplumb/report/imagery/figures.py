"""Figures of what was measured: a map of each image's chips, and the histogram of their residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...imagery.verdicts import Verdict
from ..page import Figure
from ..svg import INK, MUTED, SERIES, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Document = Mapping[str, Any]
Part = Mapping[str, Any]

BLUE, ORANGE, GREEN, VIOLET = SERIES
MARKS: Mapping[str, tuple[str, str]] = {
    "control": ("o", GREEN),
    "check": ("D", GREEN),
    Verdict.OUTLIER: ("X", ORANGE),
    Verdict.CHANGED: ("P", ORANGE),
    Verdict.NO_MATCH: ("x", ORANGE),
    Verdict.CLOUD: ("^", BLUE),
    Verdict.WATER: ("v", BLUE),
    Verdict.NO_TEXTURE: ("s", VIOLET),
    Verdict.SATURATED: ("*", VIOLET),
    Verdict.EDGE: ("+", MUTED),
    Verdict.NO_REFERENCE: (".", MUTED),
    "not used": (".", INK),
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
    with drawing() as (figure, (axes,)):
        for kind, (marker, colour) in MARKS.items():
            places = np.array([[c["column_px"], c["row_px"]] for c in mine if _kind(c) == kind])
            if len(places):
                label = f"{kind} {len(places)}"
                axes.plot(*places.T, marker, color=colour, markersize=5.0, label=label)
        largest = _residuals(axes, mine, columns)
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), aspect="equal")
        axes.set(xlabel="column (px)", ylabel="row (px)", title=name)
        if mine:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    counts = f"{image['used']} of {image['candidates']} chips used"
    said = f"{name}: {counts}" + (f"; the longest line is {largest:.2g} px" if largest else "")
    number = next(k for k, each in enumerate(document["images"]) if each["image_id"] == name)
    return Figure(figure, f"map{number}", f"Map of {name}: {counts}.", f"{said}.")


def _residuals(axes: Axes, mine: list[Part], columns: int) -> float:
    """Lines from the chips along their residuals; the longest residual, px, 0 for none."""
    used = [c for c in mine if c["role"] is not None and c["residual_column_px"] is not None]
    if not used:
        return 0.0
    at = np.array([[c["column_px"], c["row_px"]] for c in used])
    left = np.array([[c["residual_column_px"], c["residual_row_px"]] for c in used])
    largest = float(np.linalg.norm(left, axis=1).max())
    end = at + LINE * columns / (largest or 1.0) * left
    axes.plot([at[:, 0], end[:, 0]], [at[:, 1], end[:, 1]], color=INK, linewidth=0.8)
    return largest


def histogram(document: Document) -> Iterator[Figure]:
    """Residuals over their sigmas beside the normal law, where there are any."""
    used = [c for c in document["candidates"] if c["role"] is not None and c["normalised"] is not None]
    z = np.array([c["normalised"] for c in used]).ravel()
    if not z.size:
        return
    edges = np.linspace(-WIDEST, WIDEST, BINS)
    with drawing() as (figure, (axes,)):
        axes.hist(np.clip(z, -WIDEST, WIDEST), edges.tolist(), color=BLUE, alpha=0.55)
        at = np.linspace(-WIDEST, WIDEST, 201)
        normal = z.size * (edges[1] - edges[0]) * np.exp(-0.5 * at**2) / np.sqrt(2.0 * np.pi)
        axes.plot(at, normal, color=ORANGE, label="normal law")
        axes.set(xlabel="residual over the sigma of matching", ylabel="columns and rows of chips")
        axes.legend()
    far = int(np.sum(np.abs(z) > WIDEST))
    beyond = f"; {far} beyond {WIDEST:g} stand at the ends" if far else ""
    caption = f"{z.size} residuals of {len(used)} chips{beyond}."
    yield Figure(figure, "normalised", "Histogram of normalised residuals beside the normal law.", caption)
