"""``starplumb reproduce``: the published tables beside what this package computes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options.complete import tables
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from ..published.comparison import Comparison, Row


ROUNDING = 1e-7
"""Less than this is rounding, in figures of some arc seconds and their sampling errors."""


def reproduce(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            autocompletion=tables,
            help="Tables: table1, table2, table3, table4 (paper of 2019), sensitivity, totals, algorithm1, "
            "images-sigma, images-max (slides of 2012); all of them when none is named.",
        ),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(
            "--trials", "-n", metavar="COUNT", min=2, max=100_000_000, help="Simulated runs of each table."
        ),
    ] = 10_000,
    seed: Annotated[
        int, typer.Option("--seed", "-s", metavar="NUMBER", min=0, help="Seed of all draws.")
    ] = 2019,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for reproduce.json.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Recompute the published tables beside the published figures, with a verdict for each row.

    Each cell shows our figure with its sampling error and, in brackets, the published one.  Rows without a published
    figure are what the documents could not have: gls on the same draws, and the Cramer-Rao bound.

    Examples:

      starplumb reproduce table1 --trials 2000

      starplumb reproduce --out reproduced
    """
    from ..io.text.write import marked, publish
    from ..published.reproduce import MARK, TABLES, document, verdicts
    from ..published.reproduce import reproduce as recompute

    output = Output(json, quiet, verbose)
    if out is not None:
        require_place(out, [MARK[0]], (), MARK)
    wanted = names or list(TABLES)
    output.detail(f"{trials} runs of each table, seed {seed}")
    tables = []
    for table in output.watched(recompute(wanted, trials, seed), "Recomputing", len(wanted)):
        tables.append(table)
        output.show(_rendered(table), *_remarks(table, trials), "")
    counts = verdicts(tables)
    output.show("Rows: " + ", ".join(f"{counts[verdict]} {verdict}" for verdict in counts))
    result = document(tables, trials, seed)
    if out is not None:
        publish(out, {}, mark=marked(MARK[0], result))
    output.document(result)


def _rendered(comparison: Comparison) -> str:
    """The table in aligned columns, as wide as it must be: a terminal may scroll it, a file keeps it."""
    head = ["", *comparison.columns, "verdict"]
    body = [[row.label, *_cells(row), row.verdict or ""] for row in comparison.rows]
    width = [max(len(line[i]) for line in (head, *body)) for i in range(len(head))]
    lines = [f"{comparison.name}: {comparison.title}", ""]
    for line in (head, ["-" * w for w in width], *body):
        first, *cells, last = line
        padded = [cell.rjust(w) for cell, w in zip(cells, width[1:-1], strict=True)]
        lines.append("  ".join([first.ljust(width[0]), *padded, last]).rstrip())
    return "\n".join([*lines, ""])


def _cells(row: Row) -> list[str]:
    """Our figures with their sampling errors, each with the published one in brackets where there is one."""
    printed = [math.nan] * len(row.ours.value) if row.published is None else list(row.published)
    cells = []
    for value, error, figure in zip(row.ours.value, row.ours.sampling, printed, strict=True):
        spread = f"±{error:.2g}" if error > ROUNDING else ""
        brackets = f" ({_figure(figure)})" if figure == figure else ""
        cells.append(_figure(value) + spread + brackets if value == value else "")
    return cells


def _figure(value: float) -> str:
    """Three digits; what is only rounding is zero."""
    if abs(value) < ROUNDING:
        return "0"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.4g}"


def _remarks(comparison: Comparison, asked: int) -> list[str]:
    """Source, runs, notes, and the reason of every row that does not agree."""
    less = (
        ""
        if comparison.runs == asked
        else f" of the {asked} asked for: its figures stem from whole series of runs"
    )
    lines = [f"{comparison.source}", f"{comparison.runs} runs of ours{less}."]
    lines += comparison.notes
    reasons: dict[str, list[str]] = {}
    for row in comparison.rows:
        if row.why:
            reasons.setdefault(row.why, []).append(row.label)
    return lines + [f"{', '.join(labels)}: {why}" for why, labels in reasons.items()]
