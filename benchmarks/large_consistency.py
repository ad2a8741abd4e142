"""Are the sigmas of large self-calibrations right?  Campaigns with known truth, adjusted in chunks, by way of a sample.

    python benchmarks/large_consistency.py --campaigns 1000

For each size and set of unknowns: sd of error / sigma of the alignment, the same of the worst of the other unknowns,
and the normalised error squared over all of them divided by their number, which is 1 where the covariance is that of
the errors; and how often 1.96 sigmas hold about x, y, z.  Each sd is known to ``1 / sqrt(2 campaigns)``.  ``--lens``
is what the true lens distorts beyond the stated one.  Needs the extra ``fast``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from adjustment_size import table
from scenes import C_EK_TRUE, CAMERA

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.camera import Distortion
from starplumb.physics.units import DEG
from starplumb.table.observations import Observations
from starplumb.table.parameters import OPTICS, Optics, TimeOffset

SETS = {
    "alignment": (),
    "and focal length, k1": (Optics(CAMERA, ("focal_length", "k1"), (np.inf,) * 2),),
    "and clock": (TimeOffset(("time_offset",), (np.inf,)),),
    "and 8 numbers of interior orientation": (Optics(CAMERA, OPTICS, (np.inf,) * 8),),
}


def distorted(o: Observations, lens: Distortion) -> Observations:
    """The table with marks where this lens has them, read with the one that the scene states."""
    pixel = replace(CAMERA, distortion=lens).px_from_tan(o.xy_K)
    xy_K, slope_K = CAMERA.tan_from_px(pixel[:, 0], pixel[:, 1])
    return replace(o, xy_K=xy_K, slope_K=np.array(slope_K))


def normalised(
    calibration: Gls, n: int, sigma_px: float, lens: Distortion, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Errors over sigmas (k,) of one campaign, and its normalised error squared."""
    axis = rng.standard_normal(3)
    model = so3.exp(DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    o = table(n, rng, sigma_px)
    estimate = calibration(o if lens.is_zero else distorted(o, lens), model)
    error, covariance = so3.log(estimate.C_EK @ C_EK_TRUE.mT), estimate.covariance_E
    if estimate.parameters is not None:
        p = estimate.parameters
        true = dict(zip(("k1", "k2", "k3", "p1", "p2"), (*lens.k, *lens.p), strict=True))
        error = np.concatenate([error, p.values - [true.get(name, 0.0) for name in p.names]])
        covariance = p.covariance
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
    parser.add_argument("--lens", type=float, default=0.0, help="k1 in 0.3, p1 and p2 in 5e-4")
    parser.add_argument("--only", default="", help="part of the names of what is unknown")
    arguments = parser.parse_args()
    lens = Distortion((0.3 * arguments.lens, 0.0, 0.0), (5e-4 * arguments.lens,) * 2)
    print(
        "| sightings | unknown | sd of error / sigma x, y, z | worst of the others | squared / unknowns | 95 % hold |"
    )
    print("|---|---|---|---|---|---|", flush=True)
    for n in arguments.sizes:
        for number, (name, parameters) in enumerate(SETS.items()):
            if arguments.only not in name:
                continue
            calibration = Gls(parameters)
            runs = [
                normalised(calibration, n, arguments.sigma_px, lens, np.random.default_rng([n, number, run]))
                for run in range(arguments.campaigns)
            ]
            errors, squared = np.array([run[0] for run in runs]), np.array([run[1] for run in runs])
            sd, k = np.std(errors, axis=0), errors.shape[1]
            worst = f"{max(sd[3:], key=lambda value: abs(value - 1.0)):.3f}" if k > 3 else ""
            holds = " ".join(f"{share:.3f}"[1:] for share in np.mean(np.abs(errors[:, :3]) < 1.96, axis=0))
            known = np.std(squared) / k / np.sqrt(squared.size)
            print(
                f"| {n} | {name} | {sd[0]:.3f} {sd[1]:.3f} {sd[2]:.3f} | {worst} "
                f"| {np.mean(squared) / k:.3f} +- {known:.3f} | {holds} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
