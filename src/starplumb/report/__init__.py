"""Reports: one self-contained page of HTML with figures, for a technical note, a screen or a printer.

:mod:`.page` renders a report stated as data, :mod:`.plots` draws; :mod:`.calibration`, :mod:`.simulation` and
:mod:`.budget` say what was found.
"""
