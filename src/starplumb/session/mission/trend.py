"""The trend of an archive's mounting in a session: points, what moves it, what will be, and what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ...report.page import Table
from ..show import Shown


@dataclass(frozen=True, repr=False)
class TrendFound(Shown):
    """The mounting of a mission against time; ``document`` is what ``trend --json`` prints."""

    made_by: ClassVar[str] = "Archive.trend"

    document: dict[str, Any]

    @property
    def recommendation(self) -> str:
        """What to do, in a sentence."""
        return str(self.document["recommendation"]["sentence"])

    def page(self) -> str:
        """``trend.html``: one page that needs no other file."""
        from ...report.trend import trend_page

        return trend_page(self.document)

    @property
    def tables(self) -> Sequence[Table]:
        d = self.document
        rows = [
            (
                p["time"][:10],
                p["name"],
                *(_pm(v, s) for v, s in zip(p["value_arcsec"], p["sigma_arcsec"], strict=True)),
            )
            for p in d["points"]
        ]
        of = f" of {d['satellite']}" if d["satellite"] else ""
        title = f"Mounting{of} from {d['from']} to {d['to']}, arcsec from its mean"
        found = [Table(title, ("date", "campaign", "x", "y", "z"), rows, text_columns=2)]
        if d["changes"]:
            found.append(
                Table(
                    "What changes it",
                    ("change", "x, arcsec", "y", "z", "by chance", "on the ground"),
                    [_change_row(c) for c in d["changes"]],
                )
            )
        return tuple(found)

    @property
    def sentences(self) -> Sequence[str]:
        d = self.document
        kinds = ", ".join(f"{m['name']} {100 * m['weight']:.0f} %" for m in d["models"][:4])
        happened = [
            f"event: {e['time'][:10]} {e['kind']}{': ' * bool(e['note'])}{e['note']}" for e in d["events"]
        ]
        return (f"by evidence: {kinds}", *happened, self.recommendation)


def _pm(value: float, sigma: float) -> str:
    return f"{value:+.2f} ± {sigma:.2f}"


def _change_row(c: Mapping[str, Any]) -> tuple[str, ...]:
    sizes = (_pm(v, s) for v, s in zip(c["size_arcsec"], c["sigma_arcsec"], strict=True))
    ground = "" if c["ground_m"] is None else f"{c['ground_m']:.2f} m"
    return (c["words"], *sizes, f"{c['p']:.2g}", ground)
