"""An earlier result as what is known of the mounting: with its whole covariance, not three sigmas."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ..documents.normals import NormalsDocument
from ..documents.result import ResultDocument
from ..estimators.protocol import Status
from ..io.tables.read import read_table
from ..io.text.files import fingerprint, read_text
from ..judge.calibrate import Calibration
from ..judge.files.evidence import listed
from ..physics.errors import InputError
from .campaign import Campaign
from .mounting import known_before, require_set, result_file
from .result import Result

BESIDE = ("residuals.csv", "normals.json")
"""Files beside a result by which landmarks are known that were used already."""


@dataclass(frozen=True)
class Prior:
    """What was known of a campaign's mounting: its ``name`` in messages, and the ``landmarks`` that it is known to have
    been found from; ``notices`` say what it is taken for."""

    name: str
    landmarks: frozenset[str]
    notices: tuple[str, ...] = ()

    def told(self, calibration: Calibration) -> Calibration:
        """A calibration that rests on it, which says what it is taken for, and where the survey of a landmark counts
        twice."""
        c = calibration
        if c.status is Status.NOT_CONVERGED:
            return replace(c, sentences=(*c.sentences, f"{self.name} may be wrong: calibrate without it"))
        if not c.status.usable:
            return c
        used = (c.campaign.landmarks.ids[i] for i in set(c.observations.landmark[c.residuals.used].tolist()))
        again = sorted(self.landmarks.intersection(used))
        said = [f"{self.name}: {notice}" for notice in self.notices]
        twice = [_counted_twice(self.name, again)] if again else []
        return replace(c, sentences=(*c.sentences, *said, *twice))


def _counted_twice(name: str, landmarks: list[str]) -> str:
    one = len(landmarks) == 1
    return (
        f"{len(landmarks)} landmark{'s' * (not one)} of {name} occur{'s' * one} here too ({listed(landmarks)}): where "
        "one name is one marker, its survey error counts twice and the sigma is too small; the sum of the two "
        "normals.json has it once"
    )


def with_prior(campaign: Campaign, result: Result | str | Path) -> tuple[Campaign, Prior]:
    """The campaign with the mounting of an earlier result as its model, known with its whole covariance.

    Raises InputError where the result cannot be used or is of the same sightings, or the campaign states a sigma of its
    mounting too.
    """
    loaded = campaign.loaded
    if loaded.campaign.prior_E is not None:
        raise InputError(
            f"{campaign.source}: mounting.sigma_arcsec: found beside the prior of an earlier result, "
            "wanted only one of the two"
        )
    result = result if isinstance(result, Result) else result_file(Path(result))
    mounting, made_from, rig = known_before(campaign, result)
    if isinstance(result, Result):
        prior, inputs = Prior("the prior", _landmarks_of(result)), {}
    else:
        path = result
        document = ResultDocument.from_json(read_text(path), str(path))
        require_set(path, document, [name for name in BESIDE if path.with_name(name).is_file()])
        prior, inputs = Prior(f"the prior {path}", _landmarks_beside(path)), {str(path): fingerprint(path)}
    prior = replace(prior, notices=mounting.notices)
    _require_other_sightings(campaign, made_from, prior.name)
    own, P = loaded.campaign.rig, mounting.covariance_E
    if own is not None and own.several and rig is not None and P is not None:
        own = rig.known_of(own, P)
        P = None if own.known_E is None else own.known_E[:3, :3]
    known = replace(
        loaded.campaign, C_EK=mounting.C_EK, covariance_mounting=P, known_from=prior.name, rig=own
    )
    return replace(campaign, loaded=replace(loaded, campaign=known, inputs=loaded.inputs | inputs)), prior


def _require_other_sightings(campaign: Campaign, made_from: Mapping[str, str], prior: str) -> None:
    """Raise InputError where the table of sightings is one that the prior was made from."""
    config, inputs = campaign.loaded.config, campaign.loaded.inputs
    table = config.observations or config.detections
    name = "" if table is None else str(table.file)
    if inputs.get(name, "") in made_from.values():
        raise InputError(
            f"{campaign.source}: {prior} was made from the same {name}; wanted an earlier result of other sightings, "
            "since these would count twice"
        )


def _landmarks_of(result: Result) -> frozenset[str]:
    c = result.calibration
    return frozenset(c.campaign.landmarks.ids[i] for i in c.observations.landmark[c.residuals.used].tolist())


def _landmarks_beside(path: Path) -> frozenset[str]:
    """Those in the solution by ``residuals.csv`` beside a result, else those that ``normals.json`` names."""
    residuals, normals = path.with_name("residuals.csv"), path.with_name("normals.json")
    with suppress(InputError):  # a file of another kind by that name says nothing
        if residuals.is_file():
            table = read_table(residuals, texts=("landmark_id", "role"))
            pairs = zip(table.texts["landmark_id"], table.texts["role"], strict=True)
            return frozenset(landmark for landmark, role in pairs if role == "control")
        if normals.is_file():
            unknowns = NormalsDocument.from_json(read_text(normals), str(normals)).unknowns
            return frozenset(
                u.name[len("landmark[") : -1] for u in unknowns if u.name.startswith("landmark[")
            )
    return frozenset()
