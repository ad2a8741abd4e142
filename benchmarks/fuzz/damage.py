"""Changes of a valid file: those that must not matter, and damage that knows numbers, words, lines and trees."""

from __future__ import annotations

import gzip
import re
import struct
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator
Same = Callable[[bytes], bytes]

NUMBER = re.compile(rb"(?<![\w.:+-])[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?(?![\w.:-])")
DECIMAL = re.compile(rb"(?<![\w.:+-])-?\d+\.\d+(?![\w.:-])")
TIME = re.compile(rb"\d{4}-\d\d-\d\dT[\d:.]+")
WORD = re.compile(rb"[A-Za-z_][\w/-]+")
ODD_NUMBERS = [
    *("nan", "inf", "-inf", "Infinity", "1e308", "-1e308", "1e-308", "1e400", "1e-400", "1e1000000"),
    *("1e-1000000", "1e999999999", "1_000", "\u0667\u0660\u0660\u0660", "\uff11\uff12", "", "-", "0x10"),
    *("1,5", "-0", "-0.0", "0", "1", "-1", "1d0", "NULL", "null", "true", "1.5.2", "1e", ".", "--1", "+"),
    *(
        "9" * 20,
        "9" * 400,
        "1" * 5000,
        "0." + "0" * 400 + "1",
        "1e200",
        "1e-300",
        "1e19",
        "-1e19",
        "2147483648",
    ),
    *(
        "4294967296",
        "-2147483649",
        "9223372036854775808",
        "1e15",
        "1e16",
        "0.5",
        "7",
        "-999999",
        "999999.999999",
    ),
    *(
        "1e6",
        "1e7",
        "1e9",
        "90",
        "91",
        "180",
        "360",
        "721",
        "-9999",
        "-32768",
        "3.4028235e38",
        "\u00bd",
        "1e5000",
    ),
]
ODD_TIMES = [
    *("0000-00-00T00:00:00", "9999-12-31T23:59:59", "1600-01-01T00:00:00", "2299-01-01T00:00:00"),
    *("2016-12-31T23:59:60", "2016-12-31T23:59:60.999999999", "2020-06-30T23:59:60", "2020-02-30T00:00:00"),
    *("2020-01-01T24:00:00", "2020-01-01T00:00:-0.5", "2020-01-01T00:00:01.9999999999", "2020-001T00:00:00"),
    *("2020-366T00:00:00", "2021-366T00:00:00", "1971-12-31T00:00:00", "2100-01-01T00:00:00", "now", "", "0"),
    *("2020-01-01", "2020-01-01T00:00:00+01:00", "2020-01-01T00:00:00Z", "12:00:00", "1577836800"),
]
ODD_BYTES = [
    *(
        b"\0",
        b"\x1b[31m",
        b"\x85",
        "\u2028".encode(),
        "\u0301".encode(),
        "\ufeff".encode(),
        b"\xff",
        b"\xc3\x28",
    ),
    *(
        b'"',
        b"'",
        b"{",
        b"}",
        b"[",
        b"]",
        b"(",
        b")",
        b"<",
        b">",
        b"&",
        b";",
        b"=",
        b",",
        b"\t",
        b"\r",
        b"\n",
        b"#",
    ),
    *(
        b"<!DOCTYPE x>",
        b"&lol;",
        b"%n",
        b"../",
        b"/vsicurl/http://127.0.0.1:9/x",
        b"\x0b",
        b"\x0c",
        b"\x1c",
        b"\\",
    ),
    *(b"x" * 20_000, b"[" * 3000, b"<a>" * 3000, b"{" * 3000, b"(" * 3000, b'{"a":' * 3000, b" " * 20_000),
]


def _one(rng: Rng, data: bytes, pattern: re.Pattern[bytes], new: Callable[[bytes], bytes]) -> bytes:
    found = list(pattern.finditer(data, 0, 200_000))
    if not found:
        return data
    at = found[rng.integers(len(found))]
    return data[: at.start()] + new(at.group()) + data[at.end() :]


def odd_number(rng: Rng, data: bytes) -> bytes:
    return _one(rng, data, NUMBER, lambda _: ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))].encode())


def other_number(rng: Rng, data: bytes) -> bytes:
    """A number a little, or much, off, or of random digits."""

    def new(old: bytes) -> bytes:
        x = float(old)
        pick = rng.integers(5)
        if pick == 0:
            return repr(x * (1.0 + 10.0 ** rng.uniform(-9, 1))).encode()
        if pick == 1:
            return repr(-x).encode()
        if pick == 2:
            return f"{x + rng.integers(-3, 4):.12g}".encode()
        if pick == 3:
            return repr(float(rng.normal() * 10.0 ** rng.uniform(-320, 308))).encode()
        return str(rng.integers(-(10**6), 10**6)).encode()

    return _one(rng, data, NUMBER, new)


def odd_time(rng: Rng, data: bytes) -> bytes:
    return _one(rng, data, TIME, lambda _: ODD_TIMES[rng.integers(len(ODD_TIMES))].encode())


def other_word(rng: Rng, data: bytes) -> bytes:
    words = WORD.findall(data[:100_000])
    return _one(rng, data, WORD, lambda _: words[rng.integers(len(words))]) if words else data


def no_word(rng: Rng, data: bytes) -> bytes:
    return _one(rng, data, WORD, lambda word: word[: rng.integers(len(word))])


