"""What the shell offers while a command is typed."""

from __future__ import annotations

from collections.abc import Iterable


def methods(incomplete: str) -> list[str]:
    """Estimators by name, the last of several with commas between."""
    from ...estimators import METHODS

    return _last_of(incomplete, METHODS)


def scenarios(incomplete: str) -> list[str]:
    """The shipped scenarios; files are the shell's own."""
    from ...io.scenario.read import shipped_scenarios

    return [name for name in shipped_scenarios() if name.startswith(incomplete)]


def parameters(incomplete: str) -> list[str]:
    """What else can be estimated, the last of several with commas between."""
    from ...table.parameter_names import CLOCKS, GROUPS

    return _last_of(incomplete, ("focal_length", *GROUPS, *CLOCKS, "trackers"))


def tables(incomplete: str) -> list[str]:
    """The published tables."""
    from ...published.tables import NAMES

    return [name for name in NAMES if name.startswith(incomplete)]


def documents(incomplete: str) -> list[str]:
    """The documents that have a schema."""
    from ...documents.catalogue import names

    return [name for name in names() if name.startswith(incomplete)]


def _last_of(incomplete: str, known: Iterable[str]) -> list[str]:
    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in known if name.startswith(last)]
