"""What the shell offers while a command is typed."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import typer


def methods(incomplete: str) -> list[str]:
    """Estimators by name, the last of several with commas between."""
    from ...estimators import METHODS

    return _last_of(incomplete, METHODS)


def scenarios(incomplete: str) -> list[str]:
    """The shipped scenarios; files are the shell's own."""
    from ...io.scenario.read import shipped_scenarios

    return _begun(incomplete, shipped_scenarios())


def parameters(incomplete: str) -> list[str]:
    """What else can be estimated, the last of several with commas between."""
    from ...table.parameter_names import CLOCKS, GROUPS

    return _last_of(incomplete, ("focal_length", *GROUPS, *CLOCKS, "trackers"))


def tables(incomplete: str) -> list[str]:
    """The published tables."""
    from ...published.tables import NAMES

    return _begun(incomplete, NAMES)


def documents(incomplete: str) -> list[str]:
    """The documents that have a schema."""
    from ...documents.catalogue import names

    return _begun(incomplete, names())


def drifts(incomplete: str) -> list[str]:
    """How a mounting may move: some models as they are, of others the beginning."""
    from ...judge.motion.asked import AUTO, NONE
    from ...judge.motion.regressors import LINEAR, ORBIT, STEP, TEMPERATURE

    if "," not in incomplete and (alone := _begun(incomplete, (NONE, AUTO))):
        return alone
    return _last_of(incomplete, (LINEAR, f"{ORBIT}:1", f"{ORBIT}:2", f"{STEP}:", f"{TEMPERATURE}:"))


def samples(incomplete: str) -> list[str]:
    """What becomes of the single trials."""
    return _begun(incomplete, ("auto", "parquet", "none"))


def starts(incomplete: str) -> list[str]:
    """Where methods start that need a start."""
    return _begun(incomplete, ("closed-form", "model"))


def images(ctx: typer.Context, incomplete: str) -> list[str]:
    """Images of the campaign on the line, where it can be read."""
    from ...io.campaign.read import load_images
    from ...physics.errors import InputError

    # an option without its value leaves the arguments before it unread
    files = [ctx.params.get("campaign"), *map(Path, ctx.args)]
    settings = next((path for path in files if path is not None and path.suffix == ".toml"), None)
    try:
        return [] if settings is None else _begun(incomplete, load_images(settings).campaign.images.ids)
    except InputError:
        return []


def _begun(incomplete: str, known: Iterable[str]) -> list[str]:
    return [name for name in known if name.startswith(incomplete)]


def _last_of(incomplete: str, known: Iterable[str]) -> list[str]:
    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in known if name.startswith(last)]
