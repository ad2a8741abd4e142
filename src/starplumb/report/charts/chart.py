"""A chart as data: what is drawn over two axes, by the role of its colour, without a drawing library.

:mod:`.vector` writes it as SVG for a page or a file, :mod:`.library` hands it to matplotlib.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Role = Literal["ink", "muted", "grid", "one", "two", "three", "four"]
Shape = Literal["o", "^", "s", "D", "x", "+", "*", "v", "<", ">", "."]

Dash = Literal["-", "--", ":", "-."]

COLOURS: dict[Role, str] = {
    "ink": "#1b1f24",
    "muted": "#57606a",
    "grid": "#d0d7de",
    "one": "#0b5cad",
    "two": "#b54708",
    "three": "#1a7f37",
    "four": "#7a3fc4",
}
"""Those of ``style.css``, light; in a page each is its CSS variable, which follows the page into the dark."""
SERIES: tuple[Role, ...] = ("one", "two", "three", "four")
SHAPES: tuple[Shape, ...] = ("o", "^", "s", "D")
WIDTH, HEIGHT = 460.0, 340.0
"""Of a chart in its own units, of which a letter takes twelve: all have one form, so that they stand in even rows."""


@dataclass(frozen=True)
class Dots:
    """Marks at ``x, y`` (n,); ``tips`` (n) are read when the pointer rests on one."""

    x: Array
    y: Array
    role: Role = "one"
    shape: Shape = "o"
    name: str = ""
    tips: Sequence[str] = ()
    filled: bool = False
    size: float = 1.0


@dataclass(frozen=True)
class Line:
    """A polyline through ``x, y`` (n,), broken where one is not finite; ``dash`` as in matplotlib."""

    x: Array
    y: Array
    role: Role = "ink"
    dash: Dash = "-"
    name: str = ""
    width: float = 1.5


@dataclass(frozen=True)
class Arrows:
    """Arrows from ``x, y`` (n,) of ``right, up`` (n,), shares of the drawing's width to the reader's right and up."""

    x: Array
    y: Array
    right: Array
    up: Array
    role: Role = "one"
    name: str = ""
    tips: Sequence[str] = ()


@dataclass(frozen=True)
class Boxes:
    """Rectangles (n,): bars, and the steps of a histogram."""

    left: Array
    right: Array
    low: Array
    high: Array
    role: Role = "one"
    name: str = ""
    opacity: float = 1.0
    tips: Sequence[str] = ()


@dataclass(frozen=True)
class Area:
    """What lies between ``low`` and ``high`` (n,) over ``x`` (n,)."""

    x: Array
    low: Array
    high: Array
    role: Role = "one"
    name: str = ""
    opacity: float = 0.2


Mark = Dots | Line | Arrows | Boxes | Area


@dataclass(frozen=True)
class Axis:
    """One axis between ``low`` and ``high``.

    ``names`` are those of the places 0, 1, 2, ..., and nothing else is then written beside it; ``dates`` counts days
    from 1970; ``reverse`` lets it grow to the left or downwards; without ``ticks`` nothing is written at it.
    """

    label: str
    low: float
    high: float
    names: tuple[str, ...] = ()
    log: bool = False
    reverse: bool = False
    ticks: bool = True
    dates: bool = False


@dataclass(frozen=True)
class Key:
    """How long an arrow of a certain size is: its share of the drawing's width, and the size in words."""

    share: float
    text: str


@dataclass(frozen=True)
class Chart:
    """Marks over two axes; ``equal`` has their units the same length on paper."""

    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    width: float = WIDTH
    height: float = HEIGHT
    equal: bool = False
    key: Key | None = None
    title: str = ""


def span(values: Sequence[Array], margin: float = 0.05, least: float = 0.0) -> tuple[float, float]:
    """Ends of an axis that holds all finite values with a margin, at least ``least`` wide; (0, 1) for none.

    Where all values are alike but for rounding it is a tenth of them wide, or 1.
    """
    found = [v[np.isfinite(v)] for v in values]
    whole = np.concatenate(found) if found else np.empty(0)
    if not whole.size:
        return 0.0, 1.0
    low, high = float(whole.min()), float(whole.max())
    size = max(abs(low), abs(high))
    alike = high - low <= max(1e-9 * size, 1e-12)
    room = max(least, (0.1 * size if size > 1e-12 else 1.0) if alike and not least else high - low)
    middle, half = 0.5 * (low + high), (0.5 + margin) * room
    return middle - half, middle + half
