"""Marks exposed where neither attitude nor orbit tells how the camera stood: named, and left out on request."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ....physics.errors import InputError
from ....table.campaign import Campaign, Detections, Sightings, some_of
from ....table.coverage import covered, why_not
from ...tables.read import Table

Outside = Literal["refuse", "skip"]
"""What becomes of marks outside attitude or orbit."""
Rows = NDArray[np.int64]
MOST_NAMED = 5


@dataclass(frozen=True)
class LeftOut:
    """A mark that was left out: its ids (no landmark's where that is not known), its row and why."""

    image_id: str
    landmark_id: str | None
    where: str
    reason: str


@dataclass(frozen=True)
class Coverage:
    """Marks of a campaign, the table that names their ``rows``, and which of them (n,) are ``covered``."""

    campaign: Campaign
    marks: Sightings | Detections
    rows: Table
    covered: NDArray[np.bool_]

    @classmethod
    def of(cls, campaign: Campaign, detections: Detections | None, rows: Table) -> Coverage:
        marks = campaign.sightings if detections is None else detections
        return cls(campaign, marks, rows, covered(campaign, marks.image, marks.row_px))

    @property
    def outside(self) -> Rows:
        """The marks (k,) that are not covered."""
        return np.flatnonzero(~self.covered)

    @property
    def told(self) -> str:
        """How many of how many marks are outside, their rows, and the reason of the first."""
        rows, all_of_them = self.outside, self.covered.size
        names = [str(self.rows.row_number(int(row))) for row in rows[:MOST_NAMED]]
        more = f" and {rows.size - MOST_NAMED} more" if rows.size > MOST_NAMED else ""
        named = f" (rows {', '.join(names)}{more})" if rows.size > 1 and not self.rows.places else ""
        count = f"{rows.size} of {all_of_them} marks outside attitude or orbit{named}"
        return f"{count}: {self._why(int(rows[0]))}"

    def require(self) -> None:
        """Raise InputError where a campaign cannot be calibrated: no control mark, or one that is not covered."""
        if isinstance(self.marks, Sightings) and np.all(self.marks.check):
            source = self.rows.source
            if not self.marks.check.size:
                raise InputError(f"{source}: found no rows yet, wanted at least one observation")
            role = self.rows.declared.name("role")
            raise InputError(
                f"{source}, column {role}: found only check points, wanted some with the role control"
            )
        if self.outside.size:
            where = self.rows.where(int(self.outside[0]))
            raise InputError(
                f'{where}: found {self.told}; outside = "skip" (--outside skip) leaves such marks out'
            )

    def left_out(self) -> tuple[LeftOut, ...]:
        """What is left out with ``outside = "skip"``.  Raises InputError where nothing remains."""
        if self.covered.size and not self.covered.any():
            raise InputError(f"{self.rows.source}: found {self.told}")
        return tuple(self._entry(row) for row in self.outside.tolist())

    def kept(self) -> tuple[Sightings | Detections, Table]:
        """The marks that are covered, and the table that names their rows."""
        rows = np.flatnonzero(self.covered)
        return some_of(self.marks, rows), self.rows.named_only(rows.tolist(), {})

    def _entry(self, row: int) -> LeftOut:
        marks, campaign = self.marks, self.campaign
        landmark = campaign.landmarks.ids[marks.landmark[row]] if isinstance(marks, Sightings) else None
        image = campaign.images.ids[marks.image[row]]
        return LeftOut(image, landmark, self.rows.where(row), self._why(row))

    def _why(self, row: int) -> str:
        return why_not(self.campaign, int(self.marks.image[row]), float(self.marks.row_px[row]))
