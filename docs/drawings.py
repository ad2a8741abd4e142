"""The drawings of the conventions page; ``python docs/drawings.py FOLDER`` writes them."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from starplumb.physics import so3
from starplumb.physics.units import DEG

mpl.rcParams.update({"svg.hashsalt": "starplumb", "font.size": 12, "savefig.facecolor": "none"})

RED, GREEN, BLUE, GREY = "#c0392b", "#1e8449", "#2456a6", "#777777"
VIEW = so3.exp(np.array([-62.0, 0.0, 0.0]) * DEG) @ so3.exp(np.array([0.0, 0.0, 35.0]) * DEG)
"""From a drawing's own axes (z up) to paper: x right, y up, z to the reader."""


def on_paper(points: np.ndarray) -> np.ndarray:
    return (points @ VIEW.T)[..., :2]


def blank(width: float, height: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = [figure.add_subplot(1, columns, 1 + i) for i in range(columns)]
    for axis in axes:
        axis.set_aspect("equal")
        axis.axis("off")
    return figure, axes


def arrow(
    axis: Axes, start: np.ndarray, end: np.ndarray, colour: str, text: str = "", width: float = 1.6
) -> None:
    axis.annotate(
        "",
        end,
        start,
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0},
    )
    if text:
        away = np.asarray(end) - np.asarray(start)
        room = 0.25 if "$" in text else 0.14 + 0.03 * len(text)
        at = np.asarray(end) + room * away / max(float(np.linalg.norm(away)), 1e-9)
        axis.text(*at, text, color=colour, ha="center", va="center")


def triad(
    axis: Axes,
    origin: np.ndarray,
    axes: np.ndarray,
    colour: str,
    names: tuple[str, str, str],
    size: float = 1.0,
) -> None:
    """Axes are the columns, in the drawing's own axes."""
    for vector, name in zip(axes.T, names, strict=True):
        arrow(axis, on_paper(origin), on_paper(origin + size * vector), colour, name)


def frames() -> Figure:
    """J on the Earth, O at the satellite, E and K bolted to it."""
    figure, (axis,) = blank(7.0, 5.4)
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    radius = 2.6
    axis.plot(radius * np.cos(angle), radius * np.sin(angle), color=GREY, lw=1.0)
    equator = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    axis.plot(*on_paper(equator).T, color=GREY, lw=0.7, ls=":")
    triad(axis, np.zeros(3), np.eye(3), GREY, ("$x_J$", "$y_J$", "$z_J$"), 1.2)
    axis.text(-4.5, -3.2, "J: Earth-fixed (ITRF)\nI: inertial (GCRF),\n   not turning", color=GREY, va="top")

    tilt = so3.exp(np.array([0.0, -98.0, 0.0]) * DEG) @ so3.exp(np.array([0.0, 0.0, 90.0]) * DEG)
    place = np.array([np.cos(angle), np.sin(angle), np.zeros_like(angle)]).T @ tilt.T * 4.3
    axis.plot(*on_paper(place).T, color=GREY, lw=0.8, ls="--")
    k = int(np.argmax(on_paper(place)[:, 0] + on_paper(place)[:, 1]))
    r, v = place[k], place[k + 1] - place[k - 1]
    down = -r / np.linalg.norm(r)
    along = v - down * (down @ v)
    along = along / np.linalg.norm(along)
    across = np.cross(down, along)
    triad(axis, r, np.stack([along, across, down], axis=-1), "black", ("$x_O$", "$y_O$", "$z_O$"), 1.5)
    axis.text(*(on_paper(r) + np.array([-3.4, 0.75])), "O: orbital", color="black")
    axis.set(xlim=(-4.6, 6.4), ylim=(-4.4, 5.2))
    return figure


