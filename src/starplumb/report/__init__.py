"""Reports: one self-contained page of HTML with figures, for a technical note, a screen or a printer.

:mod:`.page` renders a report stated as data, :mod:`.plots` draws, :mod:`.calibration` tells what a calibration found.
"""

from __future__ import annotations

from .calibration import calibration_page

__all__ = ["calibration_page"]
