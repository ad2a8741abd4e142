"""The fuzzy observer as its paper prints it, one run at a time on 3 x 3 matrices: an oracle and a yardstick."""

from __future__ import annotations

import numpy as np

from starplumb.physics import so3


def cycle_run(e_K, e_E, C_EJ, C_EK, P, *, alpha, beta, w, floor, cycles):
    """C_EK after the cycles, for one run: e_K, e_E (n, 3), C_EJ (n, 3, 3), formulas (2), (3) of the paper in J."""
    for _ in range(cycles):
        for k in range(len(e_K)):
            C_JE = C_EJ[k].T
            e_star_E = C_EK @ e_K[k]
            left = C_JE @ e_star_E - C_JE @ e_E[k]
            G = -C_JE @ so3.skew(e_star_E)
            theta = np.zeros(3)
            for i in range(3):
                g, z = G[i], left[i] - G[i] @ theta
                s = g @ P @ g
                K = P @ g / (alpha + s)
                gamma = np.sqrt(np.maximum(floor, np.array(w) * z * z / (beta + s)))
                P = np.diag(gamma) @ (P - np.outer(K, g @ P)) @ np.diag(gamma)
                P = 0.5 * (P + P.T)
                theta = theta + K * z
            C_EK = so3.exp(-theta) @ C_EK
    return C_EK
