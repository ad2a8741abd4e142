"""``measure.json`` of what was measured."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...imagery.chain import MeasuredImage
from ...imagery.scene import Scene
from ...imagery.targets.chain import TargetScene
from ...imagery.verdicts import Candidate, Verdict
from ...io.campaign.read import LoadedImages
from ...table.geometry import project
from ..from_calibration import software
from .measure import MeasureDocument

Array = NDArray[np.float64]


class Measured(Protocol):
    """What a document is made of."""

    @property
    def loaded(self) -> LoadedImages: ...

    @property
    def scene(self) -> Scene | TargetScene: ...

    @property
    def images(self) -> tuple[MeasuredImage, ...]: ...

    @property
    def usable(self) -> bool: ...

    @property
    def message(self) -> str: ...

    @property
    def floor_px(self) -> float: ...

    @property
    def reference_px2(self) -> tuple[float, ...]: ...


def measure_document(measured: Measured) -> dict[str, Any]:
    """The document, checked against its model."""
    each = [(image, _predicted(measured.loaded, image)) for image in measured.images]
    rows = zip(each, measured.reference_px2, strict=True)
    document = {
        "schema": MeasureDocument.kind(),
        "status": "ok" if measured.usable else "failed",
        "message": measured.message,
        "campaign": measured.loaded.campaign.name,
        "images": [_image(measured, image, predicted) for image, predicted in each],
        "candidates": [row for (i, at), own in rows for row in _candidates(measured, i, at, own)],
        "floor_px": measured.floor_px,
        "inputs": measured.loaded.inputs,
        "software": software(),
    }
    return MeasureDocument.of(document).to_dict()


def _predicted(loaded: LoadedImages, image: MeasuredImage) -> Array:
    """Pixels (n, 2) at which the ground of an image's chips lies by the model mounting; NaN where it is unknown."""
    p_J = [np.full(3, np.nan) if c.candidate.p_J is None else c.candidate.p_J for c in image.chips]
    at, campaign = np.array(p_J).reshape(-1, 3), loaded.campaign
    pixel = np.full((len(at), 2), np.nan)
    known = np.flatnonzero(np.isfinite(at).all(axis=-1))
    if known.size:
        start = np.array([image.chips[k].candidate.pixel for k in known])
        index = np.full(known.size, image.image)
        pixel[known] = project(campaign, campaign.C_EK, index, at[known], start)
    return pixel


def _image(measured: Measured, image: MeasuredImage, predicted: Array) -> dict[str, Any]:
    chips = [chip.candidate for chip in image.chips]
    used = [k for k, c in enumerate(chips) if c.verdict == Verdict.USED]
    off = None
    known = [k for k in used if np.all(np.isfinite(predicted[k]))]
    if known and not image.reason:
        apart = np.array([chips[k].pixel for k in known]) - predicted[known]
        off = np.median(apart, axis=0).tolist()
    return {
        "image_id": measured.loaded.campaign.images.ids[image.image],
        "status": "left out" if image.reason else "measured",
        "reason": image.reason,
        "size_px": list(measured.scene.raws[image.image].size_px),
        "candidates": len(chips),
        "used": len(used),
        "check": sum(chips[k].check for k in used),
        "offset_px": off,
        "floor_px": None if image.reason else float(image.floor_px),
        "windows": [image.found.agree, image.found.tried],
    }


def _candidates(
    measured: Measured, image: MeasuredImage, predicted: Array, own_px2: float
) -> list[dict[str, Any]]:
    name = measured.loaded.campaign.images.ids[image.image]
    shift = measured.loaded.shift_px
    beyond = measured.floor_px**2 + own_px2
    rows = []
    for chip, expected in zip(image.chips, predicted, strict=True):
        c = chip.candidate
        used = c.verdict == Verdict.USED and not image.reason
        at = expected if np.all(np.isfinite(expected)) else c.place
        rows.append(
            {
                "image_id": name,
                "landmark_id": c.landmark_id(name),
                "column_px": float(c.pixel[0] + shift),
                "row_px": float(c.pixel[1] + shift),
                "predicted_column_px": float(at[0] + shift),
                "predicted_row_px": float(at[1] + shift),
                "verdict": str(c.verdict),
                "reason": c.reason,
                "role": ("check" if c.check else "control") if used else None,
                **_ellipse(c, measured.floor_px if used else None),
                **{key: _number(getattr(c, key)) for key in _FIGURES},
                **_residual(c, beyond),
            }
        )
    return rows


_FIGURES = ("peak", "second", "agreement", "kept", "gain", "blur_px")


def _ellipse(c: Candidate, floor_px: float | None) -> dict[str, Any]:
    if floor_px is None:
        return dict.fromkeys(("sigma_column_px", "sigma_row_px", "correlation"))
    covariance = c.covariance + floor_px**2 * np.eye(2)
    column, row = np.sqrt(np.diagonal(covariance)).tolist()
    correlation = float(covariance[0, 1]) / (column * row)
    return {"sigma_column_px": column, "sigma_row_px": row, "correlation": correlation}


def _residual(c: Candidate, beyond_px2: float) -> dict[str, Any]:
    """What the image's rotation leaves, and that over its sigma, of which ``beyond_px2`` is not the matching's."""
    if c.residual_px is None or c.covariance_px2 is None:
        return dict.fromkeys(("residual_column_px", "residual_row_px", "normalised"))
    whitened = np.linalg.solve(np.linalg.cholesky(c.covariance_px2 + beyond_px2 * np.eye(2)), c.residual_px)
    column, row = c.residual_px.tolist()
    return {"residual_column_px": column, "residual_row_px": row, "normalised": whitened.tolist()}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
