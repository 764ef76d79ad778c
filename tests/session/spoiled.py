"""Sessions spoiled at random, by a seed: bytes as a bad disk or a torn copy leaves them, and
structure as somebody of ill will makes it.
"""

from __future__ import annotations

import functools
import random
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np

from app.session.reader import SessionReader
from app.system.errors import UserError
from slipscope import Session

PAGE = 512


def spoil(whole: Path, path: Path, seed: int) -> str:
    """Write a spoiled copy of a session to `path`; the name of what was done to it."""
    rng = random.Random(seed)
    how = rng.choice([*BYTES, *STRUCTURE])
    content = bytearray(whole.read_bytes())
    if how in BYTES:
        BYTES[how](content, rng)
    path.write_bytes(content)
    if how in STRUCTURE:
        with h5py.File(path, "r+", libver=("v108", "v108")) as file:
            for _ in range(rng.choice([1, 1, 1, 2, 5])):
                # nothing is left that could be spoiled so
                with suppress(IndexError, ValueError, RuntimeError, TypeError, OSError):
                    STRUCTURE[how](file, rng)
    return how


def ask(path: Path) -> None:
    """Ask everything that a session can be asked."""
    with SessionReader(path) as read:
        for name in dir(SessionReader):
            thing = None if name.startswith("_") else getattr(read, name)
            if callable(thing) and name not in {
                "close",
                "dataset",
                "frame",
                "has",
                "image_row",
                "snapshot",
            }:
                answer = thing()
                if isinstance(answer, Iterator):
                    deque(answer, maxlen=1)
    with Session(path) as session:
        for name in dir(Session):
            if not name.startswith("_"):
                getattr(session, name)
        for part in (session.frames, session.fields):
            for n in range(min(3, len(part))):
                with suppress(UserError):
                    part[n]


def _place(content: bytearray, rng: random.Random) -> int:
    """A byte that is not zero: most of a small file is empty chunks."""
    used = np.flatnonzero(np.frombuffer(bytes(content), np.uint8))
    return int(used[rng.randrange(len(used))])


def _flip_bits(content: bytearray, rng: random.Random) -> None:
    for _ in range(rng.randint(1, 8)):
        content[_place(content, rng)] ^= 1 << rng.randrange(8)


def _change_bytes(content: bytearray, rng: random.Random) -> None:
    for _ in range(rng.randint(1, 40)):
        content[_place(content, rng)] = rng.randrange(256)


def _fill(content: bytearray, rng: random.Random, value: bytes, longest: int) -> None:
    start = _place(content, rng)
    end = min(len(content), start + 2 ** rng.randint(0, longest))
    content[start:end] = value * (end - start)


def _random_page(content: bytearray, rng: random.Random) -> None:
    start = _place(content, rng) // PAGE * PAGE
    page = content[start : start + PAGE]
    content[start : start + PAGE] = rng.randbytes(len(page))


