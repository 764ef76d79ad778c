"""Settings files spoiled at random: bytes, lines, values of any type and size, deep nesting."""

from __future__ import annotations

import random

from app.settings.config import to_toml
from app.settings.sections import Config

VALUES = [
    "0",
    "-1",
    "1",
    "2",
    "77",
    "1e308",
    "-1e308",
    "5e-324",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "99999999999999999999999999",
    "0x7fffffff",
    "true",
    "false",
    '""',
    '"nan"',
    '"../../etc"',
    "[]",
    "[1]",
    "[1,2]",
    "[1,2,3]",
    "[[1,2],[3,4]]",
    "[[1,2],[3]]",
    '["a","b"]',
    "{}",
    "{a=1}",
    "1979-05-27",
    "1979-05-27T07:32:00Z",
    "07:32:00",
    '"\\u0000"',
    "'\\'",
    '"\\U0010ffff"',
    "0.1",
    "100",
    '"sim"',
    '"replay"',
    '"folder"',
    '"\\u001b[2J"',
    "65535",
    "65536",
    "1e9",
    "-0.0",
]


def spoil_settings(rng: random.Random) -> bytes:
    """The content of a settings file."""
    how = rng.choice([_values, _values, _values, _lines, _bytes, _random_bytes, _nested, _long])
    return how(rng)


def _values(rng: random.Random) -> bytes:
    """A few options with other values, so that one alone is at fault now and then."""
    tables: dict[str, list[str]] = {}
    for line in to_toml(Config()).splitlines():
        if line.startswith("["):
            tables[line] = []
        elif line and not line.startswith("#"):
            tables[list(tables)[-1]].append(line.partition(" = ")[0])
    chosen = rng.sample(
        [(table, name) for table, names in tables.items() for name in names],
        rng.choice([1, 1, 2, 3, 10]),
    )
    texts = {
        table: [f"{name} = {rng.choice(VALUES)}" for at, name in chosen if at == table]
        for table in tables
    }
    return "\n".join("\n".join([table, *lines]) for table, lines in texts.items() if lines).encode()


def _lines(rng: random.Random) -> bytes:
    lines = to_toml(Config()).splitlines()
    for _ in range(rng.randint(1, 5)):
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[a] = rng.choice(
            [lines[b], lines[a][: rng.randrange(1 + len(lines[a]))], lines[a] + lines[b], ""]
        )
    return "\n".join(lines).encode()


def _bytes(rng: random.Random) -> bytes:
    content = bytearray(to_toml(Config()).encode())
    for _ in range(rng.randint(1, 10)):
        content[rng.randrange(len(content))] = rng.randrange(256)
    return bytes(content)


def _random_bytes(rng: random.Random) -> bytes:
    start = rng.choice([b"", b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf", b"[run]\n"])
    return start + rng.randbytes(rng.randint(0, 300))


def _nested(rng: random.Random) -> bytes:
    depth = rng.choice([3, 200, 2000, 100_000])
    text = rng.choice(
        [
            f"a = {'[' * depth}{']' * depth}",
            f"a = {'{a=' * depth}1{'}' * depth}",
            f"[{'.'.join('a' * depth)}]",
        ]
    )
    return f"{rng.choice(['', '[run]', '[forces]'])}\n{text}\n".encode()


def _long(rng: random.Random) -> bytes:
    length = rng.choice([1000, 5000, 10**6])
    word = rng.choice(["9", "x", "é"]) * length
    texts = [
        f"[run]\n{word} = 1",
        f"[run]\nnormal_force = {word}",
        f"[{word}]",
        f'[camera]\ndevice = "{word}"',
        f"[run]\ntravel = 1e{word}",
    ]
    return rng.choice(texts).encode()
