"""Landmarks seen again and again: one estimate of a large campaign whose landmarks' errors are shared by many images.

    OPENBLAS_NUM_THREADS=1 python benchmarks/repeated_landmarks.py --memory

``site`` are 20 images of the same 20 000 landmarks, ``strip`` 10 000 images along an orbit that overlap so that each of
1e5 landmarks is seen by some ten of them, ``archive`` 10 000 images of the same 200 landmarks, ``random`` 10 000 images
of 100 landmarks each, drawn out of 50 000.  CPU seconds, and the memory above the table.  ``--scale`` divides the
numbers of images, or of landmarks of the site.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scenes import C_EK_TRUE, SIGMAS, marked, photographed

from starplumb.estimators.gls import Gls
from starplumb.physics import so3
from starplumb.plan.scene import survey
from starplumb.table.geometry import locate, observe, project
from starplumb.table.observations import PER_SIGHTING, Observations
from starplumb.table.simulate import Errors, measure

OVERLAP = 10
"""Images of a strip that see a landmark."""


def site(scale: int, rng: np.random.Generator) -> Observations:
    """20 images of the same landmarks."""
    return again(1, 20, 20_000 // scale, rng)


def archive(scale: int, rng: np.random.Generator) -> Observations:
    """Images of the same 200 landmarks: 40 views again and again."""
    return again(max(1, 250 // scale), 40, 200, rng)


def again(repeats: int, images: int, markers: int, rng: np.random.Generator) -> Observations:
    """True views, repeated, of which landmark number j is the same in all of them.

    What the camera saw is moved to one place: directions and distances are those of each view, and so consistent.
    """
    view = observe(marked(photographed(images), markers, rng))
    rows = np.tile(np.arange(view.n), repeats)
    m = images * repeats
    return replace(
        view,
        **{name: getattr(view, name)[rows] for name in PER_SIGHTING},
        epoch_s=None,
        image=np.repeat(np.arange(m), markers),
        landmark=np.tile(np.arange(markers), m),
        cov_attitude_E=np.array(np.broadcast_to(view.cov_attitude_E[0], (m, 3, 3))),
        cov_position_J=np.array(np.broadcast_to(view.cov_position_J[0], (m, 3, 3))),
        cov_landmark_J=view.cov_landmark_J[:markers],
    )


def drawn(scale: int, rng: np.random.Generator) -> Observations:
    """Images of 100 landmarks each, drawn at random: every image is coupled to many others."""
    table = again(max(1, 250 // scale), 40, 100, rng)
    L = 5 * table.n_images
    covariance = np.tile(table.cov_landmark_J[:1], (L, 1, 1))
    return replace(table, landmark=rng.integers(L, size=table.n), cov_landmark_J=covariance)


def strip(scale: int, rng: np.random.Generator) -> Observations:
    """Images half a second apart along the orbit; ten new landmarks come with each."""
    campaign = photographed(10_000 // scale, tilt_deg=0.0, step_s=0.5)
    m = len(campaign.images.ids)
    home = np.repeat(np.arange(m), OVERLAP)
    pixel = rng.uniform(0.0, 11999.0, (home.size, 2))
    p_J = locate(campaign, campaign.C_EK, home, pixel[:, 0], pixel[:, 1], rng.uniform(0.0, 1500.0, home.size))
    near = home[:, None] + np.arange(-OVERLAP, OVERLAP + 1)
    landmark, which = np.nonzero((near >= 0) & (near < m))
    image = near[landmark, which]
    seen = project(campaign, campaign.C_EK, image, p_J[landmark])
    inside = np.flatnonzero(np.all((seen >= 0.0) & (seen <= 11999.0), axis=1))
    inside = inside[np.argsort(image[inside], kind="stable")]
    sightings = replace(
        campaign.sightings,
        image=image[inside],
        landmark=landmark[inside],
        column_px=seen[inside, 0],
        row_px=seen[inside, 1],
        sigma_px=np.full(inside.size, SIGMAS.pixel),
        check=np.zeros(inside.size, dtype=bool),
    )
    return observe(replace(campaign, landmarks=survey(p_J, SIGMAS.landmark), sightings=sightings))


CASES: dict[str, Callable[[int, np.random.Generator], Observations]] = {
    "site": site,
    "strip": strip,
    "archive": archive,
    "random": drawn,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cases", nargs="*", help=f"of {list(CASES)}, all if none is named")
    parser.add_argument("--scale", type=int, default=1)
    parser.add_argument("--memory", action="store_true", help="measure the memory in another run")
    arguments = parser.parse_args()
    print(
        "| case | images | landmarks | sightings | CPU s | passes | table MB | above it MB | error / sigma |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    model = so3.exp(np.array([0.01, -0.005, 0.008])) @ C_EK_TRUE
    for name in arguments.cases or CASES:
        rng = np.random.default_rng(1)
        true = CASES[name](arguments.scale, rng)
        o = measure(true, C_EK_TRUE, Errors.draw(true, rng))
        del true
        estimator = Gls()
        start = time.process_time()
        estimate = estimator(o, model)
        seconds, peak = time.process_time() - start, 0
        if arguments.memory:
            tracemalloc.start()
            estimator(o, model)
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        held = sum(getattr(o, field).nbytes for field in PER_SIGHTING) + 16 * o.n
        error = np.abs(so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E)
        print(
            f"| {name} | {o.n_images} | {np.unique(o.landmark).size} | {o.n} | {seconds:.1f} | "
            f"{int(np.max(estimate.iterations))} | {held / 2**20:.0f} | {peak / 2**20:.0f} | "
            f"{' '.join(f'{e:.1f}' for e in error)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
