"""Documents: what is written is a document, reads back to the same bytes, and what is none is refused in a sentence."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import starplumb as sp
from starplumb.documents.budget import BudgetDocument
from starplumb.documents.comparison import ComparisonDocument
from starplumb.documents.diagnosis import DiagnosisDocument
from starplumb.documents.document import Document, Part
from starplumb.documents.normals import NormalsDocument
from starplumb.documents.reproduction import ReproductionDocument
from starplumb.documents.result import ResultDocument
from starplumb.documents.simulation import SimulationDocument
from starplumb.io.text.write import json_text
from starplumb.published.reproduce import document as reproduced
from starplumb.published.reproduce import reproduce

KINDS = {
    "starplumb-result/1": ResultDocument,
    "starplumb-compare/1": ComparisonDocument,
    "starplumb-normals/1": NormalsDocument,
    "starplumb-diagnosis/1": DiagnosisDocument,
    "starplumb-budget/1": BudgetDocument,
    "starplumb-simulation/1": SimulationDocument,
    "starplumb-reproduce/1": ReproductionDocument,
}


@pytest.fixture(scope="module")
def campaign():
    return sp.demo(images=3, seed=2)


@pytest.fixture(scope="module")
def result(campaign):
    return sp.calibrate(campaign, ["focal_length"], method="robust").document


@pytest.fixture(scope="module")
def written(campaign, result):
    """One of each, as dictionaries made by what writes them."""
    scenario = sp.scenario("two-images")
    return [
        result,
        sp.calibrate(campaign, method="wahba").document,
        sp.calibrate(campaign, ["focal_length"]).normals,
        sp.compare(campaign).document,
        sp.diagnose(campaign).document,
        sp.budget(scenario, "gls,wahba", target_arcsec=1.0).document,
        sp.simulate(scenario, trials=60, chunk=20, methods="gls,wahba").document,
        reproduced(reproduce(["table3"], 200, 1), 200, 1),
    ]


def unknown(part):
    """Keys of a document, its parts included, that its model does not know."""
    if isinstance(part, Part):
        return set(part.model_extra or {}).union(
            *(unknown(getattr(part, name)) for name in type(part).model_fields)
        )
    if isinstance(part, dict):
        return set().union(*map(unknown, part.values()))
    return set().union(*map(unknown, part)) if isinstance(part, list) else set()


@pytest.mark.slow
def test_every_document_is_its_model_to_the_byte(written):
    assert {document["schema"] for document in written} == set(KINDS)
    for document in written:
        text, kind = json_text(document), KINDS[document["schema"]]
        read = kind.from_json(text, "file.json")
        assert read.to_json() == text
        assert kind.of(document).to_json() == text
        assert read.to_dict() == json.loads(text)
        assert unknown(read) == set()


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_every_document_has_a_schema(kind):
    schema = kind.model_json_schema(by_alias=True)
    assert schema["properties"]["schema"]["const"] == kind.kind()
    assert "schema" in schema["required"]
    assert KINDS[kind.kind()] is kind
    assert issubclass(kind, Document)


def test_keys_of_later_versions_are_kept(result):
    text = json_text(result | {"of_a_later_version": [1.0, 2.0, 3.0]})
    assert ResultDocument.from_json(text, "result.json").to_json() == text


def spoilt(document, key, value):
    """The document's text with the value at a key, its parts separated by dots."""
    copy = json.loads(json.dumps(document))
    *path, last = key.split(".")
    part = copy
    for name in path:
        part = part[name]
    part[last] = value
    return json.dumps(copy)


C = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("schema", "somebody-else/9", 'schema: found "somebody-else/9", wanted "starplumb-result/1"'),
        ("status", "fine", "status: found 'fine', wanted one of ok, weak, "),
        ("mounting.matrix", C[:2], "mounting.matrix"),
        ("mounting.matrix", [[1.0, 0.0, 0.0], [0.0, 1.0, 2e-6], [0.0, 0.0, 1.0]], "no rotation"),
        ("mounting.matrix", [[-1.0, 0.0, 0.0], *C[1:]], "reflection"),
        ("covariance_arcsec2", [[-1.0, 0.0, 0.0], *C[1:]], "negative variance"),
        ("covariance_arcsec2", [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], C[2]], "negative variance"),
        ("covariance_arcsec2", [[1.0, 0.5, 0.0], *C[1:]], "not symmetric"),
        ("covariance_arcsec2", [[float("nan"), 0.0, 0.0], *C[1:]], "covariance_arcsec2.0.0: found nan"),
        ("covariance_arcsec2", [[None, 0.0, 0.0], *C[1:]], "found null in a usable result"),
        ("covariance_arcsec2", [[0.0] * 3] * 3, "found a variance that is 0; no mounting is known exactly"),
        ("interval_95_arcsec", [1e-3] * 3, "found half-widths below the sigmas of covariance_arcsec2"),
        ("sigma_arcsec", "small", "sigma_arcsec"),
        (
            "sigma_arcsec",
            [1.0, 1.0, 1.0],
            "found other sigmas than the roots of covariance_arcsec2's diagonal",
        ),
        ("mounting.quaternion_xyzw", [0.0, 0.0, 0.0, 1.0], "found a matrix and a quaternion_xyzw that are "),
        ("mounting.quaternion_xyzw", [0.0, 0.0, 0.0, 1.1], "found the norm 1.1, which is not 1"),
        ("mounting.quaternion_xyzw", [0.0, 0.0, 1.0], "mounting.quaternion_xyzw"),
        ("mounting", None, "mounting"),
    ],
)
def test_what_is_no_result_is_refused_in_one_sentence(campaign, result, key, value, says, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(spoilt(result, key, value), encoding="utf-8")
    with pytest.raises(sp.InputError, match=re.escape(says)) as refused:
        sp.locate(campaign, path, image="image01", column=1, row=1)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_a_matrix_within_its_digits_is_a_rotation(result):
    rounded = [[round(value, 8) for value in row] for row in result["mounting"]["matrix"]]
    read = ResultDocument.from_json(spoilt(result, "mounting.matrix", rounded), "result.json")
    np.testing.assert_allclose(read.C_EK, result["mounting"]["matrix"], atol=1e-8)


def test_a_missing_key_is_named_after_wrong_ones(result):
    short = {key: value for key, value in result.items() if key not in ("fit", "inputs")}
    with pytest.raises(
        sp.InputError, match="fit: missing; inputs: missing, wanted a starplumb-result/1 document"
    ):
        ResultDocument.from_json(json.dumps(short), "result.json")
    with pytest.raises(sp.InputError, match=r"status: found 3 .*; fit: missing; inputs: missing"):
        ResultDocument.from_json(json.dumps(short | {"status": 3}), "result.json")


@pytest.mark.parametrize("text", ["", "{", "[1]", "null", "3", '"text"'])
def test_what_is_no_json_object_is_refused(text):
    with pytest.raises(sp.InputError, match=r"^r\.json: .*starplumb-result/1"):
        ResultDocument.from_json(text, "r.json")


@pytest.mark.parametrize("status", ["singular", "not_converged"])
def test_an_answer_that_must_not_be_used_locates_nothing(campaign, result, status, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(spoilt(result, "status", status), encoding="utf-8")
    with pytest.raises(sp.InputError, match=f"status: found '{status}'"):
        sp.locate(campaign, path, image="image01", column=1, row=1)
