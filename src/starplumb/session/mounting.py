"""The mounting that pixels are located with: that of a result, or the campaign's model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..disk.publish import unlike
from ..documents.cameras.before import RigBefore
from ..documents.prediction import Prediction, outside, predicted, rests, unseen_amplitude
from ..documents.result import ResultDocument
from ..estimators.protocol import Status
from ..io.text.files import read_text
from ..physics.errors import InputError
from ..physics.units import ARCSEC
from ..table.cameras.views import of_camera
from .campaign import Campaign
from .result import Result

Array = NDArray[np.float64]

MODEL = "model"
"""What stands in place of a result to ask for the model mounting."""
BESIDE = Path("result", "result.json")
"""Where ``starplumb calibrate`` leaves its result, beside the campaign."""
NORMAL_95 = 1.959963985
"""Half-width of the 95 % interval of a normal distribution, in sigmas."""
FIRST = 0
"""The image at whose time an earlier mounting is taken as known before."""


def result_file(path: Path) -> Path:
    """``result.json`` where the folder of a result is given."""
    return path / BESIDE.name if path.is_dir() else path


@dataclass(frozen=True)
class Mounting:
    """A mounting to locate with: ``C_EK`` (3, 3), the covariance (3, 3) rad^2 of its error about E, None where that is
    nowhere stated, and where it is from; ``notices`` are sentences that the user should see.  ``turn_E`` (m, 3) rad is
    how far it is turned at each image of the campaign, None where it rests."""

    C_EK: Array
    covariance_E: Array | None
    origin: str
    notices: tuple[str, ...] = ()
    turn_E: Array | None = None


def alone(campaign: Campaign, image: int) -> Campaign:
    """The campaign of the camera that took an image; as it is where there is but one."""
    data = campaign.loaded.campaign
    if data.rig is None or not data.several:
        return campaign
    k = int(data.rig.of_image[image])
    loaded = replace(campaign.loaded, campaign=of_camera(data, k))
    return replace(campaign, loaded=loaded, camera=data.rig.names[k])


def mounting_of(campaign: Campaign, result: Result | str | Path | None, image: int | None = None) -> Mounting:
    """The mounting of a result or of a ``result.json``; ``"model"``: the campaign's model, with its prior where one is
    stated; None: that of the result beside the campaign, the model's where there is none that may be used.

    With an ``image`` of the campaign it is that of a result at the image's time: where it moves, or where the image
    lies outside the span of those of the result.  Raises InputError where a result that was asked for cannot be used.
    """
    if isinstance(result, Result):
        return _of_result(campaign, result, image)
    if result is not None:
        return _model(campaign) if str(result) == MODEL else _named(campaign, Path(result), image)
    path = None if campaign.path is None else campaign.path.parent / BESIDE
    return _model(campaign) if path is None or not path.exists() else _beside(campaign, path, image)


def _model(campaign: Campaign, *notices: str) -> Mounting:
    prior_E = campaign.loaded.campaign.prior_E
    if prior_E is None:
        return Mounting(campaign.C_EK, None, "model, its own error not stated", notices)
    return Mounting(campaign.C_EK, prior_E, "model with its stated sigma", notices)


def known_before(
    campaign: Campaign, result: Result | str | Path
) -> tuple[Mounting, Mapping[str, str], RigBefore | None]:
    """The mounting of an earlier result, as a prior, the digests of what that was made from, and the mountings of all
    its cameras where it has several.

    One that rests keeps its covariance, as the model has it: that of the two campaigns is then the joint one.  Raises
    InputError where it cannot be used.
    """
    own = _first_named(campaign)
    if isinstance(result, Result):
        document, mounting = _result(own, result)
        inputs: Mapping[str, str] = result.campaign.loaded.inputs
        rig = RigBefore.of(ResultDocument.of(result.document))
    else:
        document = _document(own, Path(result))
        mounting, inputs = _of_document(document, Path(result)), document.inputs
        rig = RigBefore.of(ResultDocument.from_json(read_text(Path(result)), str(result)))
    if not rests(document):
        return _at_image(campaign, document, mounting, FIRST), inputs, rig
    return replace(mounting, notices=_at_rest(campaign, document)), inputs, rig


def _first_named(campaign: Campaign) -> Campaign:
    """The campaign as that of its first camera, where that has a name, by which a result of several is looked into."""
    rig = campaign.loaded.campaign.rig
    return campaign if rig is None else replace(campaign, camera=rig.names[0])


def _at_rest(campaign: Campaign, document: ResultDocument) -> tuple[str, ...]:
    """Over what time a result is taken to be at rest, and what it could not have seen."""
    away_s = max(outside(document, t_ns)[0] for t_ns in campaign.loaded.campaign.images.t_ns.tolist())
    if away_s == 0.0:
        return ()
    amplitude = unseen_amplitude(document)
    less = "no motion" if amplitude is None else f"none below {amplitude / ARCSEC:.2g} arcsec"
    return (
        f"taken to be at rest over the {away_s / 86400.0:.2g} d from its images to these; of a motion it could have "
        f"seen {less}",
    )


def _of_result(campaign: Campaign, result: Result, image: int | None) -> Mounting:
    document, mounting = _result(campaign, result)
    mounting = replace(mounting, notices=_other_inputs(result.campaign.loaded.inputs, campaign, "the result"))
    return _at_image(campaign, document, mounting, image)


def _result(campaign: Campaign, result: Result) -> tuple[ResultDocument, Mounting]:
    """The document of a usable result, and its mounting."""
    result.raise_if_unusable()
    c, name = result.calibration, f"result, {result.method}"
    document = _of_camera(campaign, ResultDocument.of(result.document), "the result")
    C_EK, covariance, half = result.C_EK, c.estimate.covariance_E, c.interval_95_E
    if campaign.camera is not None:
        C_EK, covariance, half = document.C_EK, document.covariance_E, document.interval_95_E
    return document, _stated(C_EK, covariance, half, c.status is Status.WEAK, name, "the result")


def _of_camera(campaign: Campaign, document: ResultDocument, where: str) -> ResultDocument:
    """The result of the campaign's camera, where it is that of one of several."""
    if campaign.camera is None or (document.mountings is None and document.mounting.from_ == campaign.camera):
        return document
    try:
        return document.of_camera(campaign.camera)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _named(campaign: Campaign, path: Path, image: int | None) -> Mounting:
    """That of a ``result.json`` asked for; inputs that differ are a notice."""
    document = _document(campaign, path)
    mounting = replace(
        _of_document(document, path), notices=_other_inputs(document.inputs, campaign, str(path))
    )
    return _at_image(campaign, document, mounting, image)