def lines(rng: Rng, data: bytes) -> bytes:
    """Lines left out, doubled, moved or swapped."""
    rows = data.split(b"\n")
    i, j = rng.integers(len(rows), size=2)
    pick = rng.integers(5)
    if pick == 0:
        del rows[i]
    elif pick == 1:
        rows.insert(j, rows[i])
    elif pick == 2:
        rows[i], rows[j] = rows[j], rows[i]
    elif pick == 3:
        low, high = sorted((i, j))
        del rows[low:high]
    else:
        low, high = sorted((i, j))
        rows[high:high] = rows[low:high]
    return b"\n".join(rows)


def element(rng: Rng, data: bytes) -> bytes:
    """An element of XML, or a value of JSON or TOML, left out, doubled or put elsewhere."""
    pattern = (
        rb"<(\w+)[^>]*>[^<]*</\1>" if data.lstrip().startswith(b"<") else rb'"?[\w.]+"?\s*[:=]\s*[^,\n{}]+,?'
    )
    found = list(re.finditer(pattern, data[:200_000]))
    if not found:
        return data
    a, b = found[rng.integers(len(found))], found[rng.integers(len(found))]
    pick = rng.integers(3)
    if pick == 0:
        return data[: a.start()] + data[a.end() :]
    if pick == 1:
        return data[: a.start()] + a.group() + b"\n" + a.group() + data[a.end() :]
    return data[: b.start()] + a.group() + b"\n" + data[b.start() :]


def odd_bytes(rng: Rng, data: bytes) -> bytes:
    at = rng.integers(len(data) + 1)
    return data[:at] + ODD_BYTES[rng.integers(len(ODD_BYTES))] + data[at:]


def flipped(rng: Rng, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.integers(1, 9)):
        if changed:
            changed[rng.integers(len(changed))] = rng.integers(256)
    return bytes(changed)


def cut(rng: Rng, data: bytes) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def hollow(rng: Rng, data: bytes) -> bytes:
    """A stretch left out, of zeros, or doubled."""
    low, high = sorted(rng.integers(len(data) + 1, size=2).tolist())
    middle = (b"", bytes(high - low), 2 * data[low:high])[rng.integers(3)]
    return data[:low] + middle + data[high:]


_WORDS = [
    *(
        struct.pack("<d", x)
        for x in (0.0, -1.0, 1.0, 0.5, 1e300, -1e300, 1e-300, 1e10, np.nan, np.inf, -np.inf)
    ),
    *(
        struct.pack("<i", x)
        for x in (0, -1, 1, 2, 127, 128, 255, 1 << 16, (1 << 31) - 1, -(1 << 31), 1 << 30)
    ),
    *(struct.pack("<H", x) for x in (0, 1, 0xFFFF, 0x7FFF, 0x8000, 12, 4)),
]


def words(rng: Rng, data: bytes) -> bytes:
    """A whole number or a float, at a place where one may stand, of another value."""
    new = _WORDS[rng.integers(len(_WORDS))]
    new = new[::-1] if rng.random() < 0.2 else new
    if len(data) < 2 * len(new):
        return data
    head = 4096 if rng.random() < 0.7 else len(data)  # where the structure stands
    at = len(new) * rng.integers(min(head, len(data)) // len(new))
    return data[:at] + new + data[at + len(new) :]


def counted(rng: Rng, data: bytes) -> bytes:
    """A byte one more or less."""
    if not data:
        return data
    at = rng.integers(min(len(data), 4096)) if rng.random() < 0.7 else rng.integers(len(data))
    return data[:at] + bytes([(data[at] + rng.choice([1, 255])) % 256]) + data[at + 1 :]


def nothing(rng: Rng, data: bytes) -> bytes:
    return (b"", b" \n", bytes(100), b"\n" * 50, rng.bytes(200))[rng.integers(5)]


def packed(rng: Rng, data: bytes) -> bytes:
    """Packed, and then damaged or not."""
    data = gzip.compress(data, 1)
    return (flipped, cut, hollow, counted)[rng.integers(4)](rng, data)


TEXT = (
    *(
        odd_number,
        odd_number,
        odd_number,
        other_number,
        other_number,
        odd_time,
        other_word,
        no_word,
        lines,
        lines,
    ),
    *(element, element, odd_bytes, flipped, cut, hollow, nothing, packed),
)
BINARY = (words, words, words, counted, counted, flipped, cut, hollow, nothing, odd_bytes)


def damaged(rng: Rng, data: bytes, kinds: tuple[Callable[[Rng, bytes], bytes], ...]) -> bytes:
    """One to three changes."""
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        data = kinds[rng.integers(len(kinds))](rng, data)
    return data


# what must not matter


def crlf(data: bytes) -> bytes:
    return data.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n")


def marked(data: bytes) -> bytes:
    return b"\xef\xbb\xbf" + data


def blanks(data: bytes) -> bytes:
    return data.replace(b"\n", b"  \n")


def blank_end(data: bytes) -> bytes:
    return data + b"\n\n"


def in_gzip(data: bytes) -> bytes:
    return gzip.compress(data, 1)


def respelled(data: bytes) -> bytes:
    """Numbers with a further zero, or an exponent: the same values."""
    return DECIMAL.sub(lambda m: m.group() + b"0" if len(m.group()) % 2 else m.group() + b"e0", data)


def hashed(data: bytes) -> bytes:
    return b"# a comment\n" + data


def xml_comment(data: bytes) -> bytes:
    at = data.rfind(b"</")
    return data[:at] + b"<!-- 1.5 -->" + data[at:]


def kvn_comment(data: bytes) -> bytes:
    at = data.find(b"\n") + 1
    return data[:at] + b"COMMENT X = 1.5\n" + data[at:]


PLAIN: tuple[Same, ...] = (crlf, marked, blanks, blank_end)
