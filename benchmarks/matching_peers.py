"""The chips of `matching.py` by other programs: accuracy, refusals, gross errors and time in one run.

    python -m venv peers && peers/bin/pip install -e . opencv-python-headless scikit-image
    OPENBLAS_NUM_THREADS=1 peers/bin/python benchmarks/matching_peers.py [TRIALS] [SEED] [CONDITION ...]

NCC (OpenCV `matchTemplate`) with a parabola at its peak; phase correlation (scikit-image, a hundredth of a pixel); ECC
(OpenCV, affine, from the peak of NCC); SIFT (OpenCV, affine by RANSAC).  Each gets the reference as it was predicted,
at a pixel's spacing, up to half a pixel off.  They state no sigma; refused is what they give no answer for, or a
correlation below 0.5, or fewer than four features that agree.
"""

from __future__ import annotations

import sys
import time

import cv2
import numpy as np
from matching import CHIP, CONDITIONS, chip
from skimage.registration import phase_cross_correlation

from starplumb.imagery.chips import looked_for, matched
from starplumb.imagery.matching.orientation import RIM_PX

SEARCH = 6
LEAST = 0.5
"""Correlation below which an answer is refused."""


def around(drawn, spare):
    """The reference every pixel, as far as the window and so much more, about the same middle."""
    samples = drawn.piece.samples[::2, ::2]
    middle, half = samples.shape[0] // 2, CHIP // 2 + spare
    return samples[middle - half : middle + half, middle - half : middle + half]


def inside(drawn):
    return drawn.window[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]


def away(drawn, shift):
    """Error (2,) of where the reference's middle lies, if pixel u of the window shows its sample u + shift."""
    return -np.asarray(shift) - drawn.away


def bytes_of(*images):
    """Grey values of images, alike stretched."""
    low, high = np.quantile(images[0], (0.005, 0.995))
    return [np.uint8(np.clip(255.0 * (image - low) / (high - low + 1e-9), 0.0, 255.0)) for image in images]


def vertex(values, k):
    if not 0 < k < len(values) - 1:
        return 0.0
    a, b, c = values[k - 1 : k + 2]
    return 0.5 * (a - c) / (a - 2.0 * b + c) if a - 2.0 * b + c < 0.0 else 0.0


def ncc(drawn):
    surface = cv2.matchTemplate(
        np.float32(around(drawn, SEARCH)), np.float32(inside(drawn)), cv2.TM_CCOEFF_NORMED
    )
    i, j = np.unravel_index(int(np.argmax(surface)), surface.shape)
    if surface[i, j] < LEAST:
        return None
    return np.array([j + vertex(surface[i], j), i + vertex(surface[:, j], i)]) - SEARCH


def phase(drawn):
    shift, _, _ = phase_cross_correlation(around(drawn, 0), inside(drawn), upsample_factor=100)
    return shift[::-1]


def ecc(drawn):
    start = ncc(drawn)
    warp = np.eye(2, 3, dtype=np.float32)
    warp[:, 2] = SEARCH + (0.0 if start is None else start)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-5)
    try:
        found, warp = cv2.findTransformECC(
            np.float32(inside(drawn)), np.float32(around(drawn, SEARCH)), warp, cv2.MOTION_AFFINE, stop
        )
    except cv2.error:
        return None
    middle = 0.5 * (CHIP - 1.0)
    return None if found < LEAST else warp @ np.array([middle, middle, 1.0]) - middle - SEARCH


def sift(drawn):
    maker = cv2.SIFT_create(contrastThreshold=0.01)
    seen, there = bytes_of(inside(drawn), around(drawn, SEARCH))
    (one, a), (other, b) = maker.detectAndCompute(seen, None), maker.detectAndCompute(there, None)
    if a is None or b is None or len(b) < 2:
        return None
    pairs = [m for m, n in cv2.BFMatcher().knnMatch(a, b, k=2) if m.distance < 0.8 * n.distance]
    if len(pairs) < 4:
        return None
    of, to = (
        np.float32([k[i].pt for i in at])
        for k, at in ((one, [m.queryIdx for m in pairs]), (other, [m.trainIdx for m in pairs]))
    )
    warp, agree = cv2.estimateAffine2D(of, to, ransacReprojThreshold=1.0)
    middle = 0.5 * (CHIP - 1.0)
    if warp is None or agree.sum() < 4:
        return None
    return warp @ np.array([middle, middle, 1.0]) - middle - SEARCH


def ours(drawn):
    """The error itself, which is told at the place that is known best."""
    peak, _ = looked_for(drawn.piece, drawn.window)
    found, refused = matched(drawn.piece, drawn.window, peak)
    return None if refused is not None else drawn.error(found)


def by(method):
    def error(drawn):
        shift = method(drawn)
        return None if shift is None else away(drawn, shift)

    return error


METHODS = {
    "starplumb": ours,
    "NCC": by(ncc),
    "phase correlation": by(phase),
    "ECC": by(ecc),
    "SIFT": by(sift),
}


def rows(name, trials, rng):
    drawn = [chip(rng, CONDITIONS[name]) for _ in range(trials)]
    for method, error in METHODS.items():
        began = time.process_time()
        found = [error(each) for each in drawn]
        spent = 1e3 * (time.process_time() - began) / trials
        e = np.array([x for x in found if x is not None]).reshape(-1, 2)
        robust = 1.4826 * np.median(np.abs(e)) if len(e) else np.nan
        gross = int(np.sum(np.abs(e).max(axis=1, initial=0.0) > 1.0))
        refused = 100.0 * (1.0 - len(e) / trials)
        print(f"| {name} | {method} | {robust:.3f} | {refused:.0f} % | {gross} | {spent:.0f} |", flush=True)


if __name__ == "__main__":
    trials, seed = (int(a) for a in (*sys.argv[1:3], *("40", "3")[len(sys.argv[1:3]) :]))
    print("| | | error px | refused | off by over 1 px | CPU ms |")
    print("|---|---|---|---|---|---|")
    for k, name in enumerate(CONDITIONS):
        if name in sys.argv[3:] or not sys.argv[3:]:
            rows(name, trials, np.random.default_rng([seed, k]))
