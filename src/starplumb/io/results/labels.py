"""The names found for detections, as tables: what became of each, and the observations they make."""

from __future__ import annotations

from collections.abc import Sequence

from ...identify.labelling import Label, Labels
from ...physics.errors import InputError
from ..campaign.marks.markers import noise_columns
from ..campaign.read import LoadedCampaign
from ..text.write import Column, csv_text


def label_columns(loaded: LoadedCampaign, labels: Labels) -> tuple[Sequence[str], Sequence[Column]]:
    """``labels.csv``: the detections in their order, with the landmark found (empty for none) and what became of it."""
    d, c = loaded.detections, loaded.campaign
    if d is None:
        raise InputError("the campaign has no detections to label")
    sigma, noise = noise_columns(d)
    return ["image_id", "landmark_id", "column_px", "row_px", *sigma, "label"], [
        [c.images.ids[i] for i in d.image.tolist()],
        [c.landmarks.ids[i] if i >= 0 else "" for i in labels.landmark.tolist()],
        d.column_px + loaded.shift_px,
        d.row_px + loaded.shift_px,
        *noise,
        [Label(int(label)).name.lower() for label in labels.label],
    ]


def observation_columns(loaded: LoadedCampaign) -> tuple[Sequence[str], Sequence[Column]]:
    """``observations.csv`` of a labelled campaign, pixels as its user counts them."""
    c, s = loaded.campaign, loaded.campaign.sightings
    sigma, noise = noise_columns(s)
    return ["image_id", "landmark_id", "column_px", "row_px", *sigma], [
        [c.images.ids[i] for i in s.image.tolist()],
        [c.landmarks.ids[i] for i in s.landmark.tolist()],
        s.column_px + loaded.shift_px,
        s.row_px + loaded.shift_px,
        *noise,
    ]


def label_files(loaded: LoadedCampaign, labels: Labels) -> dict[str, str]:
    """``labels.csv``: what each detection was matched with; ``observations.csv``: those that have a landmark."""
    return {
        "labels.csv": csv_text(*label_columns(loaded, labels)),
        "observations.csv": csv_text(*observation_columns(loaded)),
    }
