"""``starplumb predict``: the mounting at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .archive.options import OfCamera, OfSatellite
from .output import Json, Output, Quiet, Verbose


def predict(
    result: Annotated[
        Path, typer.Argument(help="A result.json, the folder that holds it, or an archive.", metavar="WHAT")
    ],
    at: Annotated[str, typer.Option("--at", metavar="TIME", help="The time, ISO 8601 in UTC.")],
    temperature: Annotated[
        list[str] | None,
        typer.Option(
            "--temperature", metavar="NAME=DEG_C", help="A temperature that the mounting moves with."
        ),
    ] = None,
    satellite: OfSatellite = None,
    camera: OfCamera = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The mounting at a time and the covariance of its error, from a result or an archive alone.

    A mounting whose motion was estimated (calibrate --drift) moves; outside the span of the images the covariance
    grows, of one that showed no motion up to the motion that it would have shown.

    Examples:

      starplumb predict demo/result/result.json --at 2026-03-20T10:00:00

      starplumb predict mission.db --at 2026-06-01T00:00:00
    """
    from math import isfinite

    from ..io.text.files import show
    from ..io.text.numbers import number
    from ..physics.errors import InputError
    from ..session.motion.prediction import predict as run

    given = {}
    for text in temperature or ():
        name, _, value = text.partition("=")
        given[name.strip()] = number(value)
        if not isfinite(given[name.strip()]):
            raise InputError(f"--temperature: found {show(text)}, wanted NAME=DEG_C, as in lens=21.5")
    speak = Output(json, quiet, verbose)
    found = run(result, at, given, satellite, camera)
    speak.notices(found.notices)
    speak.document(found.document)
    speak.show(*map(speak.table, found.tables), *found.answer)
