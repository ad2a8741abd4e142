"""``starplumb budget``: sensitivities and error budget of a scenario without sampling."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options.common import MethodsOption, ScenarioArgument
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose


def budget(
    scenario: ScenarioArgument,
    target: Annotated[
        float | None,
        typer.Option(
            "--target",
            "-t",
            metavar="ARCSEC",
            min=1e-6,
            help="Required sigma about each axis, arcsec; prints which error must shrink, and to what.",
        ),
    ] = None,
    methods: MethodsOption = "gls",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for budget.json and report.html."),
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
    from ..session.budget import BUDGET_FILES, MARK
    from ..session.budget import budget as run
    from ..session.scenario import scenario as read

    speak = Output(json, quiet, verbose)
    asked = read(scenario)
    if out is not None:
        require_place(out, BUDGET_FILES, [scenario], MARK)
    found = run(asked, methods, target)
    if out is not None:
        found.save(out)
    speak.document(found.document)
    speak.shown(found, *([] if out is None else [f"written: {out}"]))
