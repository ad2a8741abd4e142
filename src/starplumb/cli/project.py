"""``starplumb project``: from the ground to pixels."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from .channels import print_csv
from .options.common import CampaignArgument
from .options.complete import images
from .options.ground import Dem, Geoid, HeightsOption, ResultOption
from .options.outside import Choice, OutsideOption
from .options.places import require_place
from .output import Json, Output, Quiet, Verbose

STANDARD_INPUT = "-"
PIECE = 1 << 16
"""Bytes read at a time: between two pieces a signal that asks to stop is heard."""


def project(
    campaign: CampaignArgument,
    where: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="LAT LON [HEIGHT] | POINTS | -",
            help="Latitude, longitude (deg) and height above the ellipsoid (m); or a table of places with the columns "
            "of landmarks; or - for such a CSV table on standard input [default: the campaign's landmarks].",
        ),
    ] = None,
    image: Annotated[
        str | None,
        typer.Option(
            "--image",
            "-i",
            metavar="ID",
            autocompletion=images,
            help="One image only [default: all that see a place].",
        ),
    ] = None,
    itrf: Annotated[bool, typer.Option("--itrf", help="The three numbers are x, y, z in ITRF, m.")] = False,
    result: ResultOption = None,
    height_m: Annotated[
        float | None,
        typer.Option(
            "--height-m",
            metavar="METRES",
            help="Height above the ellipsoid of places that have none of their own.",
        ),
    ] = None,
    dem: Dem = None,
    heights: HeightsOption = None,
    geoid: Geoid = None,
    sigma_m: Annotated[
        float,
        typer.Option(
            "--sigma-m", metavar="METRES", min=0.0, help="Sigma of places, east and north, that state none."
        ),
    ] = 0.0,
    sigma_height_m: Annotated[
        float,
        typer.Option(
            "--sigma-height-m", metavar="METRES", min=0.0, help="Sigma of the heights of such places."
        ),
    ] = 0.0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Folder that receives pixels.csv, in place of standard output."
        ),
    ] = None,
    outside: OutsideOption = Choice.REFUSE,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The pixels at which places on the ground appear, with their sigmas: the inverse of locate.

    A place that does not appear in an image is left out and counted. The mounting is that of the last calibration where
    its inputs are still the same. A table gives a CSV table with the columns image_id, landmark_id, column_px, row_px
    and the sigmas.

    Examples:

      \b
      starplumb project demo/campaign.toml 45.1 -12.3 180

      \b
      starplumb project demo/campaign.toml demo/landmarks.csv --image image01

      \b
      starplumb project campaign.toml - < sites.csv > pixels.csv
    """
    from ..physics.errors import InputError, counted
    from ..session.campaign import read_campaign
    from ..session.ground.projection import PIXELS
    from ..session.ground.projection import project as run

    speak = Output(json, quiet, verbose)
    found = read_campaign(campaign, outside.value)
    if out is not None:
        require_place(out, [PIXELS], [found.loaded.sources, where, dem, geoid, result])
    with _places(where or [], itrf) as places:
        done = run(
            found,
            result,
            **({"height_m": height_m} | places),
            image=image,
            dem=dem,
            heights=None if heights is None else heights.value,
            geoid=geoid,
            sigma_m=sigma_m,
            sigma_height_m=sigma_height_m,
        )
    single = "points" not in places and bool(places)
    if single and not done.document["points"]:
        raise InputError(f"{campaign}: found the place in no image asked for ({'; '.join(done.told)})")
    speak.notices([*found.notices, *done.notices])
    if out is not None:
        done.save(out)
        speak.show(f"written: {out / PIXELS}: {counted(len(done.answer), 'row')}")
    elif single:
        speak.show(*done.answer)
    elif not json and not quiet:
        print_csv(done.csv)
    speak.notices([f"mounting: {done.document['mounting']}", *done.told])
    speak.document(done.document)


@contextmanager
def _places(where: list[str], itrf: bool) -> Iterator[dict[str, Any]]:
    """The argument of the places asked for; standard input lies in a file meanwhile, which messages do not name."""
    from ..physics.errors import InputError

    if len(where) != 1:
        yield _numbers(where, itrf)
        return
    if itrf:
        raise InputError("--itrf: found beside a table, which says itself what its columns are")
    if where[0] != STANDARD_INPUT:
        yield {"points": Path(where[0])}
        return
    with TemporaryDirectory(prefix="starplumb-") as folder:
        path = Path(folder, "input.csv")
        try:
            _keep_input(path)
            yield {"points": path}
        except InputError as error:
            raise InputError(str(error).replace(str(path), "standard input")) from None


def _keep_input(path: Path) -> None:
    """Standard input in a file.  Raises InputError where it has no end, or is longer than any other text may be."""
    from ..io.text.files import MOST_TEXT
    from ..physics.errors import InputError

    size = 0
    with path.open("wb") as file:
        while piece := sys.stdin.buffer.read(PIECE):
            size += file.write(piece)
            if size > MOST_TEXT:
                raise InputError(f"{path}: found more than {MOST_TEXT:,} bytes, wanted at most that many")


def _numbers(where: list[str], itrf: bool) -> dict[str, Any]:
    from math import isfinite

    from ..io.text.files import show
    from ..io.text.numbers import numbers
    from ..physics.errors import InputError

    if not where and not itrf:
        return {}
    values = numbers(where).tolist()
    least = 3 if itrf else 2
    if not least <= len(values) <= 3 or not all(map(isfinite, values)):
        wanted = "x, y and z (m)" if itrf else "latitude, longitude (deg) and height (m), or one table"
        raise InputError(f"places: found {show(' '.join(where))}, wanted {wanted}")
    if itrf:
        return {"itrf_m": values}
    return dict(zip(("latitude_deg", "longitude_deg", "height_m"), values, strict=False))
