"""The badges of the README, each from what the project's own files say; ``python docs/badges.py`` writes them again."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "_static" / "badges"
WIDE = 6.6
"""Width of a letter of the badges' 11 px sans-serif, generously."""


def facts() -> dict[str, tuple[str, str]]:
    """Of each badge the two words, by the name of its file."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project, typed = settings["project"], (ROOT / "src/starplumb/py.typed").exists()
    checked = "strict" if settings["tool"]["mypy"]["strict"] else "partial"
    status = next(c for c in project["classifiers"] if c.startswith("Development Status"))
    return {
        "python": ("python", project["requires-python"].replace(">=", "") + " or newer"),
        "licence": ("licence", project["license"]),
        "types": ("types", checked if typed else "none"),
        "status": ("status", status.rsplit("- ", 1)[1].lower()),
    }


def badge(word: str, value: str) -> str:
    """Two words side by side as the text of an SVG file."""
    left, right = WIDE * len(word) + 12.0, WIDE * len(value) + 12.0
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + right:.0f}" height="20" role="img">'
        f"<title>{word}: {value}</title>"
        f'<rect width="{left + right:.0f}" height="20" rx="3" fill="#24292f"/>'
        f'<path d="M{left:.0f} 0h{right - 3:.0f}a3 3 0 0 1 3 3v14a3 3 0 0 1-3 3h-{right - 3:.0f}z" fill="#0b5cad"/>'
        '<g fill="#ffffff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle">'
        f'<text x="{left / 2:.0f}" y="14">{word}</text><text x="{left + right / 2:.0f}" y="14">{value}</text>'
        "</g></svg>\n"
    )


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, (word, value) in facts().items():
        (FOLDER / f"{name}.svg").write_text(badge(word, value), encoding="utf-8")


if __name__ == "__main__":
    main()
