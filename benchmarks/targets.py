"""Places of lights, discs and crosses: errors over stated sigmas, by strength, form and what is known of the noise.

    python benchmarks/targets.py [IMAGES]

Each image holds 144 targets at random parts of a pixel, with read noise of 4 DN, 0.1 DN an electron and a background
of 200 DN; the signal-to-noise ratio is that of the brightest pixel.  Forms are drawn by the same sum over their area
as they are fitted by, whose error is bounded in ``tests/imagery/test_targets.py``.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from starplumb.imagery.targets.fit import Noise
from starplumb.imagery.targets.measuring import Sought, targets_of
from starplumb.imagery.targets.profile import picture
from starplumb.imagery.targets.shape import Shape

READ, GAIN, DARK, WIDTH, SIDE = 4.0, 0.1, 200.0, 0.6, 12
FORMS = {"light": Shape.light(), "disc, 5 px": Shape.disc(5.0), "cross, 7 x 1.5 px": Shape.cross(7.0, 1.5)}
RATIOS = (5.0, 10.0, 20.0, 50.0, 200.0)


@dataclass(frozen=True)
class Image:
    values: np.ndarray

    @property
    def size_px(self) -> tuple[int, int]:
        return self.values.shape[1], self.values.shape[0]

    def window(self, column: int, row: int, columns: int, rows: int) -> np.ndarray:
        cut = np.full((rows, columns), np.nan)
        h, w = self.values.shape
        i, j = slice(max(row, 0), min(row + rows, h)), slice(max(column, 0), min(column + columns, w))
        if i.stop > i.start and j.stop > j.start:
            cut[i.start - row : i.stop - row, j.start - column : j.stop - column] = self.values[i, j]
        return cut


def drawn(rng: np.random.Generator, form: Shape, ratio: float) -> tuple[Image, np.ndarray]:
    """An image and the places of its targets (n, 2)."""
    at = np.linspace(30.0, 30.0 + 44.0 * (SIDE - 1), SIDE)
    true = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2) + rng.uniform(-0.5, 0.5, (SIDE * SIDE, 2))
    size = int(at[-1]) + 31
    seen = np.full((size, size), DARK)
    for place in true:
        first = np.rint(place).astype(int) - 12
        light, _ = picture(place - first, form.place_m, form.part, WIDTH, 25)
        strength = ratio * np.sqrt(READ**2 + GAIN * DARK) / light.max()
        seen[first[1] : first[1] + 25, first[0] : first[0] + 25] += strength * light
    return Image(np.rint(seen + rng.normal(size=seen.shape) * np.sqrt(READ**2 + GAIN * seen))), true


def row(name: str, ratio: float, stated: bool, images: int) -> str:
    form, errors, z, count, start = FORMS[name], [], [], 0, time.process_time()
    noise = Noise(READ**2 + 1.0 / 12.0, GAIN) if stated else None
    for seed in range(images):
        image, true = drawn(np.random.default_rng([seed, int(ratio)]), form, ratio)
        found = [t for t in targets_of(image, Sought(form, np.eye(2), noise, True))[0] if not t.why]
        count += len(true)
        for target in found:
            off = target.pixel - true
            k = int(np.argmin(np.linalg.norm(off, axis=-1)))
            if np.linalg.norm(off[k]) < 2.0:
                errors.append(off[k])
                z.append(np.linalg.solve(np.linalg.cholesky(target.fit.covariance_px2), off[k]))
    rms, over = (float(np.sqrt(np.mean(np.square(values)))) for values in (errors, z))
    cost = 1e3 * (time.process_time() - start) / count
    known = "stated" if stated else "told by the images"
    return (
        f"| {name} | {ratio:.0f} | {known} | {rms:.4f} | {over:.2f} | {np.abs(z).max():.1f} | "
        f"{100.0 * (1.0 - len(errors) / count):.0f} % | {cost:.1f} |"
    )


def main() -> None:
    images = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    print("| form | SNR | noise | error (px) | error/sigma | largest | refused | CPU ms |")
    print("|---|---|---|---|---|---|---|---|")
    for name in FORMS:
        for ratio in RATIOS:
            for stated in (True, False):
                print(row(name, ratio, stated, images), flush=True)


if __name__ == "__main__":
    main()
