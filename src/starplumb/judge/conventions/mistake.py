"""What a possible mistake is: the change that would undo it, and what it costs to believe in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...physics.timescales import format_iso
from ...table.campaign import Campaign
from ...table.parameters import Parameter

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Written:
    """How the campaign's files say what they hold; needed to undo a misreading in the file's own terms."""

    time_scale: str = "UTC"
    attitude_to_tracker: bool = True
    mounting_from_camera: bool = True


def _as_it_stands(campaign: Campaign) -> Campaign:
    return campaign


@dataclass(frozen=True)
class Mistake:
    """A possible mistake: ``key`` for programs, what would be wrong, what to change, and the change itself.

    ``undo`` raises InputError where the campaign leaves no room for it.  ``free`` are parameters to estimate once it is
    undone, and ``measured`` says what is wrong with their values and standard deviations.  ``cost`` is minus twice the
    logarithm of the odds against this mistake before the data are seen, where it is one of many of its kind.
    ``evidence`` is a sentence on what shows the mistake without any residual; empty where only the residuals do.
    """

    key: str
    what: str
    remedy: str
    undo: Callable[[Campaign], Campaign] = _as_it_stands
    free: tuple[Parameter, ...] = ()
    measured: Callable[[Array, Array], str] | None = None
    cost: float = 0.0
    evidence: str = ""

    @property
    def kind(self) -> str:
        """What the mistake is made in: two of one kind are not tried together."""
        return self.key.split(".")[0]


def epoch_text(t_ns: int) -> str:
    """An epoch for messages, UTC to the millisecond."""
    return f"{format_iso(np.array([t_ns]), 'UTC', 3)[0]} UTC"


def image_text(campaign: Campaign, image: int) -> str:
    """An image for messages: its id and its time."""
    return f"image {campaign.images.ids[image]!r} ({epoch_text(int(campaign.images.t_ns[image]))})"
