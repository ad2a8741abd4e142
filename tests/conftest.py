"""Fixtures shared by all tests."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

SHARED = Path(__file__).resolve().parents[1].parent / "shared"

settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded by the test's own name: draws are fixed, yet no two tests share them."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real products beside the checkout; tests that need it skip where it is missing."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip(f"real products not found at {folder}")
    return folder


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """Folder of small inputs that once went wrong; tests that need it skip where it is missing."""
    folder = SHARED / "cases"
    if not folder.is_dir():
        pytest.skip(f"cases not found at {folder}")
    return folder


@pytest.fixture
def clean_pool() -> Iterator[None]:
    """No test may leave a SPICE kernel behind, nor find one."""
    spice = pytest.importorskip("spiceypy")
    spice.kclear()
    yield
    assert spice.ktotal("ALL") == 0
    spice.kclear()
