"""How wide an interval must be on average, where the stated variance is true, that holds where it is larger too.

    python benchmarks/variance_bound.py

An oracle knows all but one factor F of the variance of the answer, and that F is 1 or larger; what it has is a sum of
squares, F times a chi-square of so many degrees of freedom, independent of the error.  Among all rules that give a
half-width for each sum of squares, also by lot, a linear program finds the one of the least mean width at F = 1 that
holds with a given probability at each of some factors.  Those between are left free, so that no rule is narrower.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, kron, vstack
from scipy.special import ndtr
from scipy.stats import chi2

FACTORS = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0])
CASES = {
    3: "2 passes, what they share",
    7: "8 images, about the weak axis",
    12: "5 passes",
    14: "8 images, across",
    27: "10 passes; 10 images about and across",
    38: "20 images, across",
}
STATED = 1.959964
CELLS, WIDTHS = (
    120,
    np.concatenate([np.linspace(0.0, STATED, 66), np.linspace(1.99, 3.0, 35), np.geomspace(3.05, 40.0, 60)]),
)


def least_width(degrees: int, held: float, least: float = 0.0) -> float:
    """The least mean half-width at F = 1, in that which a known variance needs for 95 %, of rules that never give less
    than ``least`` sigmas."""
    widths = WIDTHS[least <= WIDTHS]
    edges = np.concatenate([[0.0], np.geomspace(0.02, 60.0, CELLS - 1) * degrees, [np.inf]])
    p = np.diff(chi2.cdf(edges / FACTORS[:, None], degrees), axis=1)  # factors, cells
    holds = 2.0 * ndtr(widths / np.sqrt(FACTORS)[:, None]) - 1.0  # factors, widths
    must = vstack([csr_array(-np.kron(p[k], holds[k])[None]) for k in range(FACTORS.size)])
    one = kron(np.eye(CELLS), np.ones((1, widths.size)), format="csr")
    cost = np.kron(p[0], widths)
    found = linprog(cost, must, np.full(FACTORS.size, -held), one, np.ones(CELLS), method="highs")
    return float(found.fun) / STATED


def main() -> None:
    print(
        "| degrees of freedom | such as | held 93 % | held 95 % | and never below the stated |\n|---|---|---|---|---|"
    )
    for degrees, such_as in CASES.items():
        rules = ((0.93, 0.0), (0.95, 0.0), (0.95, STATED))
        widths = " | ".join(f"{least_width(degrees, held, least):.2f}" for held, least in rules)
        print(f"| {degrees} | {such_as} | {widths} |", flush=True)


if __name__ == "__main__":
    main()
