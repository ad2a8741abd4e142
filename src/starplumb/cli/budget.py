"""``starplumb budget``: sensitivities and error budget of a scenario without sampling."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table


def budget(
    scenario: Annotated[
        str, typer.Argument(help="A SCENARIO.toml, or the name of a shipped scenario.", metavar="SCENARIO")
    ],
    target: Annotated[
        float | None,
        typer.Option(
            "--target",
            "-t",
            min=1e-6,
            help="Wanted sigma about each axis, arcsec: what must shrink, and to what?",
        ),
    ] = None,
    methods: Annotated[
        str, typer.Option("--methods", "-m", help="Estimators, with commas between them.")
    ] = "gls",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for budget.json and report.html.")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Split the error of the alignment by its sources, without sampling.

    For each estimator: the sigma it has and the one it states, what every error source contributes, how sigma depends
    on it, and which directions are badly determined.

    Examples:

      starplumb budget vhr-0.3m --target 0.3

      starplumb budget scenario.toml --methods gls,wahba --out study
    """
    from ..io.scenario.read import load_scenario
    from ..io.text.write import json_text, publish
    from ..physics.units import ARCSEC
    from ..study.budget_document import document
    from .simulate import chosen_estimators

    speak = Output(json, quiet, verbose)
    found = document(
        load_scenario(scenario),
        chosen_estimators(methods),
        None if target is None else target * ARCSEC,
    )
    if out is not None:
        from ..report import budget_page

        publish(out, {"budget.json": json_text(found), "report.html": budget_page(found)})
    speak.document(found)
    speak.show(*_tables(found), *_sentences(found))
    if out is not None:
        speak.show(f"written: {out}")


def _tables(found: dict[str, Any]) -> Iterator[Table]:
    """Contributions, with the sensitivities beside them."""
    from rich.table import Table

    for name, method in found["methods"].items():
        table = Table(title=f"{name} in {found['scenario']}, arcsec about x, y, z of E", title_justify="left")
        for heading in ("source", "sigma", "contributes", "d sigma / d source"):
            table.add_column(heading, justify="left" if heading == "source" else "right")
        for share in method["sources"]:
            unit = next(key for key in share if key.startswith("sigma_")).removeprefix("sigma_")
            table.add_row(
                f"{share['source']} {share['component']}".strip(),
                f"{share[f'sigma_{unit}']:.4g} {unit}",
                _three(share["contribution_arcsec"]),
                f"{_three(share[f'sensitivity_arcsec_per_{unit}'])} per {unit}",
            )
        table.add_section()
        table.add_row("sigma it has", "", _three(method["sigma_arcsec"]), "")
        stated = method["stated_sigma_arcsec"]
        table.add_row("sigma it states", "", "none" if stated is None else _three(stated), "")
        yield table


def _three(values: list[float]) -> str:
    """Three figures; what is below a thousandth of the largest is shown as 0."""
    least = 1e-3 * max(values)
    return "  ".join(f"{value:.3g}" if value >= least else "0" for value in values)


def _sentences(found: dict[str, Any]) -> Iterator[str]:
    for name, method in found["methods"].items():
        for sentence in method["in_words"]:
            yield f"{name}: {sentence}"
    for name in found["left_out"]:
        yield f"left out: {name}, for blunders are no noise"
    if found["target"] is not None:
        yield f"for {found['target']['target_arcsec']:g} arcsec about each axis:"
        yield from found["target"]["in_words"]
