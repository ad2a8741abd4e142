"""The page of measured chips: what stands in it is what the document and the pictures say."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from starplumb.imagery.drawn.ground import Ground
from starplumb.imagery.pictures import Picture
from starplumb.report.cards import Ellipse, shades, signed
from starplumb.report.imagery.measurement import REFUSED, measurement_page

VERDICTS = ("used", "cloud", "outlier", "changed", "water", "used")


def candidate(image, number, verdict, rng):
    used = verdict == "used"
    values = {
        "residual_column_px": 0.02 * float(rng.normal()),
        "residual_row_px": 0.02 * float(rng.normal()),
        "normalised": rng.normal(size=2).tolist(),
    }
    sigmas = {"sigma_column_px": 0.012, "sigma_row_px": 0.02, "correlation": 0.31}
    return {
        "image_id": image,
        "landmark_id": f"{image}-{number:03d}",
        "column_px": float(rng.uniform(0, 1000)),
        "row_px": float(rng.uniform(0, 1000)),
        "predicted_column_px": 1.0,
        "predicted_row_px": 1.0,
        "verdict": verdict,
        "reason": "" if used else f"it is <{verdict}> & so on",
        "role": None if not used else "check" if number % 5 == 0 else "control",
        **(sigmas if used else dict.fromkeys(sigmas)),
        **dict.fromkeys(("peak", "second", "agreement", "kept", "gain", "blur_px"), 0.9 if used else None),
        **(values if used else dict.fromkeys(values)),
    }


def measured(rng, chips=12, images=("a<b>", "image02", "image03")):
    """A document of two images that were measured and one that was not."""
    each = [candidate(i, k, VERDICTS[k % 6], rng) for i in images[:2] for k in range(chips)]
    parts = [
        {
            "image_id": name,
            "status": "left out" if name == images[2] else "measured",
            "reason": "all of it is cloud" if name == images[2] else "",
            "size_px": [1024, 1024],
            "candidates": 0 if name == images[2] else chips,
            "used": 0 if name == images[2] else chips // 3,
            "check": 1,
            "offset_px": None if name == images[2] else [212.4, -93.1],
            "floor_px": 0.01,
            "windows": [4, 5],
        }
        for name in images
    ]
    head = {"schema": "starplumb-measure/1", "status": "ok", "message": "", "campaign": "first light"}
    return head | {
        "images": parts,
        "candidates": each,
        "floor_px": 0.01,
        "inputs": {},
        "software": {"starplumb": "0"},
    }


def pictures(document, rng):
    ground = Ground(3, 1.5)
    for k, c in enumerate(document["candidates"]):
        if c["verdict"] == "water":
            continue
        reference = ground.draw(130.0 * k + 2.8 * np.arange(48), 2.8 * np.arange(48)).astype(np.float32)
        window = (900 + 100 * reference + rng.normal(0, 20, (48, 48))).astype(np.float32)
        seen = Picture(c["image_id"], c["landmark_id"], reference, window)
        if c["verdict"] != "used":
            yield seen
            continue
        y, x = np.mgrid[-5:6, -5:6]
        surface = np.exp(-0.2 * ((x - 1) ** 2 + (y + 2) ** 2)).astype(np.float32)
        residual = rng.normal(0, 20, (48, 48)).astype(np.float32)
        weight = (np.arange(48) > 10) * np.ones((48, 1), dtype=np.float32)
        covariance = ((1.4e-4, 1e-4), (1e-4, 4e-4))
        yield Picture(
            c["image_id"],
            c["landmark_id"],
            reference,
            window,
            residual,
            weight,
            surface,
            (1.0, -2.0),
            covariance,
        )


class Structure(HTMLParser):
    """Elements that are opened and closed, headings, and where anything is loaded from."""

    def __init__(self, text):
        super().__init__()
        self.open, self.headings, self.sources, self.ids = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.sources += [found[name] for name in ("src", "xlink:href") if name in found]
        self.ids += [found["id"]] if "id" in found else []
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.sources += [dict(attrs)[name] for name in ("src",) if name in dict(attrs)]

    def handle_endtag(self, tag):
        assert self.open, f"{tag} is closed and was not open"
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("h2", "h3"):
            self.headings.append(data.strip())


@pytest.mark.slow
def test_the_page_shows_failures_first_and_loads_nothing(rng):
    document = measured(rng, 6)
    shown = list(pictures(document, rng))
    text = measurement_page(document, shown)
    found = Structure(text)
    assert found.open == []
    assert len(set(found.ids)) == len(found.ids)
    sections = [h for h in found.headings if h.partition(" (")[0].lower() in {*REFUSED, "used"}]
    assert sections == ["Outlier (2)", "Changed (2)", "Cloud (2)", "Water (2)", "Used (4)"]
    assert found.sources
    assert all(source.startswith("data:image/png;base64,") for source in found.sources)
    assert "img-src data:" in text
    assert "it is &lt;cloud&gt; &amp; so on" in text.replace("It is", "it is")
    assert "<cloud>" not in text
    assert "a&lt;b&gt;-000" in text
    assert "image03 is left out: all of it is cloud" in text
    assert text.count('class="panel blink"') == len(shown)
    used = [c for c in document["candidates"] if c["verdict"] == "used"]
    used.sort(key=lambda c: -np.hypot(*c["normalised"]))
    at = [text.index(c["landmark_id"].replace("<", "&lt;").replace(">", "&gt;") + " <span") for c in used]
    assert at == sorted(at), "the largest residual comes first"
    assert text == measurement_page(document, shown)


def test_a_document_in_which_nothing_was_found_has_a_page(rng):
    document = measured(rng) | {"candidates": [], "status": "failed", "message": "no image could be acquired"}
    text = measurement_page(document, [])
    assert "no image could be acquired" in text
    assert "<img" not in text
    assert "img-src" not in text


def opened(address):
    from PIL import Image

    kind, _, data = address.partition(",")
    assert kind == "data:image/png;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data)))).astype(int)


def test_greys_grow_with_the_values_and_gaps_are_clear():
    values = np.linspace(10.0, 20.0, 30 * 20).reshape(30, 20).astype(np.float32)
    values[4, 7] = np.nan
    seen = opened(shades(values))
    assert seen.shape == (30, 20, 4)
    grey = np.where(np.isfinite(values), seen[..., 0], -1).ravel()
    assert np.all(np.diff(grey[grey >= 0]) >= 0)
    assert (grey[grey >= 0].min(), grey.max()) == (0, 255)
    assert seen[4, 7, 3] == 0
    assert np.all(np.delete(seen[..., 3].ravel(), 4 * 20 + 7) == 255)


def test_differences_are_red_above_and_blue_below_and_fade_with_their_weight():
    values = np.array([[-4.0, 0.0, 4.0, 4.0]], dtype=np.float32)
    seen = opened(signed(values, np.array([[1.0, 1.0, 1.0, 0.5]], dtype=np.float32), full=4.0))[0]
    assert seen[0].tolist() == [33, 102, 172, 255]
    assert seen[1].tolist() == [255, 255, 255, 255]
    assert seen[2].tolist() == [178, 24, 43, 255]
    assert seen[3, 3] == 128


@pytest.mark.parametrize("angle", [0.0, 30.0, 120.0])
def test_an_ellipse_lies_along_its_larger_error(angle):
    """Turned by hand: a variance of 9 along the direction, 1 across."""
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    covariance = np.eye(2) + 8.0 * np.outer(along, along)
    found = Ellipse.enlarged(0.5, 0.5, covariance)
    assert found.half[0] / found.half[1] == pytest.approx(3.0)
    assert np.cos(2.0 * np.radians(found.angle - angle)) == pytest.approx(1.0)


def test_a_flat_picture_is_a_picture():
    flat = opened(shades(np.full((4, 5), 7.0, dtype=np.float32)))
    assert flat.shape == (4, 5, 4)
    assert re.match("data:", signed(np.zeros((3, 3), dtype=np.float32)))


def test_what_has_no_picture_is_told_in_words(rng):
    document = measured(rng, 5)
    text = measurement_page(document, list(pictures(document, rng)))
    assert "0 of 2 are shown." in text
    assert "image02-004: It is &lt;water&gt; &amp; so on." in text


def test_a_target_that_was_not_fitted_shows_no_reference(rng):
    document = measured(rng, 1)
    shown = [replace(picture, reference=None) for picture in pictures(document, rng)]
    text = measurement_page(document, shown)
    assert "the reference as it was predicted" not in text
    assert all(shades(picture.window) in text for picture in shown)


def test_a_landmark_of_several_images_has_a_picture_of_each(rng):
    document = measured(rng, 1)
    first, second = document["candidates"]
    assert first["image_id"] != second["image_id"]
    second["landmark_id"] = first["landmark_id"] = "tower"
    shown = list(pictures(document, rng))
    text = measurement_page(document, shown)
    for picture in shown:
        assert shades(picture.window) in text
    assert "tower in image02" in text
