"""Numbers written in text: what is one, what is none, and that powers of ten are taken before rounding."""

from __future__ import annotations

import random
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from starplumb.io.text.numbers import decimal, finite_float, number, numbers, whole

GOOD = [
    "0",
    "-0.0",
    "1",
    "+1.5",
    "1.",
    ".5",
    "-2.5e-3",
    "1E+2",
    "  7\t",
    "1e-400",
    "00012.50",
    "9.9e74",
    "1e-999999",
]
NONE = [
    *(
        "",
        " ",
        "nan",
        "NaN",
        "inf",
        "-Infinity",
        "1_000",
        "1,5",
        "0x10",
        "1e",
        "e5",
        ".",
        "-",
        "--1",
        "1.5.2",
        "1 5",
    ),
    *(
        "\u0667",
        "\uff11",
        "\u00bd",
        "1e75",
        "1e308",
        "1e400",
        "1d0",
        "true",
        "1e5000",
        "1e-1000000",
        "9" * 400,
        "\x1c1",
        "\x0b1",
        "1\n2",
        "1e9999999",
    ),
]


@pytest.mark.parametrize("text", GOOD)
def test_numbers_are_the_nearest_doubles(text):
    exact = Fraction(text.strip()) if "999999" not in text else Fraction(0)
    for found in (number(text), numbers([text])[0], numbers(["1.5", text])[1]):
        assert found == float(exact)


@pytest.mark.parametrize("text", NONE)
def test_all_else_is_none(text):
    assert np.isnan(number(text))
    assert np.isnan(numbers(["1.5", text, "2"])).tolist() == [False, True, False]
    assert whole(text) is None


def test_a_power_of_ten_is_taken_before_rounding():
    """Kilometres as metres, against exact fractions: multiplying the double by 1000 would miss one in four."""
    draw = random.Random(1)
    texts = [f"{draw.randint(-(10**9), 10**9)}.{draw.randint(0, 10**7):07d}" for _ in range(300)]
    texts += [f"{text}e{draw.randint(-3, 3)}" for text in texts]
    expected = [float(Fraction(text) * 1000) for text in texts]
    assert numbers(texts, 3).tolist() == expected
    assert [number(text, 3) for text in texts] == expected
    assert [float(text) * 1000.0 for text in texts] != expected


def test_exact_and_whole_numbers():
    assert decimal("1577836800.123456789") == Decimal("1577836800.123456789")
    assert [decimal(text) for text in ("1e401", "1e-401", "1" * 500, "nan", "1_0", "\u0661")] == [None] * 6
    assert (whole("-42"), whole("007"), whole("1.0"), whole("9" * 19), whole("\u0661")) == (
        -42,
        7,
        None,
        None,
        None,
    )


def test_numbers_of_documents():
    assert (finite_float(3), finite_float(-0.5)) == (3.0, -0.5)
    for value in (True, "3", None, 10**400, float("nan"), float("inf"), [1]):
        assert finite_float(value) is None
