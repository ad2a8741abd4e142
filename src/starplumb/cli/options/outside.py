"""The option of the commands that read a campaign: what becomes of marks outside attitude or orbit."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer


class Choice(StrEnum):
    """What to do with marks, rows or points that attitude or orbit do not cover."""

    REFUSE = "refuse"
    SKIP = "skip"


OutsideOption = Annotated[
    Choice,
    typer.Option("--outside", help="What attitude or orbit do not cover: refused, or left out and listed."),
]