def mounting() -> Figure:
    """The rigid body with the star tracker E and the camera K, and the line of sight to a marker."""
    figure, (axis,) = blank(7.4, 5.2)
    body = np.array([[-1.2, -0.8], [1.2, -0.8], [1.2, 0.8], [-1.2, 0.8], [-1.2, -0.8]])
    axis.plot(*body.T, color=GREY, lw=1.2)
    axis.text(-1.1, 0.55, "satellite", color=GREY)
    tracker, camera = np.array([0.7, 0.8]), np.array([-0.3, -0.8])
    for name, end in (("$x_E$", (1.5, -0.15)), ("$z_E$", (0.75, 1.3))):
        arrow(axis, tracker, tracker + np.array(end), GREEN, name)
    axis.plot(*tracker, "o", color=GREEN, markersize=11, fillstyle="none")
    axis.plot(*tracker, "x", color=GREEN)
    axis.text(2.35, 1.35, "E: star tracker\n($y_E$ away from the reader)", color=GREEN)
    for name, end in (("$x_K$", (-1.4, 0.0)), ("$z_K$", (0.0, -1.5))):
        arrow(axis, camera, camera + np.array(end), BLUE, name)
    axis.plot(*camera, "o", color=BLUE, markersize=11, fillstyle="none")
    axis.plot(*camera, "x", color=BLUE)
    axis.text(
        -4.4,
        -2.0,
        "K: camera\nx growing column\ny growing row\n   (away from the reader)\nz boresight, to the scene",
        color=BLUE,
        va="top",
    )
    marker = np.array([1.3, -4.4])
    axis.plot([-4.5, 4.5], [-4.4, -4.4], color=GREY)
    axis.plot(*marker, "^", color=RED, markersize=9)
    axis.text(1.55, -4.25, "marker $p_J$", color=RED, va="bottom")
    arrow(axis, camera, marker + np.array([-0.08, 0.15]), RED)
    axis.text(0.75, -2.6, "$e$: apparent direction", color=RED)
    axis.annotate(
        "",
        (-0.15, -0.7),
        (0.6, 0.65),
        arrowprops={"arrowstyle": "<-", "color": "black", "connectionstyle": "arc3,rad=0.3"},
    )
    axis.text(-0.95, 0.02, "$C_{EK}$", color="black")
    axis.set(xlim=(-4.7, 5.2), ylim=(-4.8, 2.5))
    return figure


def signs() -> Figure:
    """theta_E about +z: the model camera is turned counter-clockwise from the true one; the correction turns it."""
    figure, axes = blank(9.0, 4.0, 2)
    theta = 24.0 * DEG

    def turned(angle: float) -> np.ndarray:
        return np.array([np.cos(angle), np.sin(angle)])

    titles = ("$\\theta_E$: how the model is wrong", "$d_E$: how it is corrected")
    pairs = ((0.0, theta, GREY, BLUE, "true", "model"), (theta, 0.12 * theta, BLUE, RED, "model", "new"))
    for axis, title, (first, second, one, two, name_one, name_two) in zip(axes, titles, pairs, strict=True):
        for angle, colour, name in ((first, one, name_one), (second, two, name_two)):
            arrow(axis, np.zeros(2), 1.6 * turned(angle), colour, f"x {name}")
            arrow(axis, np.zeros(2), 1.6 * turned(angle + np.pi / 2), colour, f"y {name}")
        arc = np.linspace(first, second, 30)
        axis.plot(*(1.05 * turned(arc)), color="black", lw=1.0)
        axis.annotate(
            "",
            1.05 * turned(arc[-1]),
            1.05 * turned(arc[-4]),
            arrowprops={"arrowstyle": "-|>", "color": "black"},
        )
        axis.set_title(title, fontsize=12)
        axis.plot(0, 0, "o", color="black", markersize=7, fillstyle="none")
        axis.plot(0, 0, ".", color="black")
        axis.set(xlim=(-1.0, 2.1), ylim=(-0.55, 2.0))
    axes[0].text(1.2, 0.2, "$\\theta_z > 0$", ha="left")
    axes[1].text(1.2, 0.2, "$d_z < 0$", ha="left")
    for axis, formula in zip(
        axes,
        (
            "$C_{EK}^{model} = \\exp(\\theta_E)\\ C_{EK}^{true}$",
            "$C_{EK}^{new} = \\exp(d_E)\\ C_{EK}^{model}$",
        ),
        strict=True,
    ):
        axis.text(0.5, -0.42, formula + "      ($z_E$ to the reader)", ha="center", fontsize=9)
    return figure


