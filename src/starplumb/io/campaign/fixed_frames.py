"""[frames]: fixed rotations between named frames, and the way from any of them to any other.

Frames that rotations join make a tree: each has one frame that it is written from, and no way goes round.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from ...physics import so3
from ...physics.units import DEG
from ..tables.cells import Array
from ..text.files import show
from ..text.frames import earth_frame
from ..text.sections import Section
from ..text.values import Matrix, Quaternion, Text, Triple, axis_order

CAMERA = "camera"
"""The camera's side of the mounting."""

_FORMS = ("quaternion_xyzw", "quaternion_wxyz", "matrix", "rotation_vector_deg", "euler_deg")


class Turn(Section):
    """A rotation written in one of several forms.

    ``euler_deg`` with ``euler_order`` reads as ``scipy.spatial.transform.Rotation.from_euler``: capital
    letters turn about the axes as turned so far, small ones about the fixed axes, in the order written.
    """

    quaternion_xyzw: Quaternion | None = Field(default=None, description="four numbers, scalar last")
    quaternion_wxyz: Quaternion | None = Field(default=None, description="four numbers, scalar first")
    matrix: Matrix | None = Field(default=None, description="three rows of three numbers")
    rotation_vector_deg: Triple | None = Field(default=None, description="three numbers")
    euler_deg: Triple | None = Field(default=None, description="three angles")
    euler_order: Annotated[str, BeforeValidator(axis_order)] | None = Field(
        default=None, description='three axes such as "ZYX" or "xyz"'
    )

    @property
    def C(self) -> Array:
        """The matrix (3, 3) of the rotation as it is written."""
        if self.quaternion_xyzw is not None:
            return so3.from_quaternion(self.quaternion_xyzw)
        if self.quaternion_wxyz is not None:
            return so3.from_quaternion(np.roll(self.quaternion_wxyz, -1))
        if self.matrix is not None:
            return so3.nearest(self.matrix)
        if self.rotation_vector_deg is not None:
            return so3.exp(DEG * np.array(self.rotation_vector_deg))
        if self.euler_deg is not None and self.euler_order is not None:
            return _from_euler(self.euler_deg, self.euler_order)
        raise ValueError("the section states no rotation")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        stated = [key for key in _FORMS if key in given]
        if not stated:
            yield "quaternion_xyzw", f"missing, wanted exactly one of {', '.join(_FORMS)}"
        for key in stated[1:]:
            yield key, f"found beside {stated[0]}, wanted exactly one of {', '.join(_FORMS)}"
        if "euler_deg" in given and "euler_order" not in given:
            yield "euler_order", 'missing, wanted the three axes of euler_deg such as "ZYX" or "xyz"'
        if "euler_order" in given and "euler_deg" not in given:
            yield "euler_deg", "missing, wanted the three angles that euler_order names"


class Rotation(Turn):
    """A rotation that takes coordinates in ``from`` to those in ``to``."""

    source: Text = Field(alias="from", description="the name of a frame")
    target: Text = Field(alias="to", description="the name of a frame")


class FixedFrame(Turn):
    """frames.NAME: the rotation that takes coordinates in ``from`` to those in NAME."""

    source: Text = Field(alias="from", description="the name of the frame that the rotation starts from")


def _from_euler(angles_deg: tuple[float, ...], order: str) -> Array:
    """Product of the three turns, in the order written about turned axes (capitals), else about fixed
    ones."""
    axes = np.eye(3)
    turns = [
        so3.exp(a * DEG * axes["xyz".index(axis)]) for a, axis in zip(angles_deg, order.lower(), strict=True)
    ]
    first, second, third = turns if order.isupper() else reversed(turns)
    return np.asarray(first @ second @ third)


Join = tuple[str, str, Array]
"""Frames A and B and C_BA, which takes coordinates in A to those in B."""


@dataclass(frozen=True)
class Frames:
    """Frames joined by fixed rotations."""

    joins: tuple[Join, ...] = ()

    @classmethod
    def of(cls, frames: Mapping[str, FixedFrame], rotations: Iterable[Rotation] = ()) -> Frames:
        """The frames of [frames], and what other rotations join."""
        joins = [(frame.source, name, frame.C) for name, frame in frames.items()]
        return cls((*joins, *((turn.source, turn.target, turn.C) for turn in rotations)))

    def C(self, to: str, start: str) -> Array | None:
        """``C_to,start`` (3, 3), along the only way between the two; None where there is none."""
        return self._reached(start).get(to)

    def joined(self, name: str) -> set[str]:
        """The frames that rotations join with this one, itself among them."""
        return set(self._reached(name))

    def _reached(self, start: str) -> dict[str, Array]:
        """Every frame that is joined with ``start``, and the rotation to it."""
        reached, before = {start: np.eye(3)}, 0
        while len(reached) > before:
            before = len(reached)
            for a, b, C_ba in self.joins:
                if a in reached and b not in reached:
                    reached[b] = C_ba @ reached[a]
                elif b in reached and a not in reached:
                    reached[a] = C_ba.mT @ reached[b]
        return reached


def way(frames: Frames, to: str, start: str) -> Array:
    """``C_to,start`` (3, 3) of two frames that the rules found joined."""
    C = frames.C(to, start)
    if C is None:
        raise ValueError(f"no rotation joins {start} and {to}")
    return C


def written_frames(given: Mapping[str, Any], *more: tuple[str, str]) -> Frames:
    """Who is joined with whom by [frames] of a document and ``more`` pairs, the rotations left aside."""
    section = given.get("frames")
    links = section.items() if isinstance(section, dict) else ()
    pairs = [(frame.get("from"), name) for name, frame in links if isinstance(frame, dict)]
    return Frames(tuple((a, b, np.eye(3)) for a, b in (*pairs, *more) if isinstance(a, str)))


def frame_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Complaints about [frames]: frames of the Earth turn, and between two frames there is one way."""
    joins = written_frames(given).joins
    for i, (source, name, _) in enumerate(joins):
        for key, word in ((f"frames.{name}", name), (f"frames.{name}.from", source)):
            if earth_frame(word) is not None:
                yield key, f"found {show(word)}, wanted frames that are fixed to the satellite"
        if name in Frames(joins[:i]).joined(source):
            yield (
                f"frames.{name}.from",
                f"found {show(source)}, which other frames join with {show(name)} already, "
                "wanted one way between two frames",
            )
