"""A report as data (sections of sentences, tables and figures) and its rendering as one self-contained HTML page.

Every string is escaped by the template engine; only the figures, which :mod:`.charts.vector` has made, pass as they
are.  The page needs no network and no other file.  Its script, always the same, shows figures large and lets no other
script run; nothing is lost without it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .. import __version__
from ..io.text.visible import visible
from .text import counted

if TYPE_CHECKING:
    from jinja2 import Template
    from matplotlib.figure import Figure as Drawing

    from .cards import Card
    from .charts.chart import Chart

Tone = Literal["good", "fair", "bad"]
_INTERNAL = ("methods", "samples", "format")
"""What a fingerprint holds for who resumes a study: the methods as Python writes them, and how chunks are kept."""
_FOOT = "<footer><p>Made by starplumb "


@dataclass(frozen=True)
class Figure:
    """A chart, or several side by side, its description for those who cannot see it, and its caption.

    ``name`` is its own in the page.
    """

    chart: Chart | tuple[Chart, ...]
    name: str
    alt: str
    caption: str

    @property
    def charts(self) -> tuple[Chart, ...]:
        return self.chart if isinstance(self.chart, tuple) else (self.chart,)

    @property
    def svg(self) -> str:
        """The charts as an ``<svg>`` element of a page."""
        from .charts.vector import svg_text

        return svg_text(self.charts, self.name)

    @property
    def file(self) -> str:
        """The charts as the text of an SVG file on white ground."""
        from .charts.vector import standalone

        return standalone(self.charts, self.name)

    @property
    def drawing(self) -> Drawing:
        """The charts as a matplotlib figure."""
        from .charts.library import figure_of

        return figure_of(self.charts)


@dataclass(frozen=True)
class Table:
    """Cells as text; ``text_columns`` of them are to the left and read as text, the rest are numbers.

    ``marked`` are the rows to set apart (rejected, implausible); the last ``totals`` rows sum up the others; ``note``
    stands below.
    """

    caption: str
    head: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    text_columns: int = 1
    marked: frozenset[int] = frozenset()
    note: str = ""
    totals: int = 0


def seen(document: Mapping[str, Any]) -> str:
    """``4 sightings in 2 images``, of a scenario's document."""
    return f"{counted(document['sightings'], 'sighting')} in {counted(document['images'], 'image')}"


UNDATED = "The same inputs give the same page, so it has no date."


def made_with(fingerprint: Mapping[str, object], methods: Iterable[str], **further: object) -> Table:
    """What a page was made with: ``further`` facts and those of a fingerprint, a row each, the methods by name."""
    known = {name: value for name, value in fingerprint.items() if name not in _INTERNAL}
    facts = {**further, **known, "methods": ", ".join(methods)}
    rows = [(str(name), str(value)) for name, value in facts.items()]
    return Table("Made with", ("what", "value"), rows, text_columns=2, note=UNDATED)


@dataclass(frozen=True)
class Section:
    """One part of a report; ``anchor`` is its address in the page, ``panels`` are small figures to be compared."""

    anchor: str
    title: str
    sentences: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    bullets: tuple[str, ...] = ()
    cards: tuple[Card, ...] = ()
    panels: tuple[Figure, ...] = ()

    @property
    def empty(self) -> bool:
        return not (
            self.sentences or self.figures or self.tables or self.bullets or self.cards or self.panels
        )


@dataclass(frozen=True)
class Page:
    """A whole report: its summary sentence, a badge with the verdict, and the sections that have something to say."""

    title: str
    summary: str
    badge: str
    tone: Tone
    sections: tuple[Section, ...]
    kind: str = "report"
    remarks: tuple[str, ...] = field(default=())


def is_page(path: Path) -> bool:
    """Whether a file is a page of ours: by what it says at its end."""
    try:
        return path.is_file() and _FOOT in path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False


def render(page: Page) -> str:
    """The page as HTML text; the same for the same page, whenever and wherever it is rendered."""
    template, script, digest = _template()
    sections = [section for section in page.sections if not section.empty]
    text = template.render(page=page, sections=sections, version=__version__, script=script, digest=digest)
    return visible(text) + "\n"


@cache
def _template() -> tuple[Template, str, str]:
    """The template of all pages, their script and its digest."""
    from base64 import b64encode
    from hashlib import sha256
    from importlib.resources import files

    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("starplumb.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests["time"] = re.compile(r"\d{4}-\d\d-\d\d(T[\d:.]+)?").fullmatch
    environment.filters["signed"] = partial(re.compile(r"(?<![\w.)])-(?=\d)").sub, "−")
    script = (files("starplumb.report") / "templates" / "page.js").read_text(encoding="utf-8")
    digest = b64encode(sha256(script.encode()).digest()).decode()
    return environment.get_template("page.html.j2"), script, digest
