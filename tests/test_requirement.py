"""Whether a calibration meets what is required, and the report as PDF."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from command import demo, starplumb
from starplumb.documents.result import ResultDocument
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.judge.accuracy.requirement import met, requirement
from starplumb.judge.calibrate import calibrate
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.plan import demo as drawn
from starplumb.report import pdf


@pytest.fixture(scope="module")
def done():
    """Check points with east errors of 1 ... 8 m and no north: rms sqrt(25.5) = 5.0498, CE90 7.3 m."""
    found = calibrate(drawn.demo("frame", 4, 7)[0], Gls())
    east = found.residuals.after_m.copy()
    check = found.campaign.sightings.check
    east[check] = np.stack([np.arange(1.0, 9.0), np.zeros(8)], axis=-1)
    return replace(found, residuals=replace(found.residuals, after_m=east))


@pytest.mark.parametrize(
    ("text", "limit", "unit", "measure"),
    [
        ("5 m CE90", 5.0, "m", "CE90"),
        (" 2.5m  rmse ", 2.5, "m", "rms"),
        ("0.01 km rms", 0.01, "km", "rms"),
        ("2 arcsec", 2.0, "arcsec", "interval"),
    ],
)
def test_a_requirement_is_read_from_its_words(text, limit, unit, measure):
    found = requirement(text)
    assert (found.limit, found.unit, found.measure) == (limit, unit, measure)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5",
        "5 m",
        "-5 m CE90",
        "0 m rms",
        "5 ft CE90",
        "2 arcsec CE90",
        "five m rms",
        "1e3 m rms",
        "٥ m CE90",
        "9" * 400 + " m rms",
    ],
)
def test_what_is_no_requirement_is_refused(text):
    with pytest.raises(InputError, match=r"requirement: found .*, wanted a limit such as '5 m CE90'"):
        requirement(text)


@pytest.mark.parametrize(
    ("text", "found", "is_met"),
    [
        ("7.4 m CE90", 7.3, True),
        ("7.2 m CE90", 7.3, False),
        ("5.1 m rms", 5.04975, True),
        ("0.005 km rms", 0.00504975, False),
    ],
)
def test_check_points_decide(done, text, found, is_met):
    answer = met(done, requirement(text))
    assert answer.found == pytest.approx(found, rel=1e-5)
    assert answer.met is is_met
    assert answer.of == "of 8 check points"
    assert ("NOT met" in answer.sentence) is not is_met


def test_control_points_are_named_where_there_are_no_others(done):
    s = done.campaign.sightings
    alone = replace(done, campaign=replace(done.campaign, sightings=replace(s, check=np.zeros_like(s.check))))
    answer = met(alone, requirement("1 km CE90"))
    assert answer.met
    assert "of 40 control points, which the solution has fitted" in answer.sentence


def test_an_angle_is_held_against_the_widest_interval(done):
    wide = replace(done, interval_95_E=np.array([1.0, 4.0, 2.0]) * ARCSEC)
    assert met(wide, requirement("4.1 arcsec")).met is True
    assert met(wide, requirement("3.9 arcsec")).met is False
    assert met(replace(done, interval_95_E=None), requirement("3 arcsec")).met is None


def test_of_an_answer_that_must_not_be_used_nothing_is_said(done):
    answer = met(replace(done, status=Status.REFUTED), requirement("1 km CE90"))
    assert answer.met is None
    assert "it cannot be said" in answer.sentence


@pytest.mark.slow
def test_the_command_says_it_everywhere(tmp_path):
    path = demo(tmp_path)
    spoken = starplumb("calibrate", path, "--requirement", "1 m CE90")
    assert spoken.status == 0
    assert "requirement 1 m CE90: NOT met" in spoken.out
    assert "requirement 1 m CE90: NOT met" in (path.parent / "result" / "report.html").read_text(
        encoding="utf-8"
    )
    text = (path.parent / "result" / "result.json").read_text(encoding="utf-8")
    found = ResultDocument.model_validate_json(text).requirement
    assert found.met is False
    assert found.found > found.limit == 1.0
    assert starplumb("calibrate", path, "--requirement", "good").status == 2


def test_without_a_printer_it_is_said_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(pdf, "_browser", lambda: None)
    monkeypatch.setattr(pdf, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="--pdf: found neither WeasyPrint nor a browser"):
        pdf.require_printer()


@pytest.mark.parametrize("prints", [True, False])
def test_a_browser_prints_the_page_or_it_is_said(tmp_path, monkeypatch, prints):
    """A browser of ten lines, which copies the page where it is told to print."""
    browser = tmp_path / "chromium"
    work = 'for a in "$@"; do case $a in --print-to-pdf=*) to=${a#*=};; file://*) from=${a#file://};; esac; done; '
    browser.write_text(f"#!/bin/sh\n{work}{'cp $from $to' if prints else 'exit 1'}\n", encoding="utf-8")
    browser.chmod(0o755)
    monkeypatch.setattr(pdf, "_browser", lambda: str(browser))
    monkeypatch.setattr(pdf, "find_spec", lambda name: None)
    if prints:
        pdf.write_pdf("<p>é</p>", tmp_path / "out.pdf")
        assert (tmp_path / "out.pdf").read_text(encoding="utf-8") == "<p>é</p>"
        return
    with pytest.raises(InputError, match="printed nothing"):
        pdf.write_pdf("<p>é</p>", tmp_path / "out.pdf")
    assert not (tmp_path / "out.pdf").exists()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium here")
def test_a_real_browser_prints_pages(tmp_path):
    pdf.write_pdf("<!DOCTYPE html><title>t</title><p>one</p>", tmp_path / "out.pdf")
    assert (tmp_path / "out.pdf").read_bytes().startswith(b"%PDF-")
