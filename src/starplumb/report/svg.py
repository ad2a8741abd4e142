"""Matplotlib figures in the report's style, and their SVG, which in a page follows its colours, light or dark.

Figures are drawn in the colours of the light page, one for each role; in a page's SVG these become CSS variables.
Text stays text (selected, searched, printed sharp); nothing depends on the day, the machine or the process.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

from ..io.text.libraries import keep_quiet
from ..io.text.visible import visible

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Drawing

INK, MUTED, GRID = "#1b1f24", "#57606a", "#d0d7de"
SERIES = ("#0b5cad", "#b54708", "#1a7f37", "#7a3fc4")
"""Those of ``style.css``, light."""
_VARIABLES = {
    INK: "--ink",
    MUTED: "--muted",
    GRID: "--grid",
    **dict(zip(SERIES, ("--one", "--two", "--three", "--four"), strict=True)),
}
WIDTH, HEIGHT = 4.6, 3.6
"""Inches at which figures are drawn, so that their letters can be read at the width of a phone and of half a page."""

_STYLE = {
    "font.family": "sans-serif",
    "font.size": 9.0,
    "date.converter": "concise",
    "text.color": INK,
    "text.parse_math": False,  # an identifier may hold a dollar sign
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.0,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "starplumb",
}


@contextmanager
def drawing(
    height: float = HEIGHT, width: float = WIDTH, columns: int = 1
) -> Iterator[tuple[Drawing, list[Axes]]]:
    """A figure with axes side by side, in the report's style while the context lasts."""
    keep_quiet("matplotlib")  # advice about caches, and about fonts
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(cast("Any", _STYLE)):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure, list(figure.subplots(1, columns, squeeze=False)[0])


def standalone(figure: Drawing) -> str:
    """The figure as the text of an SVG file on white ground."""
    return _saved(figure, facecolor="white")


def svg_text(figure: Drawing, name: str) -> str:
    """The figure as an ``<svg>`` element; ``name`` keeps its ids apart from those of other figures in the page."""
    text = _saved(figure)
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', _element, text, count=1)
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    return text.strip()


def _saved(figure: Drawing, **options: Any) -> str:
    import matplotlib

    buffer = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with matplotlib.rc_context(cast("Any", _STYLE)), warnings.catch_warnings():
        # the letters of an id that matplotlib's font lacks are drawn by the viewer, which has others
        warnings.filterwarnings("ignore", r"Glyph \d+ ", UserWarning)
        figure.savefig(buffer, format="svg", metadata=nothing, **options)
    return visible(buffer.getvalue())


def _element(found: re.Match[str]) -> str:
    """The opening tag with the drawing's proportions only, so that the page gives it its size."""
    return (
        f'<svg viewBox="{found[1]}" xmlns="http://www.w3.org/2000/svg" '
        'xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" focusable="false">'
    )
