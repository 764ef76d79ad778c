"""Journals and tables for an import spoiled at random, by a seed: by chance, and on purpose with
their checksums made right again.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from zlib import crc32

import msgspec
from spoiled import BYTES

from app.session.files import images_of, results_of
from app.session.journal import _ABOUT, _HEAD, _MARK, journal_of

_NUMBERS = [
    0,
    1,
    -1,
    3,
    77,
    125,
    10**6,
    2**31,
    2**53,
    2**63 - 1,
    2**63,
    10**30,
    0.5,
    -0.0,
    1e-300,
    1e308,
    float("nan"),
    float("inf"),
]
_ODD = [
    *_NUMBERS,
    None,
    True,
    "",
    "x",
    "event",
    "u1",
    "O",
    "\x1b[2J",
    "é" * 1000,
    [],
    [1],
    [0, 0],
    [60000, 60000],
    [2**40, 2**40],
    {},
    {"a": 1},
]
_CELLS = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1",
    "2.5",
    "1,5",
    "1e308",
    "-1e308",
    "1e-320",
    "3599",
    "360000",
    "1e9",
    "99999999999999999999",
]
_CELLS += [
    "x",
    "0x10",
    "1_0",
    "\0",
    '"',
    "'",
    "#",
    "drive",
    "reference",
    "../../etc/passwd",
    "0.tiff",
    "9" * 400,
    "é" * 1000,
    " ",
    "; ,\t",
]
_HEADS = [
    "sample",
    "time_s",
    "time_ms",
    "P_N",
    "q_mN",
    "Q_N",
    "normal_V",
    "shear_V",
    "stage_um",
    "frame",
    "phase",
    "phase_sample",
    "file",
    "",
]
_CHANCE = [name for name in BYTES if name != "forged header"]


def spoil_journal(whole: Path, path: Path, seed: int) -> str:
    """Write a copy of a session that was cut short, some of its files spoiled; the name of what was
    done to the journal.
    """
    rng = random.Random(seed)
    session, journal, results = (
        bytearray(file(whole).read_bytes()) for file in (images_of, journal_of, results_of)
    )
    how = rng.choice([*_CHANCE, *RECORDS, *RECORDS])
    if how in BYTES:
        BYTES[how](journal, rng)
    else:
        records = _records(bytes(journal))
        for _ in range(rng.choice([1, 1, 2, 10])):
            RECORDS[how](records, rng)
        journal[journal.index(b"\n") + 1 :] = _written(records)
    for other in (session, results):
        if rng.random() < 0.3:
            BYTES[rng.choice(_CHANCE)](other, rng)
    images_of(path).write_bytes(session)
    journal_of(path).write_bytes(journal)
    results_of(path).write_bytes(results)
    return how


def _written(records: list[tuple[int, bytes]]) -> bytes:
    """Records with the checksums that a journal has."""
    written, chain = bytearray(), 0
    for kind, held in records:
        chain = crc32(held, chain)
        rest = _ABOUT.pack(kind % 256, len(held), chain) + held
        written += _HEAD.pack(_MARK, crc32(rest)) + rest
    return bytes(written)


def _records(journal: bytes) -> list[tuple[int, bytes]]:
    """Type and payload of each record."""
    at, found = journal.index(b"\n") + 1, []
    while at < len(journal):
        kind, length, _ = _ABOUT.unpack_from(journal, at + _HEAD.size)
        at += _HEAD.size + _ABOUT.size
        found.append((kind, journal[at : at + length]))
        at += length
    return found


def _change_value(records: list[tuple[int, bytes]], rng: random.Random) -> None:
    """Another value somewhere in a record; half of the time in the first, which says what the
    session is.
    """
    n = rng.choice([0, rng.randrange(len(records))])
    try:
        held: Any = msgspec.msgpack.decode(records[n][1])
    except msgspec.DecodeError:
        return
    part = held
    while isinstance(part, list | dict) and part:
        key = rng.choice(list(part) if isinstance(part, dict) else range(len(part)))
        if not isinstance(part[key], list | dict) or not part[key] or rng.random() < 0.3:
            part[key] = rng.choice(_ODD)
            break
        part = part[key]
    with suppress(OverflowError):  # numbers that msgpack cannot hold
        records[n] = records[n][0], msgspec.msgpack.encode(held)


def _change_payload(records: list[tuple[int, bytes]], rng: random.Random) -> None:
    n = rng.randrange(len(records))
    kind, payload = records[n]
    content = bytearray(payload)
    if any(content):
        BYTES[rng.choice(["bits", "bytes", "cut", "zeroed"])](content, rng)
    records[n] = rng.choice([kind, kind, kind, *range(9)]), bytes(content)


def _reorder(records: list[tuple[int, bytes]], rng: random.Random) -> None:
    a, b = (rng.randrange(len(records)) for _ in "ab")
    rng.choice(
        [
            records.__delitem__,
            lambda n: records.insert(n, records[b]),
            lambda n: records.extend([records[n]] * 2000),
        ]
    )(a)


def _hostile(records: list[tuple[int, bytes]], rng: random.Random) -> None:
    """A gap of hours, many of them, one image many times, depth without end."""
    gap, frame, event = 2, 3, 7  # types

    def encoded(**fields: Any) -> bytes:
        return msgspec.msgpack.encode(fields)

    records.append(
        rng.choice(
            [
                (gap, encoded(first=1003, count=3600000, reason="x")),
                (gap, encoded(first=1003, count=3600000000, reason="x")),
                (event, b"\x91" * 10**5),
                (event, encoded(sample=1, kind="phase", text="x" * 10**6)),
                (frame, encoded(index=9, sample=9, place=0, nbytes=192, checksum=0)),
                (0, records[0][1]),
                (event, b""),
                (event, b"\x07"),
            ]
        )
    )
    if rng.random() < 0.3:
        firsts = [1003 + 10**6 * n for n in range(300)]
        records.extend((gap, encoded(first=n, count=10**6, reason="x")) for n in firsts)
    if rng.random() < 0.3:
        records.extend([record for record in records if record[0] == frame][-1:] * 10**4)


RECORDS: dict[str, Callable[[list[tuple[int, bytes]], random.Random], None]] = {
    "value": _change_value,
    "payload": _change_payload,
    "order": _reorder,
    "hostile": _hostile,
}


def spoil_table(content: bytes, rng: random.Random) -> bytes:
    """A table of forces or images with other cells, names, rows or bytes."""
    if rng.random() < 0.3:
        spoiled = bytearray(content)
        BYTES[rng.choice(_CHANCE)](spoiled, rng)
        return bytes(spoiled)
    rows = [line.split(",") for line in content.decode().splitlines() if not line.startswith("#")]
    for _ in range(rng.choice([1, 1, 1, 2, 5])):
        n, column = rng.randrange(1, len(rows)), rng.randrange(len(rows[0]))
        how = rng.choice(
            [
                "cell",
                "cell",
                "cell",
                "name",
                "copy",
                "drop",
                "swap",
                "scale",
                "scale",
                "column",
                "longer",
            ]
        )
        if how == "cell":
            rows[n][column % len(rows[n])] = rng.choice(_CELLS)
        elif how == "name":
            rows[0][column] = rng.choice(_HEADS)
        elif how == "copy":
            rows.insert(n, list(rows[n]))
        elif how == "drop" and len(rows) > 2:
            del rows[n]
        elif how == "swap":
            m = rng.randrange(1, len(rows))
            rows[n], rows[m] = rows[m], rows[n]
        elif how == "scale":
            factor = rng.choice([-1.0, 0.0, 1e-3, 0.5, 3.0, 1e3, 1e6, 1e300])
            for row in rows[1:]:
                row[column % len(row)] = str(_number(row[column % len(row)]) * factor)
        elif how == "column" and len(rows[0]) > 1:
            for row in rows:
                del row[min(column, len(row) - 1)]
        elif how == "longer":
            step, last = rng.choice([0, 1, 125, 10**5]), rows[-1]
            rows.extend([str(_number(last[0]) + step * k), *last[1:]] for k in range(1, 200))
    parting = rng.choice([",", ",", ",", ";", "\t"])
    return rng.choice(["\n", "\r\n"]).join(parting.join(row) for row in rows).encode()


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return 1.0
