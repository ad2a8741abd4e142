"""``starplumb compare``: every method on one campaign, side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table

    from ..io.campaign.read import LoadedCampaign
    from ..judge.compare import Answer
    from ..physics.so3 import Array

SCHEMA = "starplumb-compare/1"


def compare(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder that receives compare.json.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """All methods on one campaign: correction, sigma, difference from gls, time, and what each leaves out.

    Examples:

      starplumb compare demo/campaign.toml

      starplumb compare campaign.toml --json --out results
    """
    from ..estimators import METHODS
    from ..io.campaign.read import load_campaign
    from ..io.text.write import json_text, write_text
    from ..judge.compare import answers as run
    from ..physics.errors import AlignmentFailed

    speak = Output(json, quiet, verbose)
    loaded = load_campaign(campaign)
    answers = tuple(speak.watched(run(loaded.campaign), "Comparing", len(METHODS)))
    speak.notices(loaded.notices)
    document = _document(answers, loaded)
    if out is not None:
        write_text(out / "compare.json", json_text(document))
    speak.document(document)
    speak.show(
        _table(answers, loaded), *(f"{a.method}: {'; '.join(a.remarks)}" for a in answers if a.remarks)
    )
    if out is not None:
        speak.show(f"written: {out / 'compare.json'}")
    gls = next(answer for answer in answers if answer.method == "gls")
    if not gls.status.usable:
        raise AlignmentFailed(f"{campaign}: {gls.status.text}")


def _error(answer: Answer, C_EK_true: Array) -> Array:
    from ..physics import so3

    return so3.log(answer.C_EK @ C_EK_true.mT)


def _document(answers: tuple[Answer, ...], loaded: LoadedCampaign) -> dict[str, Any]:
    """``compare.json``; numbers that a method does not state are null."""
    from ..io.results.result import numbers
    from ..physics.units import ARCSEC

    def arcsec(values: Array | None) -> Any:
        return None if values is None else numbers(values / ARCSEC)

    methods = []
    for a in answers:
        known = a.status.usable
        entry = {
            "method": a.method,
            "status": a.status.name.lower(),
            "correction_arcsec": arcsec(a.correction_E) if known else None,
            "sigma_arcsec": arcsec(a.sigma_E),
            "naive_sigma_arcsec": arcsec(a.naive_sigma_E),
            "difference_from_gls_sigma": numbers(a.from_gls) if known else None,
            "seconds": a.seconds,
            "remarks": list(a.remarks),
        }
        if loaded.C_EK_true is not None:
            entry["error_arcsec"] = arcsec(_error(a, loaded.C_EK_true)) if known else None
        methods.append(entry)
    return {
        "schema": SCHEMA,
        "campaign": loaded.campaign.name,
        "methods": methods,
        "inputs": dict(loaded.inputs),
    }


def _table(answers: tuple[Answer, ...], loaded: LoadedCampaign) -> Table:
    """Three lines a method, about x, y, z of the star tracker: 80 columns hold it."""
    from rich import box
    from rich.table import Table

    from ..physics.units import ARCSEC

    truth = loaded.C_EK_true
    title = f"{loaded.campaign.name}: arcsec about the star tracker's axes"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, leading=1, pad_edge=False)
    table.add_column("method")
    table.add_column("")
    headings = ("correction", "sigma", "sigmas off gls", *(("error",) if truth is not None else ()), "ms")
    for heading in headings:
        table.add_column(heading, justify="right")
    for a in answers:
        if not a.status.usable:
            table.add_row(a.method, "", a.status.name.lower().replace("_", " "))
            continue
        cells = [
            _column(a.correction_E / ARCSEC),
            "not stated" if a.sigma_E is None else _column(a.sigma_E / ARCSEC),
            _column(a.from_gls),
        ]
        if truth is not None:
            cells.append(_column(_error(a, truth) / ARCSEC))
        table.add_row(a.method, "x\ny\nz", *cells, f"{1e3 * a.seconds:.1f}")
    return table


def _column(values: Array) -> str:
    return "\n".join(f"{value:z.2f}" for value in values)
