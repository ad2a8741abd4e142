"""What it costs to leave out UT1, the pole or the leap seconds.

The rotation from inertial to Earth-fixed axes is computed with all the tables say, and then with one of them
left out or misread. The angle between the two is an attitude error of every image. Those that are the same in
all images would be absorbed in the mounting, and be wrong for the next month's campaign.
"""

import erfa
import matplotlib.pyplot as plt
import numpy as np

from starplumb.physics import so3
from starplumb.physics.earth import OMEGA_EARTH
from starplumb.physics.orientation import EarthOrientation
from starplumb.physics.timescales import parse
from starplumb.physics.units import ARCSEC

days = np.arange(0, 365 * 9, 30)
t_ns = parse(["2016-01-02T00:00:00"], "UTC")[0] + days * 86_400_000_000_000
C_IJ = EarthOrientation.load().C_IJ(t_ns)


def without_tables(t_ns: np.ndarray) -> np.ndarray:
    """GCRF from ITRF with UT1 = UTC and the pole at zero, straight from ERFA."""
    tai1, tai2 = 2451545.0, t_ns * 1e-9 / 86400.0
    tt1, tt2 = erfa.taitt(tai1, tai2)
    utc1, utc2 = erfa.taiutc(tai1, tai2)
    C_JI = erfa.c2t06a(tt1, tt2, utc1, utc2, 0.0, 0.0)
    return np.swapaxes(C_JI, -1, -2)


cases = {
    "UT1 and pole left out": without_tables(t_ns),
    "GPS time read as UTC (18 s)": None,
    "TAI read as UTC (37 s)": None,
}
figure, axis = plt.subplots(figsize=(7, 3.8), layout="constrained")
for name, C in cases.items():
    seconds = 18.0 if "18" in name else 37.0
    turned = C if C is not None else EarthOrientation.load().C_IJ(t_ns + int(seconds * 1e9))
    angle = np.linalg.norm(so3.log(turned @ C_IJ.mT), axis=-1) / ARCSEC
    axis.semilogy(2016 + days / 365.25, angle, label=name)
    print(f"{name:30s} {angle.min():9.3f} .. {angle.max():9.3f} arcsec")
print(f"the Earth turns by {OMEGA_EARTH / ARCSEC:.3f} arcsec a second")
axis.set(ylabel="attitude error, arcsec", xlabel="year")
axis.legend(frameon=False)
figure.savefig("earth-orientation.svg")
