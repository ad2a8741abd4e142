"""Readers of orbits and attitudes: messages, series, kernels; made by the package, by SPICE and by its tests."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import second
from damage import BINARY, PLAIN, hashed, in_gzip, kvn_comment, xml_comment
from target import Array, Compare, Target


def _in_folder(name: str) -> Callable[[Path], Any]:
    """The file read as that of an orbit or attitude is, format recognised."""

    def read(folder: Path) -> Any:
        from starplumb.io.formats.registry import ATTITUDES, ORBITS, Asked, recognised

        path = folder / name
        for formats in (ORBITS, ATTITUDES) if name.startswith("orbit") else (ATTITUDES, ORBITS):
            kernels = tuple(folder / kernel for kernel in ("sat.tsc", "sat.tf") if (folder / kernel).exists())
            known = recognised(path, formats)
            if known is None:
                return None
            object_id = "L47" if name.endswith(".obx") else None
            return known.read(
                path, Asked(object_id, kernels=kernels, frame="SAT1_STR" if formats is ATTITUDES else "")
            )
        return None

    return read


def _states(parser: Callable[[bytes], Array], width: int = 6) -> Compare:
    def compare(data: bytes, found: Any) -> None:
        expected = parser(data)
        given = np.hstack([found.r] + [found.v] * (found.v is not None))
        n = min(width, given.shape[1], expected.shape[1])
        np.testing.assert_array_equal(given[:, :n], expected[:, :n])

    return compare


def _quaternions(parser: Callable[[bytes], Array], order: list[int], sign: list[int]) -> Compare:
    def compare(data: bytes, found: Any) -> None:
        expected = second.unit(parser(data)[:, order]) * sign
        np.testing.assert_allclose(found.q_BA_xyzw, expected, rtol=0, atol=4e-15)

    return compare


def _messages() -> Iterator[Target]:
    from bad_cases import AEM, OEM
    from starplumb.io.formats.aem import read_aem, write_aem_xml
    from starplumb.io.formats.oem import read_oem, write_oem_xml

    kvn = (*PLAIN, kvn_comment, in_gzip)
    states = _states(partial(second.message, width=6, factor=1000))
    yield Target(
        "CCSDS OEM",
        {"orbit.oem": OEM.encode()},
        ("orbit.oem",),
        _in_folder("orbit.oem"),
        same=kvn,
        compare=states,
    )
    turn = _quaternions(partial(second.message, width=4, factor=1), [0, 1, 2, 3], [-1, -1, -1, 1])
    yield Target(
        "CCSDS AEM",
        {"attitude.aem": AEM.encode()},
        ("attitude.aem",),
        _in_folder("attitude.aem"),
        same=kvn,
        compare=turn,
    )
    from tempfile import TemporaryDirectory

    with TemporaryDirectory() as folder:
        orbit, attitude = Path(folder, "orbit.oem"), Path(folder, "attitude.aem")
        orbit.write_text(OEM)
        attitude.write_text(AEM)
        write_oem_xml(Path(folder, "orbit.xml"), read_oem(orbit))
        write_aem_xml(Path(folder, "attitude.xml"), read_aem(attitude))
        for name, title in (("orbit.xml", "CCSDS OEM as XML"), ("attitude.xml", "CCSDS AEM as XML")):
            data = Path(folder, name).read_bytes()
            yield Target(
                title,
                {name: data},
                (name,),
                _in_folder(name),
                same=(*PLAIN[:1], *PLAIN[2:], xml_comment, in_gzip),
            )


def _series() -> Iterator[Target]:
    from test_orbex import ORBEX
    from test_sp3 import sp3
    from test_stk import EPHEMERIS, TURNING

    same = (*PLAIN, in_gzip)
    of_sp3 = _states(second.sp3, 3)
    yield Target(
        "SP3",
        {"orbit.sp3": sp3().encode()},
        ("orbit.sp3",),
        _in_folder("orbit.sp3"),
        same=same,
        compare=of_sp3,
    )

    def of_stk(data: bytes, found: Any) -> None:
        given = np.hstack([found.r] + [found.v] * (found.v is not None))
        np.testing.assert_array_equal(given, second.stk(data)[:, : given.shape[1]])

    yield Target(
        "STK ephemeris",
        {"orbit.e": EPHEMERIS.encode()},
        ("orbit.e",),
        _in_folder("orbit.e"),
        same=(*same, hashed),
        compare=of_stk,
    )
    turning = TURNING.replace("Points  361", "Points  3")
    turns = _quaternions(lambda data: second.stk(data)[:, :4], [0, 1, 2, 3], [-1, -1, -1, 1])
    yield Target(
        "STK attitude",
        {"attitude.a": turning.encode()},
        ("attitude.a",),
        _in_folder("attitude.a"),
        same=(*same, hashed),
        compare=turns,
    )
    of_orbex = _quaternions(second.orbex, [1, 2, 3, 0], [1, 1, 1, 1])
    yield Target(
        "ORBEX",
        {"attitude.obx": ORBEX.encode()},
        ("attitude.obx",),
        _in_folder("attitude.obx"),
        same=same,
        compare=of_orbex,
    )


def _kernels() -> Iterator[Target]:
    from tempfile import TemporaryDirectory

    import spiceypy as spice
    from scipy.spatial.transform import Rotation

    from test_ck import BUS, CLOCK, FRAMES, SCLK, T0
    from test_daf import orbit

    with TemporaryDirectory() as folder:
        for kind in (2, 3, 5, 8, 9, 13):
            data = orbit(Path(folder, f"{kind}.bsp"), kind, 12).read_bytes()
            yield Target(
                f"SPICE SPK, type {kind}",
                {"orbit.bsp": data},
                ("orbit.bsp",),
                _in_folder("orbit.bsp"),
                BINARY,
                (in_gzip,),
            )
        Path(folder, "sat.tsc").write_text(SCLK)
        spice.furnsh(str(Path(folder, "sat.tsc")))
        ticks = np.array([spice.sce2c(CLOCK, T0 + t) for t in range(6)])
        q = np.roll(
            Rotation.from_rotvec(1e-2 * np.arange(6)[:, None] * [0.3, -0.5, 0.8]).as_quat(), 1, axis=-1
        )
        rest = (6, ticks, np.ascontiguousarray(q), np.zeros((6, 3)))
        for kind in (1, 2, 3):
            handle = spice.ckopn(str(Path(folder, f"{kind}.bc")), "made up", 0)
            head = (handle, ticks[0], ticks[-1], BUS, "J2000")
            if kind == 1:
                spice.ckw01(*head, False, "s", *rest)
            elif kind == 2:
                spice.ckw02(
                    *head, "s", 5, ticks[:-1], ticks[1:], rest[2][:-1], rest[3][:-1], np.full(5, 1e-5)
                )
            else:
                spice.ckw03(*head, True, "s", *rest, 1, ticks[:1])
            spice.ckcls(handle)
        spice.kclear()
        texts = {"sat.tsc": SCLK.encode(), "sat.tf": FRAMES.encode()}
        for kind in (1, 2, 3):
            files = texts | {"attitude.bc": Path(folder, f"{kind}.bc").read_bytes()}
            yield Target(
                f"SPICE CK, type {kind}",
                files,
                ("attitude.bc",),
                _in_folder("attitude.bc"),
                BINARY,
                (in_gzip,),
            )
        files = texts | {"attitude.bc": Path(folder, "1.bc").read_bytes()}
        yield Target("SPICE SCLK, FK", files, tuple(texts), _in_folder("attitude.bc"), same=PLAIN[3:])


def series() -> Iterator[Target]:
    """All of them."""
    yield from _messages()
    yield from _series()
    yield from _kernels()
