"""Reports: one self-contained page of HTML with figures, for a technical note, a screen or a printer.

:mod:`.page` renders a report stated as data, :mod:`.plots` draws; :mod:`.calibration`, :mod:`.simulation` and
:mod:`.budget` say what was found.
"""

from __future__ import annotations

from .budget import budget_page
from .calibration import calibration_page
from .simulation import simulation_page
from .simulation_figures import simulation_files

__all__ = ["budget_page", "calibration_page", "simulation_files", "simulation_page"]
