"""A scenario in a session: a scene with its error sources, for budgets and studies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..io.scenario.read import Read, read_scenario
from ..plan.scenario import Scenario as Data
from ..report.text import counted
from .arguments import checked
from .show import Shown


@dataclass(frozen=True, repr=False, eq=False)
class Scenario(Shown):
    """A scenario that was read and checked; ``data`` holds the scene and its error sources, in SI units, ``read``
    what its document says."""

    made_by: ClassVar[str] = "scenario"

    data: Data
    read: Read

    @property
    def name(self) -> str:
        return self.data.name

    @property
    def sentences(self) -> Sequence[str]:
        truth = self.data.truth
        sources = ", ".join(source.name for source in self.data.sources)
        return (
            f"Scenario {self.name!r}: {counted(truth.n, 'observation')} in "
            f"{counted(truth.n_images, 'image')}; errors: {sources}",
            *([self.data.description] if self.data.description else []),
        )


@checked
def scenario(source: Mapping[str, Any] | str | Path) -> Scenario:
    """A shipped scenario by its name, that of a TOML file, or of a dictionary with the keys of such a file.

    Raises InputError, one line with all that is wrong.
    """
    found = read_scenario(source)
    return Scenario(found.built, found)
