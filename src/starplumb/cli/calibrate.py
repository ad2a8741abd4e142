"""``starplumb calibrate``: the main job."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table

    from ..identify.labelling import Labels
    from ..io.campaign.read import LoadedCampaign
    from ..judge.calibrate import Calibration
    from ..physics.so3 import Array

MAP = "residuals.gpkg"
"""The residuals for a geographic information system, written with --gpkg."""


def calibrate(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    method: Annotated[
        str, typer.Option("--method", "-m", help="Estimator; `starplumb compare` shows all.")
    ] = "gls",
    robust: Annotated[
        bool,
        typer.Option("--robust", help="Survive wrong labels, measurements and images (--method robust)."),
    ] = False,
    estimate: Annotated[
        list[str] | None,
        typer.Option(
            "--estimate",
            "-e",
            metavar="NAME[=SIGMA],...",
            help="What else to estimate, free or with its sigma known beforehand and unit: focal_length, "
            "principal_point, distortion, look_angles, time_offset, time_offset_attitude, time_offset_orbit, trackers.",
        ),
    ] = None,
    reach_deg: Annotated[
        float, typer.Option(help="With [detections]: the largest error the model mounting may have.")
    ] = 2.0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder of the results [default: `result` beside the campaign]."),
    ] = None,
    report: Annotated[bool, typer.Option(help="Write report.html, which takes two seconds.")] = True,
    gpkg: Annotated[bool, typer.Option("--gpkg", help="Write residuals.gpkg for QGIS too.")] = False,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate the mounting of the camera and say how well it is known.

    Writes result.json, residuals.csv, the page report.html and the SPICE frame kernel mounting.tf; with --gpkg also
    the residuals as a map, residuals.gpkg.

    Examples:

      starplumb calibrate demo/campaign.toml

      starplumb calibrate campaign.toml --out results --json

      starplumb calibrate campaign.toml --robust --estimate focal_length,time_offset=10ms
    """
    from ..io.campaign.read import load_campaign
    from ..judge.calibrate import calibrate as run
    from .choices import estimator_of, label_sentence, labelled

    speak = Output(json, quiet, verbose)
    method = "robust" if robust and method == "gls" else method
    out = out or campaign.parent / "result"
    if gpkg:
        from ..io.gis.geopackage import require_pyogrio

        require_pyogrio(out / MAP)
    loaded = load_campaign(campaign, with_detections=True)
    estimator = estimator_of(method, estimate or (), loaded.campaign)
    loaded, labels = labelled(loaded, reach_deg)
    speak.notices(loaded.notices)
    if labels is not None and labels.refusal:
        _refuse(campaign, loaded, labels, method, out)
    done = run(loaded.campaign, estimator)
    document = _publish(loaded, done, method, out, report, labels)
    if gpkg:
        _publish_map(done, loaded.shift_px, out)
    speak.document(document)
    named = [] if labels is None else [label_sentence(labels)]
    speak.show(_table(done, loaded.C_EK_true), *named, *_sentences(done, out), *_advice(done, campaign))
    speak.detail(*(f"{name}: {digest}" for name, digest in loaded.inputs.items()))
    if not done.status.usable:
        from ..physics.errors import AlignmentFailed

        raise AlignmentFailed(f"{campaign}: {done.message}")


def _refuse(path: Path, loaded: LoadedCampaign, labels: Labels, method: str, out: Path) -> NoReturn:
    """Write why the detections could not be named, and end with it."""
    from ..io.results.labels import refused_document
    from ..io.text.write import json_text, publish
    from ..physics.errors import AlignmentFailed
    from .choices import label_files

    files = {
        "result.json": json_text(refused_document(loaded, labels, method)),
        **label_files(loaded, labels),
    }
    publish(out, files, instead_of=("report.html", "mounting.tf", "residuals.csv", MAP))
    raise AlignmentFailed(f"{path}: {labels.refusal}")


