"""Films of displacement fields: pictures, colours, signs, and no half file."""

from __future__ import annotations

import errno
import gc
import math
import os
import weakref
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from matplotlib import colormaps
from PIL import Image
from session_material import OUTCOME, SHAPE, finish, make_snapshot, make_writer

from app.files import film
from app.files.exporting import export
from app.records.record_types import DisplacementField, FrameMotion, Snapshot
from app.report.figures import HEADROOM
from app.system.errors import UserError
from drivers.protocols import Frame

X, Y = np.arange(1.5, 14.0, 2.0), np.arange(1.5, 10.0, 2.0)
PIXEL_UM, COUNT, LENS_UM = 7.04, 6, 20.0
PLAYED_BY_BROWSERS = ", VP9, for browsers and VLC; PowerPoint may need a .gif"
LEFT, RIGHT = (0.2, 0.3), (0.7, 0.3)  # of a picture, from its upper left corner


def snapshot_of(frame: int, *, angle: float = 0.0) -> Snapshot:
    """A field of `frame` pixels in the left half and of -1 px in the right half along x; twice as
    much the other way along y. The lens has moved along the drive.
    """
    u = np.where(np.arange(len(X)) < len(X) // 2, float(frame), -1.0)
    ux = np.broadcast_to(u, (len(Y), len(X))).astype(np.float32)
    zero, ok = np.zeros_like(ux), np.zeros(ux.shape, np.uint8)
    made = make_snapshot(frame, rings=0)
    field = DisplacementField(ux, -2 * ux, zero, zero, zero + 1, ok)
    motion = FrameMotion(LENS_UM * 1e-6, 0.0, 0.0, angle)
    return replace(made, field=field, motion=motion, stick=None, traction=None)


def session_at(path: Path, *, count: int = COUNT, angle: float = 0.0) -> Path:
    writer = make_writer(path, grid_x_px=X, grid_y_px=Y)
    for frame in range(1, count + 1):
        writer.append(Frame(frame, 5 + 125 * frame, np.zeros(SHAPE, np.uint8)))
        writer.append(snapshot_of(frame, angle=angle))
    finish(writer)
    return path


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return session_at(tmp_path_factory.mktemp("film") / "run.h5")


def pictures_of(path: Path) -> list[np.ndarray]:
    """The pictures of a film, shape (rows, columns, 3), as another program decodes them."""
    if path.suffix == ".gif":
        with Image.open(path) as image:
            return [_frame(image, n) for n in range(image.n_frames)]
    film, found = cv2.VideoCapture(str(path)), []
    while (read := film.read())[0]:
        found.append(read[1][..., ::-1])
    return found


def _frame(image: Image.Image, n: int) -> np.ndarray:
    image.seek(n)
    return np.asarray(image.convert("RGB"))


def _duration_ms(image: Image.Image, n: int) -> float:
    image.seek(n)
    return float(image.info["duration"])


def pixel(picture: np.ndarray, place: tuple[float, float]) -> np.ndarray:
    x, y = place
    return picture[round(y * picture.shape[0]), round(x * picture.shape[1])].astype(int)


def read_on_the_bar(picture: np.ndarray, place: tuple[float, float]) -> float:
    """The height on the colour bar of the colour at a place, 0 at its lower and 1 at its upper
    end.
    """
    right = picture[:, round(0.85 * picture.shape[1]) :].astype(int)
    varied = np.array([len(np.unique(column, axis=0)) for column in right.swapaxes(0, 1)])
    inside = np.flatnonzero(varied > 0.7 * varied.max())
    column = right[:, inside[len(inside) // 2]]
    is_bar = np.ptp(column, axis=1) > 12  # its frame and the page are grey
    first, last = np.flatnonzero(is_bar)[[0, -1]]
    bar = column[first : last + 1]
    nearest = np.abs(bar - pixel(picture, place)).sum(axis=1)
    return 1 - float(np.argmin(nearest)) / (len(bar) - 1)


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_has_a_picture_of_each_field_in_the_time_of_the_run(
    session: Path, ending: str, tmp_path: Path
) -> None:
    told = export(session, path := tmp_path / f"film{ending}")
    assert f"film of {COUNT} fields, 8 images/s, 1 times as fast as the run" in told
    pictures = pictures_of(path)
    assert len(pictures) == COUNT
    assert all(picture.shape == pictures[0].shape for picture in pictures)
    assert all((one != other).any() for one, other in pairwise(pictures))
    if ending == ".gif":
        with Image.open(path) as image:
            assert image.info["duration"] == 120  # of 125 ms, in steps of 10 ms
            shown_ms = [_duration_ms(image, n) for n in range(COUNT)]
            assert np.cumsum(shown_ms) == pytest.approx(125 * np.arange(1, COUNT + 1), abs=5)
    else:
        film = cv2.VideoCapture(str(path))
        assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(8)
        coding = int(film.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode().lower()
        assert told.endswith(", H.264" if coding in ("avc1", "h264") else PLAYED_BY_BROWSERS)
        assert coding in ("avc1", "h264", "vp90")
    export(session, path, frames="2:4", overwrite=True)
    assert len(pictures_of(path)) == 2


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_the_colour_of_a_displacement_is_that_of_the_bar(
    session: Path, ending: str, tmp_path: Path
) -> None:
    export(session, path := tmp_path / f"film{ending}", "ux")
    low, high = -PIXEL_UM - LENS_UM, HEADROOM * (COUNT * PIXEL_UM - LENS_UM)
    for n, picture in enumerate(pictures_of(path), 1):
        for place, ux_px in ((LEFT, n), (RIGHT, -1)):
            share = (ux_px * PIXEL_UM - LENS_UM - low) / (high - low)
            assert read_on_the_bar(picture, place) == pytest.approx(share, abs=0.02)
            if ending == ".gif":
                rgb = 255 * np.array(colormaps["viridis"](share)[:3])
                assert pixel(picture, place) == pytest.approx(rgb, abs=6)


def test_u_y_has_colours_about_zero_and_the_lens_moves_with_the_drive(tmp_path: Path) -> None:
    along_y = session_at(tmp_path / "down.h5", angle=math.pi / 2)
    export(along_y, path := tmp_path / "film.gif", "uy")
    last = pictures_of(path)[-1]
    end = 2 * COUNT * PIXEL_UM + LENS_UM
    for place, uy_px in ((LEFT, -2 * COUNT), (RIGHT, 2)):
        share = 0.5 + (uy_px * PIXEL_UM - LENS_UM) / end / 2
        assert read_on_the_bar(last, place) == pytest.approx(share, abs=0.02)
    assert pixel(last, LEFT)[2] > pixel(last, LEFT)[0] + 50  # negative: blue


@pytest.mark.slow
def test_one_field_at_a_time_is_in_memory(tmp_path: Path) -> None:
    scene = film.FilmScene(X, Y, "u", (0.0, 1.0), False, math.nan, 8.0)
    alive: list[weakref.ref[np.ndarray]] = []

    def shots():  # type: ignore[no-untyped-def]
        for frame in range(1, 6):
            values = np.full((len(Y), len(X)), frame / 6)
            alive.append(weakref.ref(values))
            yield snapshot_of(frame), values
            gc.collect()
            assert sum(one() is not None for one in alive) <= 2

    film.write_film(tmp_path / "film.gif", scene, shots())
    assert len(alive) == 5


def broken(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    """Let the third picture fail."""
    drawn: Callable[..., np.ndarray] = film._Picture.of

    def of(self, snapshot: Snapshot, values: np.ndarray) -> np.ndarray:
        if snapshot.frame == 3:
            raise error
        return drawn(self, snapshot, values)

    monkeypatch.setattr(film._Picture, "of", of)


@pytest.mark.parametrize("ending", [".mp4", ".gif"])
def test_a_film_that_is_interrupted_leaves_what_was_there(
    session: Path, ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"film{ending}"
    path.write_bytes(b"mine")
    broken(monkeypatch, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        export(session, path, overwrite=True)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"mine"


def no_room(path: Path, content: bytes) -> None:
    """As a full disk answers."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_what_cannot_be_written_is_refused_in_a_sentence(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UserError, match=r"summary cannot be written so; '.mp4' takes ux, uy"):
        export(session, tmp_path / "film.mp4", "summary")
    with pytest.raises(UserError, match="no displacement field was measured"):
        export(session, tmp_path / "film.mp4", frames="90:95")
    with pytest.raises(UserError, match="does not exist"):
        export(session, tmp_path / "none" / "film.gif")
    with monkeypatch.context() as full:
        full.setattr(cv2, "VideoWriter", Mock())  # as on a full disk: writes nothing, says nothing
        with pytest.raises(UserError, match=r"film\.mp4: .* it holds only 0 of 6 pictures,"):
            export(session, tmp_path / "film.mp4")
    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", no_room)
        with pytest.raises(UserError, match=r"film\.mp4: it cannot be written: No space left"):
            export(session, tmp_path / "film.mp4")
    thin = make_writer(tmp_path / "thin.h5", grid_x_px=X[:1], grid_y_px=Y)
    thin.append(Frame(1, 130, np.zeros(SHAPE, np.uint8)))
    wide = snapshot_of(1)
    assert wide.field is not None
    parts = (getattr(wide.field, one.name)[:, :1] for one in fields(wide.field))
    thin.append(replace(wide, field=DisplacementField(*parts)))
    thin.append(OUTCOME)
    thin.close()
    with pytest.raises(UserError, match="two boxes or more along x and y"):
        export(tmp_path / "thin.h5", tmp_path / "film.gif")
    (tmp_path / "thin.h5").unlink()
    monkeypatch.setattr(cv2.VideoWriter, "fourcc", lambda *_: 0x1)
    with pytest.raises(UserError, match=r"cannot encode MP4 .*; give a name that ends in .gif"):
        export(session, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())
