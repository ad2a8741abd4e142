"""Every document by its name, and its JSON schema: what editors and other programs need of it."""

from __future__ import annotations

from importlib import import_module
from pkgutil import walk_packages
from typing import Any

from pydantic import BaseModel

from ..physics.errors import InputError, did_you_mean
from .document import Document

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_SETTINGS = {
    "campaign": ("io.campaign.config", "CampaignConfig"),
    "scenario": ("io.scenario.config", "ScenarioConfig"),
}
"""Documents that a user writes, in TOML."""
_OF_COMMAND = {"simulate": "simulation", "diagnose": "diagnosis", "project": "projection"}
"""What commands print whose name is another."""


def names() -> list[str]:
    """The names of all documents."""
    return [*_SETTINGS, *sorted(_written())]


def schema(name: str) -> dict[str, Any]:
    """The JSON schema of a document by its name, such as "campaign" or "result", or by what its key ``schema`` holds.

    Raises InputError for another name.
    """
    bare = name.removeprefix("starplumb-").partition("/")[0]
    bare = _OF_COMMAND.get(bare, bare)
    written = _written()
    if bare in _SETTINGS:
        module, model = _SETTINGS[bare]
        found = getattr(import_module(f"...{module}", __name__), model)
        return {"$schema": DIALECT, **_plain(_json_schema(found))}
    if bare not in written:
        hint = did_you_mean(bare, [*_SETTINGS, *written])
        raise InputError(f"schema: found {name!r}, wanted one of {', '.join(names())}{hint}")
    return {"$schema": DIALECT} | _json_schema(written[bare])


def _json_schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema(by_alias=True)


def _written() -> dict[str, type[Document]]:
    """Documents that starplumb writes, by what stands between "starplumb-" and their edition."""
    package = __name__.rpartition(".")[0]
    found = {}
    for module in walk_packages(import_module(package).__path__, f"{package}."):
        for model in vars(import_module(module.name)).values():
            if isinstance(model, type) and issubclass(model, Document) and model is not Document:
                found[model.kind().removeprefix("starplumb-").partition("/")[0]] = model
    return found


def _plain(schema: dict[str, Any]) -> dict[str, Any]:
    return {key: _without_null(value) for key, value in schema.items()}


def _without_null(schema: Any) -> Any:
    """A schema of a TOML document, which has no null: a key that may be left out is one of its own type."""
    if isinstance(schema, list):
        return [_without_null(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "anyOf" in schema:
        kinds = [kind for kind in schema["anyOf"] if kind != {"type": "null"}]
        schema = (
            {key: value for key, value in schema.items() if key not in ("anyOf", "default")}
            | ({"anyOf": kinds} if len(kinds) > 1 else kinds[0])
            | ({"default": schema["default"]} if schema.get("default") is not None else {})
        )
    return {key: _without_null(value) for key, value in schema.items()}
