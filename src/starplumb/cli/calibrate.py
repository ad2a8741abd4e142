"""``starplumb calibrate``: the main job."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .output import Json, Output, Quiet, Verbose

if TYPE_CHECKING:
    from rich.table import Table

    from ..calibration import Calibration
    from ..io.campaign import LoadedCampaign
    from ..so3 import Array


def calibrate(
    campaign: Annotated[Path, typer.Argument(help="The campaign.toml.", metavar="CAMPAIGN.toml")],
    method: Annotated[
        str, typer.Option("--method", "-m", help="Estimator; `starplumb compare` shows all.")
    ] = "gls",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder of the results [default: `result` beside the campaign]."),
    ] = None,
    report: Annotated[bool, typer.Option(help="Write report.html, which takes two seconds.")] = True,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate the mounting of the camera and say how well it is known.

    Writes result.json, residuals.csv, the page report.html and the SPICE frame kernel mounting.tf.

    Examples:

      starplumb calibrate demo/campaign.toml

      starplumb calibrate campaign.toml --out results --json
    """
    from ..calibration import calibrate as run
    from ..estimators import METHODS
    from ..io.campaign import load_campaign

    speak = Output(json, quiet, verbose)
    estimator = _estimator(method, METHODS)
    loaded = load_campaign(campaign)
    done = run(loaded.campaign, estimator())
    speak.notices(loaded.notices)
    document = _publish(loaded, done, method, out or campaign.parent / "result", report)
    speak.document(document)
    speak.show(_table(done, loaded.C_EK_true), *_sentences(done, out or campaign.parent / "result"))
    speak.detail(*(f"{name}: {digest}" for name, digest in loaded.inputs.items()))
    if not done.status.usable:
        from ..errors import AlignmentFailed

        raise AlignmentFailed(f"{campaign}: {done.message}")


def _estimator(method: str, methods: dict[str, Any]) -> Any:
    from ..errors import InputError
    from ..io.files import nearest

    if method in methods:
        return methods[method]
    near = nearest(method, methods)
    hint = f" (did you mean {near}?)" if near else ""
    raise InputError(f"--method: found {method!r}, wanted one of {', '.join(methods)}{hint}")


def _publish(
    loaded: LoadedCampaign, done: Calibration, method: str, out: Path, report: bool
) -> dict[str, Any]:
    """Write the files of the result, all or none, and return result.json; files of an earlier one go."""
    from ..io.result import provenance, residual_columns, residual_names, result_document
    from ..io.spice import frame_kernel_text
    from ..io.write import csv_text, json_text, publish

    frames = ("camera", loaded.config.tracker)
    document = result_document(done, method, frames, loaded.inputs, provenance(loaded), loaded.C_EK_true)
    files = {
        "result.json": json_text(document),
        "residuals.csv": csv_text(residual_names(done), residual_columns(done)),
    }
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
    publish(out, files, instead_of=("report.html", "mounting.tf"))
    return document


def _table(done: Calibration, C_EK_true: Array | None) -> Table:
    """Correction and sigma about the star tracker's axes."""
    from rich.table import Table

    from .. import so3
    from ..units import ARCSEC

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
    lines += [f"note: {sentence}" for sentence in done.sentences]
    lines.append(f"written: {out}")
    return lines
