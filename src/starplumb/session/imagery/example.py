"""The example of ``starplumb init --imagery``: raw images of drawn ground with a reference, the true mounting known."""

from __future__ import annotations

from pathlib import Path

from ...physics.errors import InputError

COMMENT = """\
A simulated example: four raw images (raw_*.png) of drawn ground, under cloud, from one pass; the orthoimage
(ortho.png, laid on the ground by ortho.pgw) and the heights (dem.asc) of that ground, some of which has changed since.
The mounting below is wrong; the true one stands in [truth], which only the display of results reads.
Next: starplumb measure campaign.toml --calibrate"""


def write_drawn_example(
    folder: Path, seed: int = 1, schema: str = "", line_period_s: float = 0.0
) -> tuple[Path, int]:
    """Write the example into a folder, with a JSON schema if given, that of a line scanner with a line period; the path
    of its ``campaign.toml``, and how many images there are.  Takes some seconds."""
    from ...imagery.drawn.render import Sensor
    from ...io.drawn.write import OrthoPicture, write_imagery
    from ...plan import drawn_demo

    drawn = drawn_demo.drawn_demo(seed, line_period_s)
    sigma_m = drawn_demo.SIGMAS.landmark.tolist()
    ortho = OrthoPicture(drawn.ortho, drawn.corner, drawn.step, sigma_m, drawn_demo.LENGTH_M)
    path = write_imagery(
        folder,
        drawn.campaign,
        drawn.raws,
        ortho,
        drawn.dem,
        Sensor().most_dn,
        C_EK_true=drawn.C_EK_true,
        comment=COMMENT,
        schema=schema,
    )
    return path, len(drawn.raws)


def require_alone(others: dict[str, bool]) -> None:
    """Raise InputError for the first of other options that was given beside ``--imagery``."""
    for name, given in others.items():
        if given:
            raise InputError(f"--imagery: found {name} beside it, wanted it alone or with --seed")
