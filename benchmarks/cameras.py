"""Two cameras that image together: their relative mounting from one adjustment, beside two calibrations apart.

    python benchmarks/cameras.py --runs 300 --seed 71000

Twelve images by both cameras at the same times, 12 markers each, whose errors of tracker and orbit both share.  The
second camera's mounting against the first is three parameters of one table (``CameraMounting`` below; the package has
no such parameter yet).  "Bound" is that of dense matrices.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scenes import C_EK_TRUE, marked, photographed

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.observations import PER_SIGHTING, Observations
from starplumb.table.parameters import Moves
from starplumb.table.simulate import Errors, measure

IMAGES, MARKERS = 12, 12
OFF_E = np.array([30.0, -20.0, 40.0]) * ARCSEC
"""Where the second camera really stands against the model."""


@dataclass(frozen=True)
class CameraMounting:
    """Mounting of the camera that took the sightings ``mine`` (n,) against the first one's, rad about E: a turn of the
    attitude by which they are seen, as the mounting of a second star tracker is."""

    mine: np.ndarray
    sigma: tuple[float, ...] = (np.inf,) * 3
    range: tuple[float, ...] = (10.0 * DEG,) * 3
    names: tuple[str, ...] = ("camera_B_x", "camera_B_y", "camera_B_z")

    def apply(self, observations: Observations, value: np.ndarray) -> Observations:
        o = observations
        turned = so3.exp(-value)[..., None, :, :] @ o.C_EJ
        return o.with_geometry(C_EJ=np.where(self.mine[:, None, None], turned, o.C_EJ))

    def moves(self, _: Observations, value: np.ndarray) -> Moves:
        J = so3.left_jacobian(-value)[..., None, :, :]
        return Moves(turn_E=np.where(self.mine[:, None, None], -J, 0.0))


def together(a: Observations, b: Observations) -> Observations:
    """One table of two cameras: the same images, landmarks of their own."""
    rows = {name: np.concatenate([getattr(a, name), getattr(b, name)]) for name in PER_SIGHTING}
    return replace(
        a,
        **rows,
        image=np.concatenate([a.image, b.image]),
        landmark=np.concatenate([a.landmark, b.landmark + a.n_landmarks]),
        cov_landmark_J=np.concatenate([a.cov_landmark_J, b.cov_landmark_J]),
    )


def bound(o: Observations, mine: np.ndarray) -> np.ndarray:
    """Sigmas (3,) rad of the relative mounting by one dense covariance of all residuals."""
    model = linearise(o, C_EK_TRUE)
    V = np.zeros((o.n, 2, o.n, 2))
    for i in range(o.n_images):
        rows = np.flatnonzero(o.image == i)
        H, R = (M[rows].reshape(-1, 3) for M in (model.H, model.R))
        block = H @ o.cov_attitude_E[i] @ H.T + R @ o.cov_position_J[i] @ R.T
        V[np.ix_(rows, [0, 1], rows, [0, 1])] = block.reshape(rows.size, 2, rows.size, 2)
    for j in range(o.n):
        V[j, :, j] += o.noise_px[j] + model.R[j] @ o.cov_landmark_J[o.landmark[j]] @ model.R[j].T
    A = np.concatenate([model.H, np.where(mine[:, None, None], model.H, 0.0)], axis=-1).reshape(-1, 6)
    information = A.T @ np.linalg.solve(V.reshape(2 * o.n, -1), A)
    return np.sqrt(np.diag(np.linalg.inv(information)))[3:]


def cells(*rows: Sequence[float]) -> str:
    return " | ".join(", ".join(f"{x:.3g}" for x in row) for row in rows)


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--runs", type=int, default=300)
    options.add_argument("--seed", type=int, default=71000)
    asked = options.parse_args()
    rng = np.random.default_rng(asked.seed)
    cameras = [observe(marked(photographed(IMAGES), MARKERS, rng)) for _ in range(2)]
    print("| tracker, arcsec | apart | together | bound | apart / together | error / sigma | held |")
    print("|---|---|---|---|---|---|---|")
    for tracker in ((5.0, 5.0, 12.0), (1.0, 1.0, 2.0)):
        covariance = np.broadcast_to(np.diag((np.array(tracker) * ARCSEC) ** 2), (IMAGES, 3, 3))
        a, b = (replace(o, cov_attitude_E=covariance) for o in cameras)
        apart = np.hypot(*(Gls()(o, C_EK_TRUE).sigma_E for o in (a, b)))
        true = together(a, b)
        second = CameraMounting(np.arange(true.n) >= a.n)
        drawn = measure(true, C_EK_TRUE, Errors.draw(true, rng, (asked.runs,)))
        table = second.apply(drawn, np.broadcast_to(-OFF_E, (asked.runs, 3)))
        found = Gls((second,))(table, C_EK_TRUE).parameters
        sigma = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))[:, 3:]
        score, own = (found.values - OFF_E) / sigma, sigma.mean(axis=0)
        row = cells(
            apart / ARCSEC,
            own / ARCSEC,
            bound(true, second.mine) / ARCSEC,
            apart / own,
            np.sqrt(np.mean(score**2, axis=0)),
            np.mean(np.abs(score) < 1.96, axis=0),
        )
        print(f"| {tracker[0]:g}, {tracker[1]:g}, {tracker[2]:g} | {row} |")


if __name__ == "__main__":
    main()