def _publish(
    loaded: LoadedCampaign, done: Calibration, method: str, out: Path, report: bool, labels: Labels | None
) -> dict[str, Any]:
    """Write the files of the result, all or none, and return result.json; files of an earlier one go."""
    from ..io.formats.spice import frame_kernel_text
    from ..io.results.residual_table import residual_columns, residual_names
    from ..io.results.result import provenance, result_document
    from ..io.text.write import csv_pieces, json_text, publish

    frames = ("camera", loaded.config.tracker)
    document = result_document(done, method, frames, loaded.inputs, provenance(loaded), loaded.C_EK_true)
    document |= {} if labels is None else {"labels": labels.counts}
    files: dict[str, str | Iterable[str]] = {
        "result.json": json_text(document),
        "residuals.csv": csv_pieces(residual_names(done), residual_columns(done, loaded.shift_px)),
    }
    if labels is not None:
        from .choices import label_files

        files |= label_files(loaded, labels)
    if report:
        from ..report import calibration_page

        files["report.html"] = calibration_page(done, document)
    if done.status.usable:
        files["mounting.tf"] = frame_kernel_text(
            done.estimate.C_EK,
            "CAMERA",
            "STAR_TRACKER",
            covariance_E=done.estimate.covariance_E,
            comments=[
                f"campaign: {done.campaign.name}",
                f"method: {method}",
                f"status: {done.status.name.lower()}",
            ],
        )
    publish(out, files, instead_of=("report.html", "mounting.tf", MAP))
    return document


def _publish_map(done: Calibration, shift_px: float, out: Path) -> None:
    """The residuals at their landmarks as a layer of points."""
    from ..io.gis.geopackage import write_residuals
    from ..io.results.residual_table import residual_columns, residual_names
    from ..physics.earth import itrf_to_geodetic
    from ..physics.units import DEG

    place_J = done.campaign.landmarks.r_J[done.campaign.sightings.landmark]
    latitude, longitude, _ = itrf_to_geodetic(place_J)
    columns = residual_columns(done, shift_px)
    write_residuals(out / MAP, latitude / DEG, longitude / DEG, residual_names(done), columns)


def _advice(done: Calibration, campaign: Path) -> list[str]:
    """Where to look when the residuals are implausible."""
    from ..judge.consistency import IMPLAUSIBLE_P

    if done.chi2_p is None or done.chi2_p >= IMPLAUSIBLE_P:
        return []
    return [f"next: starplumb diagnose {campaign}"]


def _table(done: Calibration, C_EK_true: Array | None) -> Table:
    """Correction and sigma about the star tracker's axes."""
    from rich.table import Table

    from ..physics import so3
    from ..physics.units import ARCSEC

    table = Table(title=f"Alignment of {done.campaign.name}", title_justify="left")
    for heading in ("arcsec about", "x", "y", "z"):
        table.add_column(heading, justify="right" if len(heading) == 1 else "left")
    sigma = done.estimate.sigma_E
    table.add_row("correction", *(f"{value:.3f}" for value in done.correction_E / ARCSEC))
    table.add_row(
        "sigma", *(("not stated",) * 3 if sigma is None else (f"{value:.3f}" for value in sigma / ARCSEC))
    )
    if C_EK_true is not None:
        error = so3.log(done.estimate.C_EK @ C_EK_true.mT)
        table.add_row(
            "known truth", *(f"{value:.3f}" for value in so3.log(C_EK_true @ done.campaign.C_EK.mT) / ARCSEC)
        )
        table.add_row("error", *(f"{value:.3f}" for value in error / ARCSEC))
        if sigma is not None:
            table.add_row("error / sigma", *(f"{value:.2f}" for value in error / sigma))
    return table


def _sentences(done: Calibration, out: Path) -> list[str]:
    """What the table does not say, a line each."""
    import numpy as np

    from .choices import outcome_sentences

    used = done.residuals.used
    images = np.unique(done.observations.image[used]).size
    lines = [f"{images} images, {int(np.sum(used))} observations; status {done.status.name.lower()}"]
    if (
        done.estimate.chi2 is not None
        and done.chi2_p is not None
        and done.estimate.degrees_of_freedom is not None
    ):
        dof = int(done.estimate.degrees_of_freedom)
        lines.append(
            f"chi-square {float(done.estimate.chi2):.1f} for {dof} degrees of freedom (p = {done.chi2_p:.3g})"
        )
    for check, name in ((False, "control points"), (True, "check points")):
        before, after = done.accuracy(False, check), done.accuracy(True, check)
        if after is not None:
            was = "off the Earth" if before is None else f"{before.rmse:.3g} m"
            lines.append(
                f"geolocation of {after.n} {name}: {was} rms before, {after.rmse:.3g} m after (CE90 {after.ce90:.3g} m)"
            )
    lines += outcome_sentences(done)
    lines += [f"note: {sentence}" for sentence in done.sentences]
    lines.append(f"written: {out}")
    return lines
