"""The special functions of SciPy without the rest of ``scipy.special``.

That package loads, for other kinds of arrays than NumPy's, a Fortran translator and two test frameworks: a quarter of
the time of a small campaign.  Its compiled functions alone take a tenth of that; they are the same objects.
"""

from __future__ import annotations

import sys
import threading
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

_WHOLE, _COMPILED = "scipy.special", "scipy.special._ufuncs"


def __getattr__(name: str) -> Any:
    """A function of ``scipy.special`` by its name."""
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    compiled = _functions()
    return getattr(compiled if hasattr(compiled, name) else import_module(_WHOLE), name)


def _functions() -> ModuleType:
    """The compiled functions by themselves where that can be done unseen, else the whole package."""
    if _COMPILED not in sys.modules and _WHOLE not in sys.modules and threading.active_count() == 1:
        _load_compiled()
    return sys.modules.get(_COMPILED) or import_module(_WHOLE)


def _load_compiled() -> None:
    """Load them under an empty package, which is gone before anybody else can see it.

    A SciPy in which they are elsewhere is left to be imported whole.
    """
    scipy = find_spec("scipy")
    empty = ModuleType(_WHOLE)
    empty.__path__ = [
        str(Path(place) / "special") for place in (scipy and scipy.submodule_search_locations) or ()
    ]
    sys.modules[_WHOLE] = empty
    try:
        import_module(_COMPILED)
    except (ImportError, AttributeError):
        for name in [name for name in sys.modules if name.startswith(f"{_WHOLE}.")]:
            del sys.modules[name]
    finally:
        del sys.modules[_WHOLE]
