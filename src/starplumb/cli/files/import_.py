"""``starplumb import``: a vendor's product into a campaign folder."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from ...io.vendors.digitalglobe_geo import Optics


class Source(StrEnum):
    """Which attitude of a product to take."""

    VENDOR = "vendor"
    FILTERED = "filtered"
    RAW = "raw"


_SIGMA = "one number, or three with commas between"


def import_(
    products: Annotated[
        list[Path],
        typer.Argument(
            help="DIMAP or DigitalGlobe metadata (.XML, .DIM, .IMD, .ATT, .EPH), their folders, CSM .json, .tsai; the "
            "last argument is the campaign folder to write, unless --into names it.",
            metavar="PRODUCT... DIR",
        ),
    ],
    into: Annotated[
        Path | None,
        typer.Option("--into", help="A campaign that the products are added to.", metavar="DIR"),
    ] = None,
    attitude: Annotated[
        Source,
        typer.Option("--attitude", help="The vendor's own, or the star tracker's quaternions (DIMAP)."),
    ] = Source.VENDOR,
    sigma_m: Annotated[
        str | None, typer.Option("--sigma-m", metavar="METRES", help=f"Sigma of the position: {_SIGMA}.")
    ] = None,
    sigma_arcsec: Annotated[
        str | None,
        typer.Option(
            "--sigma-arcsec", metavar="ARCSEC", help=f"Sigma of the attitude about x, y, z: {_SIGMA}."
        ),
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Your landmarks table; needs --observations.")
    ] = None,
    observations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Your observations table; needs --landmarks.")
    ] = None,
    corners: Annotated[
        str | None,
        typer.Option(
            "--corners", help="Take the product's corners as landmarks: SIGMA_M,SIGMA_PX.", metavar="M,PX"
        ),
    ] = None,
    band: Annotated[
        str | None, typer.Option("--band", metavar="NAME", help="Band, where the product has several.")
    ] = None,
    image_id: Annotated[
        str | None,
        typer.Option(
            "--image-id",
            metavar="ID,...",
            help="Names of the images, with commas between [default: the products'].",
        ),
    ] = None,
    principal_distance_mm: Annotated[
        float | None, typer.Option(metavar="MM", help="DigitalGlobe without .GEO: principal distance.")
    ] = None,
    detector_pitch_mm: Annotated[
        float | None, typer.Option(metavar="MM", help="The same: pitch of the detectors.")
    ] = None,
    detector_origin_mm: Annotated[
        str | None,
        typer.Option(help="The same: x,y of the first detector in the camera's axes.", metavar="X,Y"),
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Turn vendors' products into a campaign: orbit, attitude, camera and time in declared units and frames.

    Several products of one camera become one campaign, or are added to one (--into). Without landmarks the campaign can
    be located with at once.

    Sigmas that the product does not state must be given: none is assumed.

    Examples:

      \b
      starplumb import DIM_PHR1B.XML pleiades --attitude raw \\
        --sigma-m 1 --sigma-arcsec 2,2,5

      \b
      starplumb import first second third stereo --sigma-m 1 --sigma-arcsec 2,2,5

      \b
      starplumb import fourth --into stereo

      \b
      starplumb import product.IMD quickbird --corners 0.5,0.3 \\
        --principal-distance-mm 8836.202 --detector-pitch-mm 0.01191396 \\
        --detector-origin-mm 9.54684,164.02773
    """
    from ...io.vendors.into import import_into
    from ...io.vendors.product import Wanted, import_products
    from ...physics.errors import InputError

    speak = Output(json, quiet, verbose)
    if into is None and len(products) < 2:
        raise InputError("PRODUCT... DIR: found one argument, wanted a product and the folder to write")
    wanted = Wanted(
        attitude.value,
        _sigma("--sigma-m", sigma_m),
        _sigma("--sigma-arcsec", sigma_arcsec),
        _optics(principal_distance_mm, detector_pitch_mm, detector_origin_mm),
        band,
        _pair("--corners", corners),
    )
    names = [] if image_id is None else [name.strip() for name in image_id.split(",")]
    if into is None:
        folder = products[-1]
        with speak.doing("reading the products"):
            notices = import_products(products[:-1], folder, wanted, landmarks, observations, names)
    else:
        if landmarks is not None or observations is not None:
            raise InputError(
                "--into: found beside --landmarks, wanted the rows added to the campaign's own tables"
            )
        folder, there = into, (into / "campaign.toml").exists()
        with speak.doing("reading the products"):
            notices = (
                import_into(into, products, wanted, names)
                if there
                else import_products(products, into, wanted, image_ids=names)
            )
    path = folder / "campaign.toml"
    speak.notices(notices)
    speak.document({"campaign": str(path), "notices": notices})
    speak.detail(*(f"wrote {file}" for file in sorted(folder.iterdir())))
    speak.show(f"wrote {path}", f"next: starplumb check {path}")


def _numbers(option: str, text: str, counts: tuple[int, ...], wanted: str) -> tuple[float, ...]:
    from math import isfinite

    from ...io.text.files import show
    from ...io.text.numbers import numbers
    from ...physics.errors import InputError

    values = tuple(numbers(text.split(",")).tolist())
    if len(values) not in counts or not all(map(isfinite, values)):
        raise InputError(f"{option}: found {show(text)}, wanted {wanted}")
    return values


def _sigma(option: str, text: str | None) -> float | tuple[float, float, float] | None:
    if text is None:
        return None
    values = _numbers(option, text, (1, 3), "one positive number, or three with commas between")
    return values[0] if len(values) == 1 else (values[0], values[1], values[2])


def _pair(option: str, text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    first, second = _numbers(option, text, (2,), "two numbers with a comma between")
    return first, second


def _optics(distance_mm: float | None, pitch_mm: float | None, origin_mm: str | None) -> Optics | None:
    """The camera of a DigitalGlobe product whose .GEO is not at hand; all of it or nothing."""
    from ...io.vendors.digitalglobe_geo import Optics
    from ...physics.errors import InputError

    given = (distance_mm, pitch_mm, origin_mm)
    if all(value is None for value in given):
        return None
    origin = _pair("--detector-origin-mm", origin_mm)
    if distance_mm is None or pitch_mm is None or origin is None:
        raise InputError(
            "--principal-distance-mm, --detector-pitch-mm, --detector-origin-mm: found some of them, wanted all three"
        )
    return Optics(distance_mm, pitch_mm, origin)