def pixels() -> Figure:
    """Where (0, 0) is, for a frame and for a line scanner."""
    figure, axes = blank(9.5, 4.6, 2)
    for axis in axes:
        axis.invert_yaxis()
        for i in range(6):
            axis.plot([-0.5, 4.5], [i - 0.5, i - 0.5], color="#bbbbbb", lw=0.8)
            axis.plot([i - 0.5, i - 0.5], [-0.5, 4.5], color="#bbbbbb", lw=0.8)
        arrow(axis, np.array([-0.5, -1.25]), np.array([2.6, -1.25]), BLUE, "")
        axis.text(2.75, -1.25, "column, $x_K$", color=BLUE, va="center")
        arrow(axis, np.array([-0.85, -0.5]), np.array([-0.85, 2.6]), BLUE, "")
        axis.text(-0.85, 2.8, "row, $y_K$", color=BLUE, ha="center", va="top")
        axis.plot(0, 0, "o", color=RED, markersize=5)
        axis.text(0.12, -0.12, "(0, 0)\ncenter", color=RED, fontsize=9, va="top")
        axis.plot(-0.5, -0.5, "s", color=GREY, markersize=5)
        axis.text(-0.62, -0.62, "(0, 0) where pixel_origin = corner", color=GREY, fontsize=9, va="bottom")
        axis.set(xlim=(-2.0, 5.6), ylim=(5.0, -1.7))
    axes[0].set_title("frame: one epoch, mid-exposure", fontsize=12)
    axes[0].plot(2.5, 2.5, "x", color=GREEN, markersize=10)
    axes[0].text(2.65, 2.5, "principal point\n($z_K$ into the paper)", color=GREEN, va="center", fontsize=9)
    axes[1].set_title("line scanner: row r at t0 + r * line_period", fontsize=12)
    axes[1].fill([-0.5, 4.5, 4.5, -0.5], [1.5, 1.5, 2.5, 2.5], color="#dfe8f5")
    axes[1].text(
        2.0,
        2.0,
        "one line of detectors,\nthe same look directions in every row",
        ha="center",
        va="center",
        fontsize=9,
    )
    axes[1].text(4.65, 0.0, "t0", va="center", fontsize=10)
    axes[1].text(4.65, 4.0, "t0 + 4 T", va="center", fontsize=9)
    return figure


def euler() -> Figure:
    """Capitals turn about the axes as turned so far, small letters about the fixed ones."""
    figure, axes = blank(10.0, 3.6, 3)
    z, y = so3.exp(np.array([0.0, 0.0, 25.0]) * DEG), so3.exp(np.array([0.0, 40.0, 0.0]) * DEG)
    cases = (
        ("start", np.eye(3), ("x", "y", "z")),
        ('"ZY" [25, 40]: z, then the turned y', z @ y, ("x''", "y''", "z''")),
        ('"zy" [25, 40]: z, then the fixed y', y @ z, ("x''", "y''", "z''")),
    )
    for axis, (title, C, names) in zip(axes, cases, strict=True):
        triad(axis, np.zeros(3), np.eye(3), "#bbbbbb", ("", "", ""), 1.0)
        triad(axis, np.zeros(3), C, BLUE, names, 1.0)
        axis.set_title(title, fontsize=10)
        axis.set(xlim=(-1.35, 1.35), ylim=(-0.9, 1.35))
    return figure


def scales() -> Figure:
    """How the time scales are offset from one another, from 2017 on."""
    figure = Figure(figsize=(7.5, 1.7), layout="constrained")
    axis = figure.add_subplot()
    offsets = {"UTC": 0.0, "GPS": 18.0, "TAI": 37.0, "TT": 69.184}
    axis.axhline(0.0, color=GREY, lw=1.0)
    for name, at in offsets.items():
        axis.plot(at, 0.0, "|", color=BLUE, markersize=16, markeredgewidth=2)
        axis.text(at, 0.55, name, color=BLUE, ha="center")
        axis.text(at, -0.85, f"{at:g} s", ha="center", fontsize=9)
    axis.set(xlim=(-6, 76), ylim=(-1.3, 1.2))
    axis.axis("off")
    return figure


DRAWINGS = (frames, mounting, signs, pixels, euler, scales)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for draw in DRAWINGS:
        draw().savefig(folder / f"{draw.__name__}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
