"""The whole chain from files to the mounting against a simulator written apart from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from independent import ARCSEC, Case, write
from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.judge.calibrate import calibrate

CASES = [
    Case(),
    Case(direction="from tracker", scale="GPS", origin="corner"),
    Case(aberration=False, scale="TAI"),
    Case("line-scan", line_offset_px=60.0),
    Case("line-scan", direction="from tracker", scale="TT", origin="corner", line_offset_px=-30.0),
]


@pytest.mark.parametrize(
    "case", CASES, ids=lambda case: f"{case.model}, {case.direction}, {case.scale}, {case.origin}"
)
def test_files_without_errors_give_the_true_mounting(
    case: Case, tmp_path: Path, rng: np.random.Generator
) -> None:
    C_EK_true = write(tmp_path, case, rng)
    done = calibrate(load_campaign(tmp_path / "campaign.toml").campaign, Gls())
    error = Rotation.from_matrix(done.estimate.C_EK @ C_EK_true.T).as_rotvec() / ARCSEC
    # left over: dX, dY of the pole (0.0003 arcsec) and epochs of the files to the microsecond (8 mm)
    assert np.max(np.abs(error)) < 2e-3
    assert np.max(np.abs(done.residuals.after_px)) < 5e-3
    # a correction d is applied as C_EK = exp(d) C_EK_model
    model = Rotation.from_rotvec([0.01, -0.004, 0.006]).as_matrix()
    np.testing.assert_allclose(done.correction_E, -Rotation.from_matrix(model).as_rotvec(), atol=2e-8)


@pytest.mark.parametrize("model", ["frame", "line-scan"])
def test_the_wrong_aberration_switch_is_seen_in_turned_views(
    model: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    write(tmp_path, Case(model), rng)
    file = tmp_path / "campaign.toml"
    text = file.read_text()
    file.write_text(
        text.replace("aberration = true", "aberration = false").replace("[5.0, 5.0, 12.0]", "[1.0, 1.0, 2.0]")
    )
    done = calibrate(load_campaign(file).campaign, Gls())
    assert any(
        "aberration = false looks wrong: aberration = true explains" in said for said in done.sentences
    )
