"""What a command loads before it works: only what it needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from starplumb.cli.app import COMMANDS, asked, program
from starplumb.solve import probability

COMMAND = """
import sys
from starplumb.cli import main
sys.argv = ["starplumb", *{arguments!r}]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
"""
AFTER = """
loaded = set(sys.modules)
from starplumb.solve.probability import chdtrc
import scipy.special, scipy.stats
assert scipy.special.chdtrc is chdtrc
assert abs(scipy.stats.chi2.sf(3.0, 2) - chdtrc(2, 3.0)) < 1e-15
assert scipy.special._ufuncs is sys.modules["scipy.special._ufuncs"]
print(*loaded, file=sys.stderr)
"""


def run(code, folder):
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder
    )


@pytest.mark.slow
def test_a_small_campaign_needs_no_figures_no_readers_of_rasters_and_a_tenth_of_scipy(tmp_path):
    run(COMMAND.format(arguments=["init", "demo"]), tmp_path)
    done = run(COMMAND.format(arguments=["calibrate", "demo/campaign.toml", "--no-report"]) + AFTER, tmp_path)
    loaded = set(done.stderr.split())
    assert "starplumb.judge.calibrate" in loaded
    assert "scipy.special._ufuncs" in loaded
    heavy = {
        *("scipy.special", "scipy.linalg", "matplotlib", "jinja2", "pyarrow", "numba", "rasterio", "pyproj"),
        *("starplumb.estimators.sequential", "starplumb.io.gis.drivers", "starplumb.identify.labelling"),
        *("starplumb.solve.streaming", "starplumb.report.charts", "starplumb.cli.measure"),
    }
    assert not loaded & heavy


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (["calibrate", "--help"], {"calibrate"}),
        (["archive", "list"], {"archive"}),
        (["--help"], set(COMMANDS)),
        ([], set(COMMANDS)),
        (["calibrat"], set(COMMANDS)),
    ],
)
def test_one_command_is_described_where_one_is_named(arguments, wanted):
    assert set(asked(arguments)) == wanted


def test_a_program_has_the_commands_asked_for():
    only = program(["import"])
    assert [command.name for command in only.registered_commands] == ["import"]
    assert [group.name for group in program(["archive"]).registered_groups] == ["archive"]


def test_tails_are_those_of_distributions():
    """Two degrees of freedom: exp(-x / 2); Cauchy: tan(pi (p - 1/2)); Poisson: 1 - exp(-m) for one or more."""
    assert np.isclose(probability.chdtrc(2, 3.0), np.exp(-1.5), rtol=1e-14)
    assert np.isclose(probability.stdtrit(1, 0.8), np.tan(0.3 * np.pi), rtol=1e-12)
    assert np.isclose(probability.pdtrc(0, 0.3), 1.0 - np.exp(-0.3), rtol=1e-14)


def test_special_functions_come_without_the_rest_of_their_package():
    """``scipy.special`` as a whole takes a tenth of the time of a small command with its report."""
    sources = Path(probability.__file__).parents[1].rglob("*.py")
    named = {p.name for p in sources if "from scipy.special" in p.read_text(encoding="utf-8")}
    assert not named


def test_what_scipy_does_not_have_is_said():
    with pytest.raises(AttributeError, match="of_no_distribution"):
        probability.of_no_distribution  # noqa: B018


def test_a_scipy_that_keeps_its_functions_elsewhere_is_imported_whole(tmp_path):
    code = "import sys\nfrom starplumb.solve import probability\n"
    code += "probability._COMPILED = 'scipy.special._elsewhere'\n"
    code += "print(float(probability.chdtrc(2, 0.0)), 'scipy.special' in sys.modules)\n"
    assert run(code, tmp_path).stdout.split() == ["1.0", "True"]
