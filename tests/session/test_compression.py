"""Images that are compressed by the filter that every HDF5 program has: the same pictures, in less
room, also after a crash.
"""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import h5py
import numpy as np
import pytest
from session_material import make_writer

from app.records import ReceivedFrame
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.repair import repair
from app.session.writer import SessionWriter

SHAPE = (120, 160)
N = 20
IMAGES = [np.random.default_rng(n).integers(90, 130, SHAPE, np.uint8) for n in range(N)]


def record(path: Path) -> SessionWriter:
    writer = make_writer(path, frame_shape=SHAPE, compression="gzip")
    for index, image in enumerate(IMAGES):
        writer.append(ReceivedFrame(index, 5 + 125 * index, image))
    writer.flush()
    return writer


def cut_short(path: Path) -> None:
    writer = record(path)
    for thing in (writer._file, writer._on_disk, writer._journal):
        thing.close()


def assert_all_there(path: Path) -> None:
    with SessionReader(path) as reader:
        assert reader.header.compression == "gzip"
        for (_, _, found), image in zip(reader.frames(), IMAGES, strict=True):
            np.testing.assert_array_equal(found, image)


def test_pictures_are_the_same_in_less_room(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    record(path).close()
    assert_all_there(path)
    with h5py.File(path) as file:
        data = file["entry/instrument/camera/data"]
        np.testing.assert_array_equal(data[7], IMAGES[7])
        assert data.id.get_storage_size() < 0.8 * N * IMAGES[0].nbytes
    assert verify(path).frames == N


@pytest.mark.parametrize("is_hdf5", [True, False])
def test_all_comes_back_from_the_journal(tmp_path: Path, is_hdf5: bool) -> None:
    path = tmp_path / "a.h5"
    cut_short(path)
    if not is_hdf5:
        with path.open("r+b") as file:
            file.write(bytes(512))
    assert repair(path, tmp_path / "b.h5").torn == 0
    assert_all_there(tmp_path / "b.h5")


@pytest.mark.parametrize("by", ["journal", "file"])
def test_an_image_whose_bytes_have_changed_is_lost_and_no_other(tmp_path: Path, by: str) -> None:
    path = tmp_path / "a.h5"
    cut_short(path)
    if by == "file":
        (tmp_path / "a.h5.journal").unlink()
        with h5py.File(path, "r+") as file:
            file["entry/run/state"][()] = "done"
    with h5py.File(path) as file:
        chunk = file["entry/instrument/camera/data"].id.get_chunk_info_by_coord((7, 0, 0))
    with path.open("r+b") as file:
        file.seek(chunk.byte_offset + chunk.size // 2)
        file.write(bytes(64))
    repaired = repair(path, tmp_path / "b.h5")
    assert repaired.torn == 1
    with SessionReader(tmp_path / "b.h5") as reader:
        assert [index for index, _, _ in reader.lost_frames()] == [7]
        assert crc32(reader.frame(8)[2].data) == crc32(IMAGES[8].data)