def _beside(campaign: Campaign, path: Path, image: int | None) -> Mounting:
    """That of the result beside the campaign, unless it must not be used or is not of these inputs."""
    try:
        document = _document(campaign, path)
        mounting = _of_document(document, path)
    except InputError as error:
        return _model(campaign, f"{error}; it is not used, the mounting is the model's")
    if changed := _changed(document.inputs, campaign.loaded.inputs):
        return _model(
            campaign,
            f"{path}: not used, because {_listed(changed)} changed since; the mounting is the model's: "
            "calibrate again, or name this result (--result) to use it nevertheless",
        )
    return _at_image(campaign, document, mounting, image)


def _at_image(
    campaign: Campaign, document: ResultDocument, mounting: Mounting, image: int | None
) -> Mounting:
    """The mounting at the time of an image, where that is another than the result's, or of all images."""
    images = campaign.loaded.campaign.images

    def at(i: int) -> Prediction:
        return predicted(
            document, int(images.t_ns[i]), None, {n: float(x[i]) for n, x in images.temperatures.items()}
        )

    if image is None:
        turn = np.stack([at(i).turn_E for i in range(images.t_ns.size)])
        return replace(mounting, turn_E=turn) if np.any(turn) else mounting
    found = at(image)
    if not np.any(found.turn_E) and found.outside_s == 0.0:
        return mounting
    return replace(
        mounting,
        C_EK=found.C_EK,
        covariance_E=found.covariance_E,
        origin=f"{mounting.origin}, at the image's time",
        notices=(*mounting.notices, *found.notices),
    )


def _document(campaign: Campaign, path: Path) -> ResultDocument:
    """Raises InputError where the file is no result, its frames are not the campaign's, or its status forbids it."""
    document = ResultDocument.from_json(read_text(path), str(path))
    if not document.usable:
        raise InputError(
            f"{path}: status: found {document.status!r}, wanted a result whose mounting may be used (ok or weak)"
        )
    document = _of_camera(campaign, document, str(path))
    found, wanted = (document.mounting.from_, document.mounting.to), campaign.frames
    if found != wanted:
        raise InputError(
            f"{path}: mounting: found {found[0]} to {found[1]}, wanted {wanted[0]} to {wanted[1]}"
        )
    return document


def require_set(path: Path, document: ResultDocument, names: Sequence[str]) -> None:
    """Raise InputError where a file beside a result is not the one that was written with it: it was changed, or lost,
    or a command was killed while it put its files in place."""
    for name in unlike(path.parent, document.files, names):
        state = "changed since" if (path.parent / name).is_file() else "no longer beside it"
        raise InputError(
            f"{path}: found {name} {state}, wanted the files of one calibration; calibrate again"
        )


def _of_document(document: ResultDocument, path: Path) -> Mounting:
    name = f"{path.name}, {document.method}"
    weak = document.status == Status.WEAK.name.lower()
    return _stated(document.C_EK, document.covariance_E, document.interval_95_E, weak, name, str(path))


def _stated(
    C_EK: Array, covariance_E: Array | None, half: Array | None, weak: bool, origin: str, where: str
) -> Mounting:
    """A usable mounting; a weak one is as good as its 95 % interval says, which is widened by what was found."""
    if covariance_E is None:
        raise InputError(
            f"{where}: covariance_arcsec2: found null, wanted a result that states it, such as that of the method gls: "
            "a sigma on the ground would leave out the mounting's own"
        )
    if weak and half is not None:
        return Mounting(
            C_EK, _widened(covariance_E, half), f"{origin}, weak: its sigma widened as its 95 % interval"
        )
    return Mounting(C_EK, covariance_E, origin)


def _widened(covariance_E: Array, half_E: Array) -> Array:
    """The covariance (3, 3) with sigmas as large as the half-widths (3,) over 1.96 ask for, its correlations kept."""
    sigma = np.sqrt(np.diagonal(covariance_E))
    factor = np.ones(3)
    np.divide(half_E / NORMAL_95, sigma, out=factor, where=sigma > 0.0)
    factor = np.maximum(factor, 1.0)
    return np.asarray(factor[:, None] * covariance_E * factor)


def _changed(then: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Inputs that differ, or that only one of the two has."""
    return sorted(name for name in {*then, *now} if then.get(name) != now.get(name))


def _other_inputs(then: Mapping[str, str], campaign: Campaign, where: str) -> tuple[str, ...]:
    changed = _changed(then, campaign.loaded.inputs)
    told = f"{where}: made from other inputs than this campaign's ({_listed(changed)} differ), used as asked"
    return (told,) if changed else ()


def _listed(names: list[str]) -> str:
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
