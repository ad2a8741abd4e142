"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .complete import methods, scenarios, starts

CampaignArgument = Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")]
ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="A SCENARIO.toml, or the name of a shipped scenario.",
        metavar="SCENARIO",
        autocompletion=scenarios,
    ),
]
MethodsOption = Annotated[
    str,
    typer.Option(
        "--methods",
        "-m",
        metavar="NAME,...",
        help="Estimators, with commas between them.",
        autocompletion=methods,
    ),
]
StartOption = Annotated[
    str,
    typer.Option(
        metavar="closed-form|model",
        autocompletion=starts,
        help="Where sequential, observer and the linear methods start: closed-form, or model, as published.",
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Run on this Dask cluster instead (extra cluster)."),
]
