"""Every page that commands write, in a browser: nothing is wider than the screen, no text lies on another, and every
figure has its words.  Structure is compared, not pixels."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import pytest

import starplumb as sp
from command import starplumb
from rigs import FORE, rig_truth
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.report.imagery.measurement import measurement_page
from starplumb.report.page import Page, Section, Table, render
from starplumb.report.pdf import BROWSERS
from starplumb.session.campaign import Campaign
from test_cameras import delivered
from test_measurement_page import measured, pictures

BROWSER = next((path for name in BROWSERS if (path := shutil.which(name))), None)
WIDTHS = (390, 1280)
SECONDS = 300
"""A browser that has not looked by then hangs, however busy the machine."""

PAGES = {
    *(
        "budget/report.html",
        "cameras.html",
        "fleet/fleet.html",
        "measure.html",
        "plan/plan.html",
        "report.html",
    ),
    *("simulation/report.html", "trend/trend.html"),
}
WRONG = (
    '<!doctype html><meta name="viewport" content="width=device-width"><div style="width:1500px">wide</div>'
    '<figure><svg width="100" height="50"><text x="5" y="20">first words</text>'
    '<text x="9" y="22">words upon it</text></svg></figure>'
)
LOOK = (Path(__file__).parent / "look.js").read_text(encoding="utf-8")


def write_pages(folder: Path, rng) -> None:
    """One of each kind, as small as shows all of its sections."""
    campaign = sp.demo()
    rig = Campaign(load_campaign(write_campaign(folder / "rig", delivered(rig_truth((FORE,)), rng))), "rig")
    texts = {
        "report": sp.calibrate(campaign, estimate=["focal_length"]).report(),
        "cameras": sp.calibrate(rig).report(),
    }
    scenario = sp.scenario("two-images")
    sp.budget(scenario, "gls,wahba", target_arcsec=5.0).save(folder / "budget")
    sp.simulate(scenario, 40, methods="gls,wahba").save(folder / "simulation")
    sp.plan_images(sp.scenario("cubesat-6u"), 3).save(folder / "plan")
    document = measured(rng)
    texts["measure"] = measurement_page(document, pictures(document, rng))
    archive = folder / "mission.db"
    for seed in (1, 2):
        assert starplumb("init", folder / f"demo{seed}", "--seed", seed).status == 0
    campaigns = [folder / f"demo{seed}" / "campaign.toml" for seed in (1, 2)]
    options = ("--jobs", 1, "--archive", archive, "--out", folder / "fleet")
    assert starplumb("calibrate", *campaigns, *options).status == 0
    assert (
        starplumb("archive", "trend", archive, "--satellite", "demo1", "--out", folder / "trend").status == 0
    )
    for name, text in texts.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")


def seen(folder: Path) -> list[dict]:
    """What a browser sees of the pages of a folder at each width, all in one start."""
    pages = sorted(folder.rglob("*.html"))
    frames = "".join(
        f'<iframe data-page="{page.relative_to(folder)}" data-width="{width}" src="{page.as_uri()}" '
        f'style="border:0;width:{width}px;height:900px"></iframe>'
        for page in pages
        for width in WIDTHS
    )
    (folder / "look.htm").write_text(
        f"<!doctype html><body>{frames}<script>{LOOK}</script>", encoding="utf-8"
    )
    command = [
        str(BROWSER),
        "--headless",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
    ]
    command += ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    command += ["--allow-file-access-from-files", f"--user-data-dir={folder / 'profile'}", "--dump-dom"]
    done = subprocess.run(
        [*command, (folder / "look.htm").as_uri()],
        capture_output=True,
        text=True,
        timeout=SECONDS,
        check=True,
    )
    return json.loads(unescape(done.stdout.split('<pre id="found">')[1].split("</pre>")[0]))


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no browser to look with")
def test_no_page_is_wider_than_its_screen_and_every_figure_has_words(tmp_path: Path, rng) -> None:
    write_pages(tmp_path, rng)
    (tmp_path / "wrong.html").write_text(WRONG, encoding="utf-8")
    *right, wrong, other = seen(tmp_path)
    assert {found["page"] for found in right} == PAGES
    assert [found for found in right if found["scroll"] > 0 or found["wide"]] == []
    assert [(found["page"], found["silent"]) for found in right if found["silent"]] == []
    assert [(found["page"], found["crossing"]) for found in right if found["crossing"]] == []
    assert all(found["figures"] for found in right if found["page"] != "fleet/fleet.html")
    tried = {found["page"]: found["tried"] for found in right if found["tried"]}
    assert set(tried) >= {"report.html", "cameras.html", "budget/report.html", "trend/trend.html"}
    for page, found in tried.items():
        assert found["told"] == found["wanted"] != "", page
        assert found["share"] == pytest.approx(0.8)
        assert (found["after"], found["back"], found["open"]) == (1, True, False)
    for found in (wrong, other):  # what is looked for is seen
        assert found["page"] == "wrong.html"
        assert found["scroll"] > 0
        assert len(found["wide"]) == len(found["silent"]) == len(found["crossing"]) == 1


def test_pages_fit_a_telephone_by_their_own_words() -> None:
    """Without a browser: the page says that its width is the screen's, and what may be wide scrolls by itself."""
    from starplumb.report.budget import budget_page

    page = budget_page(sp.budget(sp.scenario("two-images")).document)
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert page.count("<table") == page.count('<div class="scroll"') > 0


def test_cells_have_signs_and_times_that_do_not_break():
    """A minus before a number; none in a name, a date or an exponent; a time stays on its line on a phone."""
    row = ("2026-03-25T09:59:47", "site-1", "-20.0", "-301.8 ± 2.4", "1e-05", "-0.5 to -0.1")
    table = Table("c", ("a",) * len(row), [row], text_columns=2)
    text = render(Page("t", "s", "b", "good", (Section("x", "X", tables=(table,)),)))
    cells = re.findall(r"<t[dh](?: scope=\"row\")?(?: class=\"([^\"]*)\")?>([^<]*)</t[dh]>", text)
    assert cells == [
        ("time", "2026-03-25T09:59:47"),
        ("text", "site-1"),
        ("", "−20.0"),
        ("", "−301.8 ± 2.4"),
        ("", "1e-05"),
        ("", "−0.5 to −0.1"),
    ]