def _swap_pages(content: bytearray, rng: random.Random) -> None:
    a, b = (_place(content, rng) // PAGE * PAGE for _ in "ab")
    if max(a, b) + PAGE <= len(content):
        content[a : a + PAGE], content[b : b + PAGE] = content[b : b + PAGE], content[a : a + PAGE]


def _cut(content: bytearray, rng: random.Random) -> None:
    del content[rng.randrange(len(content)) :]


def _forge_header(content: bytearray, rng: random.Random) -> None:
    """Change bytes of an object's header and make its checksum right again, as only ill will
    does.
    """
    headers = [at for at in range(len(content)) if content.startswith(b"OHDR\x02", at)]
    for at in rng.sample(headers, min(len(headers), rng.choice([1, 1, 3]))):
        flags = content[at + 5]
        width = 1 << (flags & 3)
        start = at + 6 + (16 if flags & 32 else 0) + (4 if flags & 16 else 0)
        end = start + width + int.from_bytes(content[start : start + width], "little")
        for _ in range(rng.randint(1, 4)):
            content[rng.randrange(start + width, end)] = rng.choice(
                [0, 1, 2, 3, 4, 8, 16, 127, 128, 254, 255, rng.randrange(256)]
            )
        content[end : end + 4] = struct.pack("<I", lookup3(bytes(content[at:end])))


BYTES: dict[str, Callable[[bytearray, random.Random], None]] = {
    "bits": _flip_bits,
    "bytes": _change_bytes,
    "zeroed": lambda content, rng: _fill(content, rng, b"\0", 12),
    "filled": lambda content, rng: _fill(content, rng, b"\xff", 5),
    "page": _random_page,
    "swapped pages": _swap_pages,
    "cut": _cut,
    "forged header": _forge_header,
}


def _paths(file: h5py.File) -> list[str]:
    found: list[str] = []
    file.visit(found.append)
    return [path for path in sorted(found) if isinstance(file.get(path), h5py.Dataset)]


def _put(file: h5py.File, rng: random.Random, make: Callable[[str], object]) -> None:
    path = rng.choice(_paths(file))
    del file[path]
    make(path)


def _remove(file: h5py.File, rng: random.Random) -> None:
    path = rng.choice(_paths(file))
    del file[rng.choice([path, path.rpartition("/")[0]])]


def _other_kind(file: h5py.File, rng: random.Random) -> None:
    kinds = [
        "u1",
        "i4",
        ">f8",
        "f4",
        "S9",
        "c16",
        [("a", "f8"), ("b", "i4")],
        h5py.ref_dtype,
        h5py.string_dtype(),
        "f8",
        "i8",
    ]
    kind, shape = (
        np.dtype(rng.choice(kinds)),
        rng.choice([(), (0,), (1,), (2,), (7,), (2, 3), (1, 1, 1), (4, 12, 16)]),
    )
    _put(file, rng, lambda path: file.create_dataset(path, shape, kind))


def _exchange(file: h5py.File, rng: random.Random) -> None:
    a, b = rng.sample(_paths(file), 2)
    file.move(a, "/kept")
    file.move(b, a)
    file.move("/kept", b)


def _odd_value(file: h5py.File, rng: random.Random) -> None:
    dataset = file[rng.choice(_paths(file))]
    if dataset.dtype.kind == "O":
        long = "x" * rng.choice([10, 10**5])
        value: object = rng.choice(
            [
                "",
                "\x1b[2J\x07",
                "[run]\nnormal_force = -1",
                "{" * 900,
                '{"cpu_s": NaN}',
                "[1]",
                "drive",
                long,
                "\u202e",
            ]
        )
    elif dataset.dtype.kind == "f":
        value = rng.choice([float("nan"), float("inf"), -float("inf"), -1.0, 0.0, 1e308, 5e-324])
    else:
        value = rng.choice([np.iinfo(dataset.dtype).max, np.iinfo(dataset.dtype).min, 0, 1, 77])
    if dataset.shape == ():
        dataset[()] = value
    elif dataset.size:
        dataset[rng.randrange(dataset.shape[0])] = value


def _lengthen(file: h5py.File, rng: random.Random) -> None:
    dataset = file[rng.choice([path for path in _paths(file) if file[path].chunks])]
    if dataset.shape[0] > 10**6:
        return  # to make it shorter again HDF5 would look for every chunk of it
    dataset.resize(rng.choice([0, 1, dataset.shape[0] + 1, 10**6, 2**40]), axis=0)


def _link(file: h5py.File, rng: random.Random) -> None:
    target = rng.choice(
        [
            h5py.SoftLink("/"),
            h5py.SoftLink("/entry"),
            h5py.SoftLink("/nowhere"),
            h5py.ExternalLink("/etc/hostname", "/"),
            file["/entry"],
        ]
    )
    path = rng.choice(_paths(file))
    path = rng.choice([path, path.rpartition("/")[0]])
    if path != "entry":
        del file[path]
        file[path] = target


def _compressed(file: h5py.File, rng: random.Random) -> None:
    path = rng.choice(
        [path for path in _paths(file) if file[path].chunks and file[path].dtype.kind != "O"]
    )
    old = file[path]
    chunks, dtype = old.chunks, old.dtype
    del file[path]
    how = rng.choice(
        [
            {"compression": "gzip"},
            {"compression": "lzf"},
            {"scaleoffset": 4},
            {"fletcher32": True},
            {"shuffle": True},
        ]
    )
    bomb = (
        {"shape": (2**28,), "chunks": (2**28,)}
        if len(chunks) == 1 and rng.random() < 0.2
        else {"shape": chunks, "chunks": chunks}
    )
    file.create_dataset(
        path,
        dtype=dtype,
        **bomb,
        **(how if np.dtype(dtype).kind != "f" else {"compression": "gzip"}),
    )


def _odd_attribute(file: h5py.File, rng: random.Random) -> None:
    """Another type or value of an attribute, or a new one that SlipScope reads elsewhere."""
    at = file[rng.choice(["/", "/entry", *_paths(file)])].attrs
    name = rng.choice([*at, "units", "NX_class", "default", "offset", "vector"])
    values: list[object] = [
        *(0, -1, 4, 10**9, 2**63 - 1, 1e308, float("nan"), True, "", "x" * 60_000, "\x1b[2J"),
        *(b"\xff\xfe", np.zeros((3, 0)), np.full(999, np.nan), np.array(["a", "b"], "S1")),
        *(np.zeros(1, [("a", "f8"), ("b", "i4")]), file.ref, h5py.Empty("f8")),
    ]
    at.create(name, rng.choice(values))


def _sparse(file: h5py.File, rng: random.Random) -> None:
    """Sizes of terabytes of which nothing is there."""
    path = rng.choice(_paths(file))
    ndim, dtype = max(1, file[path].ndim), file[path].dtype
    shape = tuple(rng.choice([1, 3, 2**16, 2**31, 2**40]) for _ in range(ndim))
    chunks = rng.choice([None, (1,) * ndim, tuple(min(n, 2**20) for n in shape)])
    if rng.random() < 0.5:  # the rest as it was
        shape, chunks = (rng.choice([2**20, 2**31, 2**40]), *file[path].shape[1:]), True
    _put(file, rng, lambda other: file.create_dataset(other, shape, dtype, chunks=chunks))


def _odd_column(file: h5py.File, rng: random.Random) -> None:
    """A whole table's column of odd, reversed or negative numbers."""
    column = file[rng.choice([path for path in _paths(file) if file[path].dtype.kind in "fiu"])]
    if column.shape == () or column.size > 10**6:
        return
    values = column[()]
    # numbers that the type cannot hold wrap, as they do in C
    with np.errstate(all="ignore"):
        odd = np.array(rng.choice([-1.0, 0.0, 1e308, np.nan, np.inf, 1e9])).astype(values.dtype)
        column[()] = rng.choice(
            [values[::-1], np.full_like(values, odd), -values, values * 0 + odd]
        )


def _odd_text(file: h5py.File, rng: random.Random) -> None:
    """Settings, JSON and notes that are of another kind than they should be."""
    texts = [path for path in _paths(file) if h5py.check_string_dtype(file[path].dtype)]
    text = file[rng.choice(texts)]
    value = rng.choice(
        [
            *("null", "[]", "{}", '{"cpu_s": []}', '{"cpu_s": 1e999}', '{"a": {"b": [1, null]}}'),
            "[camera]\nwidth = 16384\nheight = 16384\n",
            "[camera]\nexposure = 3e8\n",
            '[sim]\nlaw_table = "http://127.0.0.1:9/x"\n',
            '[actuator]\nport = "spy://loop://?file=/tmp/spied"\n',
            "[dic]\nbox = 1000000\nstep = 1\n",
            "a\0b",
            "=1+1",
            "x" * 10**6,
            '{"a":' * 5000 + "1" + "}" * 5000,
        ]
    )
    if text.shape == ():
        text[()] = value
    elif text.size:
        text[rng.randrange(len(text))] = value


def _bomb(file: h5py.File, rng: random.Random) -> None:
    """Images of which each is a few kilobytes that become a gigabyte."""
    path = "/entry/instrument/camera/data"
    if path not in file:
        return
    rows, dtype = len(file[path]), file[path].dtype
    shape = rng.choice([file[path].shape[1:], (2**15, 2**15)])
    _put_at(file, path, (max(1, rows), *shape), (1, *shape), dtype)
    for row in range(min(rows, 3)):
        file[path].id.write_direct_chunk((row, 0, 0), bomb())


def _put_at(file: h5py.File, path: str, shape: object, chunks: object, dtype: object) -> None:
    del file[path]
    file.create_dataset(path, shape, dtype, chunks=chunks, compression="gzip")


@functools.cache
def bomb() -> bytes:
    """256 MB of zeros, compressed."""
    return zlib.compress(bytes(1 << 28), 9)


STRUCTURE: dict[str, Callable[[h5py.File, random.Random], None]] = {
    "removed": _remove,
    "other kind": _other_kind,
    "exchanged": _exchange,
    "odd value": _odd_value,
    "lengthened": _lengthen,
    "link": _link,
    "compressed": _compressed,
    "odd attribute": _odd_attribute,
    "sparse": _sparse,
    "odd column": _odd_column,
    "odd text": _odd_text,
    "bomb": _bomb,
}


def lookup3(data: bytes) -> int:
    """Jenkins' hash of HDF5's metadata, of which a changed header needs a new one."""
    mask = 0xFFFFFFFF

    def turned(x: int, k: int) -> int:
        return ((x << k) | (x >> (32 - k))) & mask

    a = b = c = (0xDEADBEEF + len(data)) & mask
    if not data:
        return c
    blocks = [data[n : n + 12] for n in range(0, len(data), 12)]
    for block in blocks[:-1]:
        x, y, z = struct.unpack("<3I", block)
        a, b, c = (a + x) & mask, (b + y) & mask, (c + z) & mask
        for k in (4, 6, 8, 16, 19, 4):
            a = ((a - c) & mask) ^ turned(c, k)
            a, b, c = b, (c + b) & mask, a
    x, y, z = struct.unpack("<3I", blocks[-1].ljust(12, b"\0"))
    a, b, c = (a + x) & mask, (b + y) & mask, (c + z) & mask
    for k in (14, 11, 25, 16, 4, 14, 24):
        a, b, c = b, ((c ^ b) - turned(b, k)) & mask, a
    return b
