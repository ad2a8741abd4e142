"""Finished images of a measurement that has not ended, beside its output: the next run goes on from them."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...disk.arrays import read_arrays, write_arrays
from ...disk.parts import remove, stale
from ...imagery.acquisition import Acquisition, Peak
from ...imagery.chain import MeasuredImage
from ...imagery.chips import Chip
from ...imagery.pictures import Picture
from ...imagery.search import Found
from ...imagery.targets.chain import SeenTargets
from ...imagery.targets.fit import Fit, Noise
from ...imagery.targets.measuring import Target
from ...imagery.verdicts import Candidate, Verdict

KINDS = {
    kind.__name__: kind
    for kind in (
        *(Acquisition, Peak, MeasuredImage, Found, Chip, Candidate, Picture),
        *(SeenTargets, Target, Fit, Noise),
    )
}
LAYOUT = "layout"
"""The array of a file that says, as JSON, which of the others stands where."""
ENDING = ".unfinished"


@dataclass(frozen=True)
class KeptImages:
    """A folder of what a measurement has finished; ``about`` is all that this depends on."""

    folder: Path
    about: str

    @classmethod
    def beside(cls, out: Path, about: str) -> KeptImages:
        return cls(_folder(out), about)

    def recall(self, name: str) -> Any | None:
        """What was kept under a name; None where there is nothing, or it is of other inputs or spoilt."""
        arrays = read_arrays(self._path(name), self._about(name))
        try:
            return None if arrays is None else unpacked(arrays)
        except (
            LookupError,
            TypeError,
            ValueError,
            RecursionError,
        ):  # whoever wrote the digest wrote another thing
            return None

    def keep(self, name: str, thing: object) -> None:
        """Write it.  Raises InputError where that cannot be done."""
        write_arrays(self._path(name), packed(thing), self._about(name))

    def remove(self) -> None:
        """Remove what such a measurement keeps, and the folder where nothing else is in it."""
        for path in self.folder.glob("*.npz"):
            path.unlink(missing_ok=True)
        for part in stale(self.folder):
            remove(part)
        try:
            self.folder.rmdir()
        except OSError:  # it holds something else, or was never made
            return

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.npz"

    def _about(self, name: str) -> str:
        return f"{name} {self.about}"


def finished(out: Path) -> tuple[Path, int]:
    """The folder beside an output in which images are kept, and how many there are."""
    return _folder(out), len(list(_folder(out).glob("image*.npz")))


def _folder(out: Path) -> Path:
    place = out.resolve()
    return place.with_name(place.name + ENDING)


def packed(thing: object) -> dict[str, NDArray[Any]]:
    """An object of :data:`KINDS` as arrays, from which :func:`unpacked` makes it again to the last bit."""
    arrays: list[NDArray[Any]] = []
    layout = json.dumps(_plain(thing, arrays))
    return {LAYOUT: np.array(layout), **{f"a{k}": values for k, values in enumerate(arrays)}}


def unpacked(arrays: dict[str, NDArray[Any]]) -> Any:
    return _thing(json.loads(str(arrays[LAYOUT])), arrays)


def _plain(value: Any, arrays: list[NDArray[Any]]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if is_dataclass(value):
        of = {field.name: _plain(getattr(value, field.name), arrays) for field in fields(value)}
        return {"kind": type(value).__name__, "of": of}
    if isinstance(value, tuple):
        return {"tuple": [_plain(each, arrays) for each in value]}
    if isinstance(value, Verdict):
        return {"verdict": str(value)}
    return value.item() if isinstance(value, np.generic) else value


def _thing(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[f"a{value['array']}"]
    if "tuple" in value:
        return tuple(_thing(each, arrays) for each in value["tuple"])
    if "verdict" in value:
        return Verdict(value["verdict"])
    return KINDS[value["kind"]](**{name: _thing(each, arrays) for name, each in value["of"].items()})
