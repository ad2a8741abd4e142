"""JSON schemas of every document, and what is written to begin with; the library jsonschema is the judge."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated

import pytest
from jsonschema import Draft202012Validator
from pydantic import TypeAdapter
from typer.testing import CliRunner

from helpers import CAMPAIGN
from starplumb.cli.app import app
from starplumb.documents.catalogue import names, schema
from starplumb.io.campaign.config import CampaignConfig
from starplumb.io.campaign.read import load_campaign
from starplumb.io.scenario.read import load_scenario, shipped_scenarios
from starplumb.io.text.template import _model_of, value_of
from starplumb.io.text.toml import check
from starplumb.physics.errors import InputError
from starplumb.session.beginning import ACTIVE, EXAMPLES


def run(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture(scope="module")
def campaign_schema():
    return Draft202012Validator(schema("campaign"))


@pytest.mark.parametrize("name", names())
def test_every_document_has_a_schema_that_is_one(name):
    printed = json.loads(run("schema", name).stdout)
    Draft202012Validator.check_schema(printed)
    assert printed == schema(name)
    assert printed["type"] == "object"


def test_documents_are_named_as_their_key_says_and_as_their_command():
    assert {"campaign", "scenario", "result", "budget", "compare", "projection", "simulation"} <= set(names())
    assert run("schema").stdout.split() == names()
    for name in names()[2:]:
        assert schema(schema(name)["properties"]["schema"]["const"]) == schema(name)
    assert schema("simulate") == schema("simulation")
    with pytest.raises(
        InputError, match=r"schema: found 'campain', wanted one of .* \(did you mean campaign\?\)"
    ):
        schema("campain")


def test_good_campaigns_are_valid(campaign_schema, shared_cases):
    for path in shared_cases.glob("*/campaign.toml"):
        campaign_schema.validate(tomllib.loads(path.read_text()))


@pytest.mark.slow
def test_a_comparison_is_valid(tmp_path):
    run("init", tmp_path / "demo", "--images", 2)
    found = json.loads(run("compare", tmp_path / "demo" / "campaign.toml", "--json").stdout)
    Draft202012Validator(schema("compare")).validate(found)


OWN = CAMPAIGN.replace(
    "sigma_m = 3.0",
    'sigma_m = [1, 2, 3]\nkeep = { mode = "FINE", valid = [1, 2] }\nframe = "J2000"\nunits = { position = "km" }',
).replace('frame = "ITRF"\n', "", 1)


@pytest.mark.parametrize("text", [CAMPAIGN, OWN])
def test_what_may_be_written_in_several_ways_is_valid(campaign_schema, text):
    document = tomllib.loads(text)
    check(document, CampaignConfig, "campaign.toml")
    campaign_schema.validate(document)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("time_scale", "time_scales"),
        ('"UTC"', '"utc"'),
        ("2200.0", '"2200"'),
        ("2200.0", "-1.0"),
        ("[12000, 12000]", "[12000]"),
        ("sigma_m = 3.0", "sigma_m = [1, 2]"),
        ('frame = "ITRF"', 'frame = "ECEF"'),
        ("[landmarks]", "[landmark]"),
    ],
)
def test_mistakes_are_not(campaign_schema, old, new):
    assert old in CAMPAIGN
    document = tomllib.loads(CAMPAIGN.replace(old, new, 1))
    with pytest.raises(InputError):
        check(document, CampaignConfig, "campaign.toml")
    assert not campaign_schema.is_valid(document)


def test_shipped_scenarios_are_valid():
    validator = Draft202012Validator(schema("scenario"))
    for path in shipped_scenarios().values():
        validator.validate(tomllib.loads(path.read_text()))


# What init writes ----------------------------------------------------------------------------------------------


def test_the_example_names_its_schema(tmp_path):
    run("init", tmp_path / "demo", "--images", 1)
    path = tmp_path / "demo" / "campaign.toml"
    first = path.read_text().splitlines()[0]
    beside = json.loads((path.parent / first.removeprefix("#:schema ")).read_text())
    Draft202012Validator(beside).validate(tomllib.loads(path.read_text()))
    assert load_campaign(path).campaign.images.ids == ("image01",)


def test_the_empty_campaign_parses_and_has_every_key(tmp_path, campaign_schema):
    assert run("init", tmp_path / "mine", "--template").exit_code == 0
    text = (tmp_path / "mine" / "campaign.toml").read_text()
    document = tomllib.loads(text)
    check(document, CampaignConfig, "campaign.toml")
    campaign_schema.validate(document)
    lines = [line.removeprefix("# ") for line in text.splitlines()]
    for name, field in CampaignConfig.model_fields.items():
        part, _ = _model_of(field.annotation)
        assert {f"[{name}]", f"[[{name}]]"} & set(lines)
        if name == "frames":
            continue
        section = lines[next(i for i, line in enumerate(lines) if line.strip("[]") == name) :]
        for key, each in part.model_fields.items():
            word = each.alias or key
            assert any(line.startswith(f"{word} = ") for line in section), f"{name}.{word}"


def keys():
    for name, field in CampaignConfig.model_fields.items():
        part, _ = _model_of(field.annotation)
        for key, each in part.model_fields.items():
            yield pytest.param(name, each.alias or key, each, id=f"{name}.{each.alias or key}")


@pytest.mark.parametrize(("section", "key", "field"), list(keys()))
def test_every_value_of_the_empty_campaign_is_one_that_the_key_takes(section, key, field):
    """Of a new key whose type alone makes no good value, EXAMPLES has one."""
    value = value_of(section, key, field, EXAMPLES)
    TypeAdapter(Annotated[field.annotation, field.description, *field.metadata]).validate_python(value)


def test_the_keys_that_stand_are_among_the_models():
    for name in {*ACTIVE, *(key for key in EXAMPLES if "." in key)}:
        section, key = name.split(".")
        part, _ = _model_of(CampaignConfig.model_fields[section].annotation)
        assert key in {field.alias or word for word, field in part.model_fields.items()}


def test_the_empty_campaign_lacks_rows_and_nothing_else(tmp_path):
    run("init", tmp_path / "mine", "--template")
    with pytest.raises(InputError, match=r"images.csv: found a header without rows below it"):
        load_campaign(tmp_path / "mine" / "campaign.toml")


@pytest.mark.slow
@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_a_scenario_is_copied_to_be_edited(tmp_path, name):
    assert run("init", tmp_path / "study", "--scenario", name).exit_code == 0
    path = tmp_path / "study" / "scenario.toml"
    assert path.read_text().splitlines()[1:] == shipped_scenarios()[name].read_text().splitlines()
    beside = json.loads((path.parent / "scenario.schema.json").read_text())
    Draft202012Validator(beside).validate(tomllib.loads(path.read_text()))
    assert load_scenario(path).name == load_scenario(name).name


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--template", "--scenario", "two-images"], "--scenario: found beside --template"),
        (["--scenario", "two-imges"], "did you mean two-images?"),
    ],
)
def test_what_cannot_be_begun_is_said(tmp_path, arguments, says):
    found = run("init", tmp_path / "new", *arguments)
    assert says in str(found.exception)
    assert not Path(tmp_path / "new").exists()


def test_nothing_is_overwritten(tmp_path):
    (tmp_path / "mine").write_text("")
    assert "wanted a new or empty folder" in str(run("init", tmp_path, "--template").exception)
