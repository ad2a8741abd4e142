"""``starplumb init``: an example to begin with."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..options.complete import scenarios
from ..output import Json, Output, Quiet, Verbose

IMAGES = 8


class Kind(StrEnum):
    """Cameras of the example."""

    FRAME = "frame"
    LINE_SCAN = "line-scan"


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to make; it must be new or empty.", metavar="DIR")],
    camera: Annotated[Kind, typer.Option("--camera", help="Camera of the example.")] = Kind.FRAME,
    images: Annotated[
        int, typer.Option("--images", "-n", metavar="COUNT", min=1, max=40, help="Number of images.")
    ] = IMAGES,
    seed: Annotated[
        int, typer.Option("--seed", "-s", metavar="NUMBER", min=0, help="Seed of the simulated errors.")
    ] = 1,
    imagery: Annotated[
        bool,
        typer.Option(
            "--imagery", help="Raw images of drawn ground with an orthoimage and heights, for `measure`."
        ),
    ] = False,
    template: Annotated[
        bool, typer.Option("--template", help="A campaign without data, with every key explained.")
    ] = False,
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            help="A copy of a shipped scenario to edit, by its name.",
            metavar="NAME",
            autocompletion=scenarios,
        ),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write a ready campaign of simulated data whose true alignment is known, or an empty one, or a scenario.

    The first line of what is written names its JSON schema, which lies beside it: editors that know it complete keys,
    explain them and mark mistakes.

    Examples:

      \b
      starplumb init demo && starplumb calibrate demo/campaign.toml

      \b
      starplumb init photos --imagery && starplumb measure photos/campaign.toml --calibrate

      \b
      starplumb init mine --template

      \b
      starplumb init study --scenario two-images && starplumb budget study/scenario.toml
    """
    from ...physics.errors import InputError, counted
    from ...session.beginning import require_new, schema_text, write_scenario, write_template
    from ...session.campaign import write_demo
    from ...session.imagery.example import require_alone, write_drawn_example

    if imagery:
        require_alone(
            {
                "--template": template,
                "--scenario": scenario is not None,
                "--camera": camera != Kind.FRAME,
                "--images": images != IMAGES,
            }
        )
    if template and scenario is not None:
        raise InputError("--scenario: found beside --template, wanted only one of the two")
    require_new(folder)
    speak = Output(json, quiet, verbose)
    if template:
        path = write_template(folder)
        speak.document({"campaign": str(path)})
        told = [f"wrote {path} and its tables, to be filled in", f"next: starplumb check {path}"]
    elif scenario is not None:
        path = write_scenario(folder, scenario)
        speak.document({"scenario": str(path)})
        told = [f"wrote {path}", f"next: starplumb budget {path}"]
    elif imagery:
        path, count = write_drawn_example(folder, seed, schema_text("campaign"))
        speak.document({"campaign": str(path), "images": count})
        told = [
            f"wrote {path}: {count} raw images of drawn ground with a reference, the true mounting known",
            f"next: starplumb measure {path} --calibrate",
        ]
    else:
        path, data = write_demo(folder, camera.value, images, seed, schema_text("campaign"))
        speak.document(
            {"campaign": str(path), "images": images, "observations": int(data.sightings.image.size)}
        )
        told = [
            f"wrote {path}: {counted(images, 'image')} of {len(data.landmarks.ids)} markers, the true mounting known",
            f"next: starplumb calibrate {path}",
        ]
    speak.detail(*(f"wrote {file}" for file in sorted(folder.iterdir())))
    speak.show(*told)
