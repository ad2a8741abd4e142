"""Every argument of every function and method of the door: what does not fit it ends in a sentence that names it."""

from __future__ import annotations

import inspect
import json
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pytest

import starplumb as sp

QUICK = {"trials": 2, "methods": "wahba"}
"""A study that takes no time."""


@dataclass
class Made:
    """One object of each class of the door, made when first asked for: every function and method can be called."""

    campaign: sp.Campaign
    result: sp.Result
    scenario: sp.Scenario
    folder: Any

    @cached_property
    def budget(self) -> sp.Budget:
        return sp.budget(self.scenario)

    @cached_property
    def plan(self) -> sp.Plan:
        return sp.plan_images(self.scenario, 2)

    @cached_property
    def comparison(self) -> sp.Comparison:
        return sp.compare(self.campaign)

    @cached_property
    def diagnosis(self) -> sp.Diagnosis:
        return sp.diagnose(self.campaign)

    @cached_property
    def check(self) -> sp.Check:
        return sp.check(self.campaign)

    @cached_property
    def archive(self) -> sp.Archive:
        found = sp.open_archive(self.folder / "mission.db", create=True)
        found.add(self.result)
        return found

    @cached_property
    def measurement(self) -> sp.Measurement:
        return sp.Measurement(self.folder / "campaign.toml", None, None, ())

    @cached_property
    def projection(self) -> sp.Projection:
        return sp.project(self.campaign)

    @cached_property
    def study(self) -> sp.Study:
        return sp.simulate(self.scenario, **QUICK)

    def arguments(self, called: str) -> dict[str, Any]:
        """Those that a function or method cannot do without."""
        needed = {
            "predict": {"result": self.result, "at": "2026-03-20T10:00:00"},
            "locate": {"campaign": self.campaign, "image": "image01", "column": 1, "row": 1},
            "simulate": {"scenario": self.scenario, **QUICK},
            "plan_images": {"scenario": self.scenario, "images": 2, "days": 12.0},
            "budget": {"scenario": self.scenario},
            "scenario": {"source": "two-images"},
            "read_campaign": {"path": "campaign.toml"},
            "measure": {"path": "campaign.toml"},
            "Campaign.read": {"path": "campaign.toml"},
            "Campaign.from_tables": {"settings": {}},
            "demo": {},
            "open_archive": {"path": self.archive.path},
            "Archive.add": {"what": self.result},
            "Archive.withdraw": {"campaign": "0000", "reason": "a test"},
            "Archive.event": {"time": "2026-01-01T00:00:00", "kind": "a test"},
            "Archive.issue": {"reason": "a test"},
            "Archive.merge": {"other": self.archive.path},
        }
        if called.endswith(".save"):
            return {"folder": self.folder, "report": False} if "Result" in called else {"folder": self.folder}
        return needed.get(called, {} if "." in called else {"campaign": self.campaign})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    campaign = sp.demo(images=2)
    folder = tmp_path_factory.mktemp("door")
    return Made(campaign, sp.calibrate(campaign), sp.scenario("two-images"), folder)


def callables():
    """Every public function of the door and every public method of its classes, by name."""
    for name in sp._DOOR:
        thing = getattr(sp, name)
        if not isinstance(thing, type):
            yield name, thing
        elif not issubclass(thing, Exception):
            for method in vars(thing):
                found = getattr(thing, method)
                if not method.startswith("_") and callable(found):
                    yield f"{name}.{method}", found


ARGUMENTS = [
    pytest.param(
        called,
        name,
        id=f"{called}-{name}",
        marks=[pytest.mark.slow] if called.startswith("Diagnosis") else [],
    )
    for called, function in callables()
    for name, parameter in inspect.signature(function).parameters.items()
    if name != "self" and parameter.kind is not parameter.VAR_KEYWORD
]


def call(made, called, name, value):
    """Call with one argument changed."""
    owner, _, method = called.rpartition(".")
    if called in ("Campaign.read", "Campaign.from_tables"):
        function = getattr(sp.Campaign, method)
    else:
        function = getattr(getattr(made, owner.lower()), method) if owner else getattr(sp, method)
    return function(**made.arguments(called) | {name: value})


def test_the_door_is_walked_through_whole():
    names = [called for called, _ in callables()]
    assert {"calibrate", "simulate", "Campaign.read", "Result.save", "Study.plot_errors"} <= set(names)
    assert len(ARGUMENTS) > 40


