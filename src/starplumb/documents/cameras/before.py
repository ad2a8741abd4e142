"""The mountings of several cameras in an earlier result, as another campaign knows them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...physics.units import ARCSEC
from ...table.cameras.known import RANGE
from ...table.cameras.rig import Rig
from ..result import ResultDocument

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RigBefore:
    """The mountings ``C_EC`` (k, 3, 3) of cameras by ``names``, and the covariance (3 k, 3 k) rad^2 of their errors."""

    names: tuple[str, ...]
    C_EC: Array
    covariance_E: Array

    @classmethod
    def of(cls, document: ResultDocument) -> Self | None:
        """Those of a result; None of one camera, or where some mounting is not known."""
        each, P = document.mountings, document.mountings_covariance_arcsec2
        if each is None or P is None or len(each) < 2:
            return None
        C_EC = np.array([one.matrix for one in each])
        return cls(tuple(one.camera for one in each), C_EC, ARCSEC**2 * np.array(P))

    def known_of(self, rig: Rig, covariance_E: Array) -> Rig:
        """Cameras, the first of which is here, with the mountings that are known of them, and the covariance of all; of
        one that is not here the model against the first is kept, known within some degrees.

        ``covariance_E`` (3, 3) is that of the first one's mounting as it is known now: what grew since, or was widened,
        did so of all.
        """
        first = self.names.index(rig.names[0])
        own = [self.names.index(name) if name in self.names else None for name in rig.names]
        C_KC, P = np.array(rig.C_KC), np.zeros((3 * len(own), 3 * len(own)))
        T, away = np.zeros((len(P), len(self.covariance_E))), np.zeros(len(P))
        for k, i in enumerate(own):
            source = first if i is None else i
            T[3 * k : 3 * k + 3, 3 * source : 3 * source + 3] = np.eye(3)
            if i is None:
                away[3 * k : 3 * k + 3] = RANGE**2
            else:
                C_KC[k] = self.C_EC[first].T @ self.C_EC[i]
        P = T @ self.covariance_E @ T.T
        grown = max(1.0, float(np.max(np.diagonal(covariance_E) / np.diagonal(P)[:3])))
        return Rig(rig.names, rig.cameras, C_KC, rig.of_image, grown * P + np.diag(away))
