"""Calibrate a campaign: the estimator by its name, landmarks for detections that have none, and the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..estimators import BEARS, METHODS, methods
from ..estimators.cameras.jointly import Jointly
from ..estimators.protocol import Estimator
from ..judge.accuracy.requirement import requirement as asked
from ..judge.motion.asked import columns_asked
from ..judge.motion.estimated import calibrate_moving as run
from ..physics.errors import AlignmentFailed, ArgumentError, did_you_mean
from ..physics.units import DEG
from ..table.campaign import Campaign as Physics
from .arguments import Folder, Wanted, checked
from .campaign import Campaign
from .result import RESULT, RESULT_FILES, Result

if TYPE_CHECKING:
    from ..identify.labelling import Labels

WITH_PARAMETERS = ("default", "gls", "robust")
"""Methods that can estimate further parameters beside the alignment."""

Method = Annotated[
    str | Estimator,
    Wanted("the name of a method or an estimator", lambda value: not isinstance(value, type)),
]
Starting = Annotated[str, Wanted("closed-form or model", lambda value: value in ("closed-form", "model"))]
Reach = Annotated[
    float, Wanted("the largest error of the mounting, 0 to 10", lambda value: 0.0 < value <= 10.0)
]


class NotIdentified(AlignmentFailed):
    """The detections of a campaign could not be matched with its landmarks; ``save`` writes what was tried."""

    def __init__(self, campaign: Campaign, labels: Labels, method: str) -> None:
        super().__init__(f"{campaign.source}: {labels.refusal}")
        self.campaign, self.labels, self.method = campaign, labels, method

    @checked
    def save(self, folder: Folder) -> None:
        """Write ``result.json`` without an answer, and the tables of the detections; an older result is removed."""
        from ..documents.from_calibration import unmatched_document
        from ..io.results.labels import label_files
        from ..io.text.write import marked, publish

        loaded, frames = self.campaign.loaded, self.campaign.frames
        document = unmatched_document(loaded.campaign, self.labels, self.method, frames, loaded.inputs)
        files, mark = label_files(loaded, self.labels), marked(RESULT, document)
        publish(Path(folder), files, instead_of=RESULT_FILES, mark=mark, inputs=loaded.sources)


@dataclass(frozen=True)
class Identified:
    """A campaign whose detections have their landmarks; ``labels`` None where they were known from the start."""

    campaign: Campaign
    labels: Labels | None


@checked
def calibrate(
    campaign: Campaign,
    estimate: Sequence[str] | str = (),
    method: Method = "default",
    reach_deg: Reach = 2.0,
    prior: Result | str | Path | None = None,
    start: Starting = "closed-form",
    drift: str = "none",
    requirement: str | None = None,
) -> Result:
    """Estimate the mounting of a campaign and judge the answer.

    ``estimate`` names what to estimate beside the alignment, each free or with its known sigma and unit, as in
    ``["focal_length", "time_offset=10ms"]``; ``method`` is a name of ``starplumb compare`` or an estimator of your own.
    ``reach_deg`` is the largest error that the mounting may have where detections must be matched with landmarks first.
    ``prior`` is an earlier result, or the path of its ``result.json`` or of its folder: its mounting is then the model,
    known with its whole covariance.  Landmarks seen in both campaigns count twice, and the message names them; the sum
    of their ``normals.json`` has them once.
    ``start="model"`` has a method that starts somewhere do so at the model mounting, as published, in place of the
    closed form.  ``drift`` says how the mounting moves: ``"none"`` only tests it, ``"auto"`` averages models by their
    evidence, or names, with commas between them, of ``orbit:K``, ``linear``, ``step:TIME`` and ``temperature:NAME``;
    :func:`starplumb.predict` then gives the mounting at a time.  ``requirement`` is what the accuracy must be, as
    ``"5 m CE90"``, ``"3 m rms"`` or ``"2 arcsec"``: the result and its report then say whether it is met.
    Raises InputError where something asked for cannot be given, NotIdentified where no match is found.
    An answer that must not be used is returned like any other: look at ``status``, or call ``raise_if_unusable``.
    """
    name = name_of(method)
    wanted = [estimate] if isinstance(estimate, str) else estimate
    columns_asked(drift)  # before the work
    limit = None if requirement is None else asked(requirement)
    campaign.loaded.coverage.require()
    if drift != "none":
        campaign.require_one_camera("a motion of the mounting (drift)")
    known = None
    if prior is not None:
        from .prior import with_prior

        campaign, known = with_prior(campaign, prior)
    estimator = estimator_of(method, wanted, campaign.loaded.campaign, start)
    found = identify(campaign, reach_deg)
    if found.labels is not None and found.labels.refusal:
        raise NotIdentified(campaign, found.labels, name)
    done = run(found.campaign.loaded.campaign, estimator, drift)
    return Result(found.campaign, done if known is None else known.told(done), name, found.labels, limit)


def estimator_of(
    method: str | Estimator, estimate: Sequence[str], campaign: Physics, start: str = "closed-form"
) -> Estimator:
    """The estimator of a method's name, with further parameters beside the alignment.

    Raises InputError for an unknown method or parameter.
    """
    from ..estimators.default import Default
    from ..estimators.gls import Gls
    from ..estimators.robust import Robust
    from ..table.parameter_names import parameters

    wanted = [name.strip() for text in estimate for name in text.split(",")]
    if campaign.several and method not in WITH_PARAMETERS:
        raise ArgumentError(
            "method",
            f"found {name_of(method)} for several cameras, wanted {', '.join(WITH_PARAMETERS[:-1])} or "
            f"{WITH_PARAMETERS[-1]}, which estimate their mountings together",
        )
    if not isinstance(method, str):
        if wanted:
            raise ArgumentError(
                "estimate", "found beside an estimator of your own, wanted it to hold the parameters itself"
            )
        return method
    if method not in METHODS:
        raise ArgumentError(
            "method", f"found {method!r}, wanted one of {', '.join(METHODS)}{did_you_mean(method, METHODS)}"
        )
    if start == "model" and method not in BEARS:
        raise ArgumentError(
            "start",
            f"found model with the method {method}, which needs no start; wanted one of {', '.join(BEARS)}",
        )
    if not wanted and not campaign.several:
        return methods(start)[method]()
    if method not in WITH_PARAMETERS:
        raise ArgumentError(
            "estimate",
            f"found with the method {method}, wanted {', '.join(WITH_PARAMETERS[:-1])} or {WITH_PARAMETERS[-1]}",
        )
    gls = Gls(parameters(wanted, campaign))
    _require_not_held(gls.unknowns.names, campaign)
    make: dict[str, Callable[[Gls], Estimator]] = {
        "gls": lambda gls: gls,
        "default": Default,
        "robust": Robust,
    }
    if campaign.rig is not None and campaign.several:
        return Jointly(campaign.rig.names, make[method], gls)
    return make[method](gls)


def _require_not_held(names: Sequence[str], campaign: Physics) -> None:
    """Raise ArgumentError for a parameter that is estimated and held by ``[consider]``."""
    held = dict(campaign.considered)
    both = [name for name in names if name in held or ("trackers" in held and "tracker_" in name)]
    if both:
        raise ArgumentError(
            "estimate",
            f"found {both[0]!r}, which [consider] holds; wanted it there or here "
            f"(with its sigma: {both[0]}=...), not both",
        )


def name_of(method: str | Estimator) -> str:
    """A method's name, or that of an estimator's class."""
    return method if isinstance(method, str) else type(method).__name__


def estimators_of(methods: Sequence[str] | str) -> Mapping[str, Estimator]:
    """Estimators by their names; a text may hold several with commas between them."""
    listed = [methods] if isinstance(methods, str) else methods
    names = [part.strip() for text in listed for part in text.split(",") if part.strip()]
    for name in names:
        if name not in METHODS:
            raise ArgumentError(
                "methods", f"found {name!r}, wanted some of {', '.join(METHODS)}{did_you_mean(name, METHODS)}"
            )
    if not names:
        raise ArgumentError("methods", f"found none, wanted some of {', '.join(METHODS)}")
    return {name: METHODS[name]() for name in names}


def method_of(document: Mapping[str, Any], method: str | None) -> str:
    """A method of a document of several, by default the first.  Raises ArgumentError for another."""
    names = list(document["methods"])
    if method is not None and method not in names:
        raise ArgumentError("method", f"found {method!r}, wanted one of {', '.join(names)}")
    return names[0] if method is None else method


def identify(campaign: Campaign, reach_deg: float) -> Identified:
    """The campaign with a landmark for each detection that can have one; as it is where the landmarks are known."""
    loaded = campaign.loaded
    if loaded.detections is None:
        return Identified(campaign, None)
    from ..identify.labelling import label

    labels = label(loaded.campaign, loaded.detections, reach_deg * DEG)
    seen = replace(loaded.campaign, sightings=labels.sightings(loaded.detections))
    return Identified(replace(campaign, loaded=replace(loaded, campaign=seen)), labels)