@pytest.mark.parametrize(("called", "name"), ARGUMENTS)
@pytest.mark.parametrize(
    "value",
    [object(), np.array(["a", "b"]), float("nan"), -float("inf")],
    ids=["object", "array", "nan", "-inf"],
)
def test_what_fits_no_argument_is_refused_by_its_name(made, called, name, value):
    with pytest.raises(sp.InputError) as refused:
        call(made, called, name, value)
    assert str(refused.value).startswith(f"{name}: found ")
    assert ", wanted " in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("called", "name"), ARGUMENTS)
def test_none_is_refused_where_it_means_nothing(made, called, name):
    function = dict(callables())[called]
    if "None" in inspect.signature(function).parameters[name].annotation:
        if name != "trials":  # 45 000 of them
            call(made, called, name, None)
    else:
        with pytest.raises(sp.InputError, match=f"^{name}: found None, wanted "):
            call(made, called, name, None)


@pytest.mark.parametrize(("called", "name"), ARGUMENTS)
@pytest.mark.parametrize("value", [-1, -1.5, 0, True, "", "\0", [], ["", 3], {}, b"x"], ids=repr)
def test_nothing_ends_in_a_traceback(made, called, name, value):
    """Some of these fit some arguments; what does not is refused."""
    if name in ("folder", "out", "report", "gpkg", "pdf", "scheduler") and value in ("", "\0", True):
        pytest.skip("it is taken: files in this folder, one file more, another address")
    with suppress(sp.InputError, sp.AlignmentFailed):
        call(made, called, name, value)


@pytest.mark.parametrize(
    ("called", "name", "value", "sentence"),
    [
        (
            "calibrate",
            "campaign",
            "c.toml",
            "campaign: found 'c.toml', wanted a Campaign, as read_campaign gives it",
        ),
        ("calibrate", "estimate", None, "estimate: found None, wanted a list of strings or a string"),
        (
            "calibrate",
            "estimate",
            ["k1", 3],
            "estimate: found ['k1', 3], wanted a list of strings or a string",
        ),
        ("calibrate", "method", 3, "method: found 3, wanted the name of a method or an estimator"),
        (
            "calibrate",
            "reach_deg",
            11,
            "reach_deg: found 11, wanted the largest error of the mounting, 0 to 10",
        ),
        ("demo", "camera", "x", "camera: found 'x', wanted 'frame' or 'line-scan'"),
        ("demo", "images", 2.0, "images: found 2.0, wanted a whole number from 1 to 40"),
        ("demo", "images", True, "images: found True, wanted a whole number from 1 to 40"),
        ("locate", "column", "5", "column: found '5', wanted a finite number"),
        ("locate", "sigma_px", -1.0, "sigma_px: found -1.0, wanted a number that is not negative"),
        ("simulate", "precision", 0.0, "precision: found 0.0, wanted a number from 1e-4 to 0.5"),
        ("simulate", "watched", 1, "watched: found 1, wanted a function"),
        ("Result.save", "report", "no", "report: found 'no', wanted True or False"),
        ("Result.save", "folder", None, "folder: found None, wanted the path of a folder"),
        ("Budget.plot", "method", "glz", "method: found 'glz', wanted one of gls"),
    ],
)
def test_the_sentences(made, called, name, value, sentence):
    with pytest.raises(sp.InputError) as refused:
        call(made, called, name, value)
    assert str(refused.value) == sentence


def test_a_class_is_no_estimator(made):
    from starplumb.estimators.gls import Gls

    with pytest.raises(
        sp.InputError, match=r"^method: found the class Gls, wanted the name of a method or an est"
    ):
        sp.calibrate(made.campaign, method=Gls)


@pytest.mark.parametrize("kind", [np.int64, np.uint8, int])
def test_whole_numbers_of_any_kind_are_taken(made, kind):
    study = sp.simulate(made.scenario, trials=kind(2), seed=kind(3), methods="wahba")
    plain = sp.simulate(made.scenario, trials=2, seed=3, methods="wahba")
    assert study.document == plain.document
    assert json.loads(json.dumps(study.document)) == plain.document


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int16, int])
def test_numbers_of_any_kind_are_taken(made, kind):
    place = sp.locate(made.campaign, image="image01", column=kind(7), row=kind(9), height_m=kind(5))
    assert place.document == sp.locate(made.campaign, image="image01", column=7, row=9, height_m=5).document


def test_a_wrong_name_is_told_by_python(made):
    with pytest.raises(TypeError, match="estimates"):
        sp.calibrate(made.campaign, estimates=["k1"])


def test_advice_in_a_session_names_the_argument(made):
    from starplumb.session.show import for_python

    advice = (
        "give them more digits, or use --estimate time_offset=10ms, or calibrate with --estimate look_x_1."
    )
    assert for_python(advice) == (
        'give them more digits, or use estimate="time_offset=10ms", or calibrate with estimate="look_x_1".'
    )
