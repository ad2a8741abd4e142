"""Names of columns that several tables share."""

from __future__ import annotations

GEODETIC = ("latitude_deg", "longitude_deg", "height_m")
CARTESIAN = ("x_m", "y_m", "z_m")
SIGMA_PX = ("sigma_column_px", "sigma_row_px", "correlation")
"""What may stand in place of sigma_px."""
SIGMA_ENU = ("sigma_east_m", "sigma_north_m", "sigma_up_m")
