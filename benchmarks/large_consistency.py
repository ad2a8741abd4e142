"""Are the sigmas of large self-calibrations right?  Campaigns with known truth, adjusted in chunks, by way of a sample.

    python benchmarks/large_consistency.py --campaigns 1000

For each size and set of unknowns: sd of error / sigma of the alignment, the same of the worst of the other unknowns,
and the normalised error squared over all of them divided by their number, which is 1 where the covariance is that of
the errors.  Each sd is known to ``1 / sqrt(2 campaigns)``.  Needs the extra ``fast``.
"""

from __future__ import annotations

import argparse

import numpy as np
from adjustment_size import table
from scenes import C_EK_TRUE, CAMERA

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import DEG
from starplumb.table.parameters import OPTICS, Optics, TimeOffset

SETS = {
    "alignment": (),
    "and focal length, k1": (Optics(CAMERA, ("focal_length", "k1"), (np.inf,) * 2),),
    "and clock": (TimeOffset(("time_offset",), (np.inf,)),),
    "and 8 numbers of interior orientation": (Optics(CAMERA, OPTICS, (np.inf,) * 8),),
}


def normalised(
    calibration: Gls, n: int, sigma_px: float, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Errors over sigmas (k,) of one campaign, and its normalised error squared."""
    axis = rng.standard_normal(3)
    model = so3.exp(DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    estimate = calibration(table(n, rng, sigma_px), model)
    error, covariance = so3.log(estimate.C_EK @ C_EK_TRUE.mT), estimate.covariance_E
    if estimate.parameters is not None:
        error = np.concatenate([error, estimate.parameters.values])
        covariance = estimate.parameters.covariance
    sigma = np.sqrt(np.diagonal(covariance))
    unit = covariance / (sigma[:, None] * sigma)  # metres beside a sixth power of them
    return error / sigma, float(error / sigma @ np.linalg.solve(unit, error / sigma))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--campaigns", type=int, default=1000)
    parser.add_argument("--sizes", type=int, nargs="*", default=[12_000, 100_000])
    parser.add_argument("--sigma-px", type=float, default=0.3, help="noise of a column and of a row")
    arguments = parser.parse_args()
    print("| sightings | unknown | sd of error / sigma x, y, z | worst of the others | squared / unknowns |")
    print("|---|---|---|---|---|", flush=True)
    for n in arguments.sizes:
        for number, (name, parameters) in enumerate(SETS.items()):
            calibration = Gls(parameters, compiled=True)
            runs = [
                normalised(calibration, n, arguments.sigma_px, np.random.default_rng([n, number, run]))
                for run in range(arguments.campaigns)
            ]
            errors, squared = np.array([run[0] for run in runs]), np.array([run[1] for run in runs])
            sd, k = np.std(errors, axis=0), errors.shape[1]
            worst = f"{max(sd[3:], key=lambda value: abs(value - 1.0)):.3f}" if k > 3 else ""
            known = np.std(squared) / k / np.sqrt(squared.size)
            print(
                f"| {n} | {name} | {sd[0]:.3f} {sd[1]:.3f} {sd[2]:.3f} | {worst} "
                f"| {np.mean(squared) / k:.3f} +- {known:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
