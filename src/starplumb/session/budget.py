"""The error budget of a scenario, without sampling."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..physics.units import ARCSEC
from ..report.page import Table
from ..study.budget_document import SCHEMA, document
from ..study.cameras import asked_of
from .arguments import Folder, Positive, checked
from .calibration import estimators_of, method_of
from .frames import Frame
from .scenario import Scenario
from .show import Shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

MARK = ("budget.json", SCHEMA)
BUDGET_FILES = (MARK[0], "report.html")
_GAP = "  "


@dataclass(frozen=True, repr=False, eq=False)
class Budget(Shown):
    """What each error source contributes: what :func:`starplumb.budget` returns.  ``document`` is ``budget.json``."""

    document: dict[str, Any]

    @property
    def frame(self) -> Frame:
        """A row for each method and component of a source."""
        rows = [
            (name, *_label(share), *share["contribution_arcsec"])
            for name, method in self.document["methods"].items()
            for share in method["sources"]
        ]
        names = (
            "method",
            "source",
            "component",
            "sigma",
            "unit",
            *(f"contribution_{a}_arcsec" for a in "xyz"),
        )
        return Frame("Budget", names, tuple(list(column) for column in zip(*rows, strict=True)))

    def to_frame(self) -> DataFrame:
        """A row for each method and component of a source, as a pandas data frame."""
        return self.frame.to_frame()

    @checked
    def plot(self, method: str | None = None) -> Figure:
        """What each source alone contributes to the error of a method, by default the first."""
        from ..report.budget import contributions
        from ..report.charts.library import figure_of

        name = method_of(self.document, method)
        figures = contributions(name, self.document["methods"][name]["sources"])
        return figure_of([chart for figure in figures for chart in figure.charts])

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``budget.json`` and ``report.html``."""
        from ..io.text.write import marked, publish
        from ..report.budget import budget_page

        files = {"report.html": budget_page(self.document)}
        publish(Path(folder), files, mark=marked(MARK[0], self.document))

    @property
    def tables(self) -> Sequence[Table]:
        return [_table(name, self.document, method) for name, method in self.document["methods"].items()]

    @property
    def sentences(self) -> Sequence[str]:
        return list(_sentences(self.document))


@checked
def budget(
    scenario: Scenario, methods: Sequence[str] | str = "gls", target_arcsec: Positive | None = None
) -> Budget:
    """Split the error of the alignment by its sources.

    With ``target_arcsec``, the wanted sigma about each axis, also what each source must shrink to.
    """
    target = None if target_arcsec is None else target_arcsec * ARCSEC
    return Budget(document(scenario.data, asked_of(scenario.data, estimators_of(methods)), target))


def _label(share: dict[str, Any]) -> tuple[str, str, float, str]:
    """Source, component, sigma and its unit."""
    unit = next(key for key in share if key.startswith("sigma_")).removeprefix("sigma_")
    return str(share["source"]), str(share["component"]), float(share[f"sigma_{unit}"]), unit


def _table(name: str, found: dict[str, Any], method: dict[str, Any]) -> Table:
    """Contributions, with the sensitivities beside them."""
    from ..report.budget import NOTE, contributed, slopes
    from ..report.text import number

    rows = []
    for share in method["sources"]:
        source, component, sigma, unit = _label(share)
        rows.append(
            (
                f"{source} {component}".strip(),
                f"{sigma:.4g} {unit}",
                _GAP.join(contributed(share, method["sources"])),
                _GAP.join(slopes(share, method["sigma_arcsec"])),
            )
        )
    stated = method["stated_sigma_arcsec"]
    rows.append(("sigma it has", "", _GAP.join(map(number, method["sigma_arcsec"])), ""))
    rows.append(("sigma it states", "", "none" if stated is None else _GAP.join(map(number, stated)), ""))
    head = ("source", "sigma", "contributes", "d sigma / d source")
    caption = f"{name} in {found['scenario']}, arcsec about x, y, z of E; slopes per unit of the source"
    return Table(caption, head, rows, note=NOTE, totals=2)


def _sentences(found: dict[str, Any]) -> Iterator[str]:
    for name, method in found["methods"].items():
        for sentence in method["in_words"]:
            yield f"{name}: {sentence}"
    if found["motion"] is not None:
        yield f"a motion of the mounting: {found['motion']['in_words']} found"
    for name in found["left_out"]:
        yield f"left out: {name} (blunders are not noise)"
    if found["target"] is not None:
        yield f"for {found['target']['target_arcsec']:g} arcsec about each axis:"
        yield from found["target"]["in_words"]
