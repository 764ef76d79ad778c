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

from app.session.files import images_of
from app.session.journal import StoredFrame, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from drivers.protocols import Frame

SHAPE = (120, 160)
N = 20
IMAGES = [np.random.default_rng(n).integers(90, 130, SHAPE, np.uint8) for n in range(N)]


def record(path: Path) -> SessionRecorder:
    writer = make_writer(path, frame_shape=SHAPE, compression="gzip")
    for index, image in enumerate(IMAGES):
        writer.append(Frame(index, 5 + 125 * index, image))
    writer.flush()
    return writer


def cut_short(path: Path) -> None:
    for file in record(path)._files:
        file.close()


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


def test_all_comes_back_from_the_journal(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    cut_short(path)
    assert repair(path, tmp_path / "b.h5").found.is_whole
    assert_all_there(tmp_path / "b.h5")


@pytest.mark.parametrize("by", ["journal", "file"])
def test_an_image_whose_bytes_have_changed_is_lost_and_no_other(tmp_path: Path, by: str) -> None:
    path = tmp_path / "a.h5"
    if by == "file":
        record(path).close()
        with h5py.File(path) as file:
            chunk = file["entry/instrument/camera/data"].id.get_chunk_info_by_coord((7, 0, 0))
        held, place = path, chunk.byte_offset + chunk.size // 2
    else:
        cut_short(path)
        found = [r for r in read_journal(journal_of(path)) if isinstance(r, StoredFrame)]
        stored = next(r for r in found if r.index == 7)
        held, place = images_of(path), stored.place + stored.nbytes // 2
    with held.open("r+b") as file:
        file.seek(place)
        file.write(bytes(64))
    repaired = repair(path, tmp_path / "b.h5")
    assert repaired.found.torn == 1
    with SessionReader(tmp_path / "b.h5") as reader:
        assert [index for index, _, _ in reader.lost_frames()] == [7]
        assert crc32(reader.frame(8)[2].data) == crc32(IMAGES[8].data)
