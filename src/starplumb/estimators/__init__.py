"""The estimators by the names of the command line."""

from __future__ import annotations

from collections.abc import Callable

from .gls import Gls
from .protocol import Estimator
from .wahba import Wahba

METHODS: dict[str, Callable[[], Estimator]] = {"gls": Gls, "wahba": Wahba}
