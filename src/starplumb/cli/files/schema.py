"""``starplumb schema``: what a document may hold, for editors and other programs."""

from __future__ import annotations

from typing import Annotated

import typer

from ..options.complete import documents
from ..output import Json, Output, Quiet, Verbose


def schema(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            autocompletion=documents,
            help="campaign, scenario, result, ...; left out, the names of all documents.",
        ),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Print the JSON schema of a document: of campaign.toml, of a scenario, of result.json and whatever --json prints.

    Editors check campaign.toml while it is written where its first line names such a file: init writes both.

    Examples:

      \b
      starplumb schema

      \b
      starplumb schema campaign > campaign.schema.json
    """
    from ...documents.catalogue import names
    from ...documents.catalogue import schema as run

    speak = Output(json or name is not None, quiet, verbose)
    if quiet:
        return
    speak.document({"documents": names()} if name is None else run(name))
    speak.show(*names())
