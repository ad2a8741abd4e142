"""The names found for detections, as tables: what became of each, and the observations they make."""

from __future__ import annotations

from collections.abc import Sequence

from ...identify.labelling import Label, Labels
from ...physics.errors import InputError
from ..campaign.read import LoadedCampaign
from ..text.write import Column, csv_text

LABEL_COLUMNS = ["image_id", "landmark_id", "column_px", "row_px", "sigma_px", "label"]
OBSERVATION_COLUMNS = LABEL_COLUMNS[:-1]


def label_columns(loaded: LoadedCampaign, labels: Labels) -> Sequence[Column]:
    """``labels.csv``: the detections in their order, with the landmark found (empty for none) and what became of it."""
    d, c = loaded.detections, loaded.campaign
    if d is None:
        raise InputError("the campaign has no detections to label")
    return [
        [c.images.ids[i] for i in d.image.tolist()],
        [c.landmarks.ids[i] if i >= 0 else "" for i in labels.landmark.tolist()],
        d.column_px + loaded.shift_px,
        d.row_px + loaded.shift_px,
        d.sigma_px,
        [Label(int(label)).name.lower() for label in labels.label],
    ]


def observation_columns(loaded: LoadedCampaign) -> Sequence[Column]:
    """``observations.csv`` of a labelled campaign, pixels as its user counts them."""
    c, s = loaded.campaign, loaded.campaign.sightings
    return [
        [c.images.ids[i] for i in s.image.tolist()],
        [c.landmarks.ids[i] for i in s.landmark.tolist()],
        s.column_px + loaded.shift_px,
        s.row_px + loaded.shift_px,
        s.sigma_px,
    ]


def label_files(loaded: LoadedCampaign, labels: Labels) -> dict[str, str]:
    """``labels.csv``: what each detection was matched with; ``observations.csv``: those that have a landmark."""
    return {
        "labels.csv": csv_text(LABEL_COLUMNS, label_columns(loaded, labels)),
        "observations.csv": csv_text(OBSERVATION_COLUMNS, observation_columns(loaded)),
    }
