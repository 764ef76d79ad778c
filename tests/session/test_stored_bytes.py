"""The bytes of a dataset are what HDF5 makes of them, and nothing is taken that is not there."""

from __future__ import annotations

import sys
import weakref
import zlib
from concurrent.futures import ThreadPoolExecutor
from io import FileIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from spoiled import bomb

from app.session.contents import Held, contents_of
from app.session.dataset_bytes import SLACK_BYTES, Dataset
from app.session.layout import BY_PATH

PATH = "/entry/fields/ux"
assert PATH in BY_PATH


def opened(path: Path) -> Dataset:
    return of(path, contents_of(path).datasets[PATH])


def of(path: Path, held: Held) -> Dataset:
    file = FileIO(path)
    try:
        dataset = Dataset(file, path.stat().st_size, PATH, held)
    except ValueError:
        file.close()
        raise
    weakref.finalize(dataset, file.close)
    return dataset


@pytest.mark.slow
@settings(
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(data=st.data())
def test_any_rows_of_any_dataset_are_those_of_hdf5(data: st.DataObject, tmp_path: Path) -> None:
    shape = tuple(data.draw(st.lists(st.integers(0, 9), min_size=1, max_size=3), label="shape"))
    kind = data.draw(st.sampled_from(["f4", "f8", ">f8", "u1", "<u2", "i8"]), label="type")
    how: dict[str, Any] = {}
    if data.draw(st.booleans(), label="chunked"):
        sides = st.tuples(*(st.integers(1, 5) for _ in shape))
        how = {"chunks": data.draw(sides, label="chunks"), "maxshape": (None,) * len(shape)}
        for one in ("fletcher32", "shuffle"):
            how[one] = data.draw(st.booleans(), label=one)
        how["compression"] = data.draw(st.sampled_from([None, "gzip"]), label="compression")
        how["fillvalue"] = data.draw(st.sampled_from([None, 3]), label="fill")
    values = np.random.default_rng(3).integers(0, 99, shape).astype(kind)
    path = tmp_path / "d.h5"
    with h5py.File(path, "w", libver=("v108", data.draw(st.sampled_from(["v108", "latest"])))) as f:
        dataset = f.create_dataset(PATH, shape, kind, **how)
        if data.draw(st.booleans(), label="whole"):
            dataset[...] = values
        elif shape[0]:
            dataset[: shape[0] // 2] = values[: shape[0] // 2]
    first, end = sorted(data.draw(st.tuples(*[st.integers(0, shape[0])] * 2), label="rows"))
    read = opened(path)
    with h5py.File(path) as file:
        for rows in ((), slice(first, end)):
            found, wanted = read[rows], file[PATH][rows]
            assert (found.dtype, found.shape) == (wanted.dtype, wanted.shape)
            np.testing.assert_array_equal(found, wanted)


def held_in(path: Path, content: bytes, **about: Any) -> Dataset:
    """A dataset of one chunk with that content."""
    places = np.array([0] * len(about["shape"]) + [0, 0, len(content)], np.int64).tobytes()
    held = Held(**{"chunks": about["shape"], "places": places, **about})
    path.write_bytes(content)
    return of(path, held)


@pytest.mark.parametrize(
    ("content", "filters"),
    [
        (None, (1,)),  # a bomb: it says it holds 8 bytes
        (zlib.compress(bytes(4)), (1,)),
        (zlib.compress(bytes(8))[:-3], (1,)),
        (b"12345678", (1,)),
        (b"12345678\0\0\0\0", (3,)),
        (b"1", (3,)),
        (b"123456", ()),
    ],
)
def test_a_chunk_that_is_not_what_it_says(
    tmp_path: Path, content: bytes | None, filters: tuple[int, ...]
) -> None:
    dataset = held_in(tmp_path / "d", content or bomb(), shape=(8,), filters=filters)
    with pytest.raises(ValueError, match="not those that were written"):
        dataset[()]


def test_claims_are_held_against_what_is_stored(tmp_path: Path) -> None:
    path = tmp_path / "d"
    with pytest.raises(ValueError, match="it claims the shape"):
        held_in(path, bytes(8), shape=(SLACK_BYTES + 9,), chunks=(8,))[()]
    with pytest.raises(ValueError, match="it claims chunks"):
        held_in(path, bytes(8), shape=(8,), chunks=(1 << 29,))
    with pytest.raises(ValueError, match="it claims chunks"):
        held_in(path, bytes(8), shape=(8,), chunks=(8, 1), places=b"")
    for place in ((0, 0, 1, 8), (0, 0, -1, 8), (0, 0, 0, -8), (0, 0, 1 << 62, 1 << 62)):
        with pytest.raises(ValueError, match="beyond the end"):
            held_in(path, bytes(8), shape=(8,), places=np.array(place, np.int64).tobytes())


def test_threads_read_at_once(tmp_path: Path) -> None:
    """They share the position of the file, as forked processes do, and the chunk read last."""
    path = tmp_path / "d.h5"
    values = np.arange(64.0)[:, None] * np.ones(500)
    with h5py.File(path, "w") as file:
        file.create_dataset(PATH, data=values, chunks=(2, 500))
    read, interval = opened(path), sys.getswitchinterval()

    def count_wrong(first: int) -> int:
        rows = [n % 64 for n in range(first, first + 1200)]
        return sum(not (read[n] == n).all() for n in rows)

    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(3) as pool:
            assert sum(pool.map(count_wrong, (0, 21, 42))) == 0
    finally:
        sys.setswitchinterval(interval)


def test_a_whole_chunk_is_the_callers(tmp_path: Path) -> None:
    """Also one that was kept from a read of a part of it."""
    path = tmp_path / "d.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset(PATH, data=np.arange(4.0), chunks=(2,))
    read = opened(path)
    assert read[0] == 0.0
    read[:2][:] = 9.0
    assert read[1] == 1.0
