"""How large light time, aberration and refraction are on the ground.

A marker is seen from 680 km by a camera that looks ahead, along its track, at growing angles off nadir. Each
light effect is switched on alone, and the change of the apparent direction is drawn as an angle and as a
length on the ground across the line of sight.
"""

import matplotlib.pyplot as plt
import numpy as np
from _scene import EARTH, EPOCH_NS, ORBIT

from starplumb.physics.earth import intersect_ellipsoid
from starplumb.physics.light import Corrections, apparent_direction
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene

off_nadir = np.linspace(0.0, 45.0, 10) * DEG
r_J, v_J = scene.fly(ORBIT, EARTH, EPOCH_NS, 0.0)
down = -r_J / np.linalg.norm(r_J)
ahead = v_J - down * (down @ v_J)
ahead = ahead / np.linalg.norm(ahead)
p_J = intersect_ellipsoid(r_J, np.cos(off_nadir)[:, None] * down + np.sin(off_nadir)[:, None] * ahead)

straight, distance = apparent_direction(p_J, r_J, v_J, Corrections(False, False, False))
figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
print("                     nadir     20 deg     40 deg off nadir")
for name, switches in (
    ("light time", Corrections(True, False, False)),
    ("aberration", Corrections(False, True, False)),
    ("refraction", Corrections(False, False, True)),
):
    seen, _ = apparent_direction(p_J, r_J, v_J, switches)
    angle = np.linalg.norm(seen - straight, axis=-1)
    at = np.interp(np.array([0.0, 20.0, 40.0]) * DEG, off_nadir, angle) / ARCSEC
    print(f'{name:12s} {at[0]:9.3f}" {at[1]:9.3f}" {at[2]:9.3f}"')
    axes[0].semilogy(off_nadir / DEG, np.maximum(angle / ARCSEC, 1e-3), label=name)
    axes[1].semilogy(off_nadir / DEG, np.maximum(angle * distance, 1e-2), label=name)
for axis, unit in zip(axes, ("arcsec", "m"), strict=True):
    axis.set(xlabel="off nadir, deg", ylabel=unit)
axes[0].legend(frameon=False)
figure.savefig("light-effects.svg")
