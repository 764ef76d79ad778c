"""A small session with everything in it, as values and as a file."""

from __future__ import annotations

import gzip
import shutil
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from app.records.record_types import (
    Conditions,
    ContactResult,
    Counts,
    DisplacementField,
    End,
    Event,
    FrameMotion,
    Header,
    Outcome,
    Phase,
    Position,
    Record,
    RingProfile,
    Samples,
    Snapshot,
    Stick,
    StressProfile,
    Traction,
)
from app.records.summary import Summary
from app.session.files import files_of
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.recorder import SessionRecorder
from drivers.protocols import Frame, LostFrame

SHAPE = (12, 16)
GRID_X, GRID_Y = np.array([4.5, 8.5, 12.5]), np.array([3.5, 7.5])
NAN = float("nan")
TOML = "[run]\nnormal_force = 0.5  # µ, ü and 力\n"
VERSIONS = {"slipscope": "0.1.0", "numpy": "2.0.0"}
SUMMARY = Summary(
    0.5,
    2e-3,
    1e-5,
    2.1e-3,
    31.25,
    NAN,
    0.47,
    0.94,
    0.01,
    NAN,
    (0.9, NAN),
    4.8e-6,
    ("µ_d: too short", "second note"),
    law_chi2=1.25,
    pressure_radius_m=(1e-4, 2e-4),
    pressure_pa=(5e4, NAN),
    pressure_sd_pa=(1e2, NAN),
    budget_inputs=("pixel", "k_T"),
    budget_quantities=("law_mu",),
    budget=(-0.01, 0.002),
)
COUNTS = Counts(8, 7, 7, 1, 6, 1, 1000, 3)
OUTCOME = Outcome(
    End.COMPLETE, "the travel is done", COUNTS, SUMMARY, {"peak_memory_mib": 123.4, "cpu_s": 1.5}
)
CONTACT = ContactResult(
    (7.25, 5.125),
    2.2e-3,
    NAN,
    (0.03, -0.01),
    np.array([1.0, 2.0, 3.5]),
    np.array([10.0, NAN, 12.0]),
)


def make_header(**changed: Any) -> Header:
    """The header of a session of small images, with anything changed by name."""
    header: dict[str, Any] = {
        "config_toml": TOML,
        "sample_rate_hz": 1000.0,
        "frame_shape": SHAPE,
        "frame_dtype": "uint8",
        "exposure_samples": 10,
        "divisor": 125,
        "first_trigger": 5,
        "pixel_m": 7.04e-6,
        "grid_x_px": GRID_X,
        "grid_y_px": GRID_Y,
        "versions": VERSIONS,
    }
    return Header(**(header | changed))


def make_writer(path: Path, *, overwrite: bool = False, **changed: Any) -> SessionRecorder:
    """A writer of small images, with anything of its header changed by name."""
    return SessionRecorder.create(path, make_header(**changed), overwrite=overwrite)


def make_snapshot(frame: int, *, field: bool = True, rings: int = 4) -> Snapshot:
    """Results of a frame with random bits and NaN in every place that may hold one; without a field
    only the conditions.
    """
    rng = np.random.default_rng(frame)
    shape = (len(GRID_Y), len(GRID_X)) if field else (0, 0)
    ux, uy, ux_std, uy_std, zncc = (rng.normal(size=shape).astype(np.float32) for _ in range(5))
    if field:
        ux[0, 1] = uy[0, 1] = ux_std[0, 1] = uy_std[0, 1] = zncc[0, 1] = np.nan
    ring_ux = rng.normal(size=rings)
    ring_ux[-1:] = np.nan
    conditions = Conditions(
        phase=Phase.DRIVE if field else Phase.BACKGROUND,
        time_s=frame / 8 if field else NAN,
        normal_force_n=float(rng.normal()),
        shear_force_n=0.1 * frame,
        travel_m=1e-6 * frame,
    )
    snapshot = Snapshot(frame, 5 + 125 * frame, conditions)
    if not field:
        return snapshot
    status = rng.integers(0, 5, shape, np.uint8)
    return replace(
        snapshot,
        motion=FrameMotion(1e-8 * frame, float(rng.normal()), 1e-9 * frame, 0.1 * frame),
        field=DisplacementField(ux, uy, ux_std, uy_std, zncc, status),
        rings=RingProfile(rng.uniform(size=rings), ring_ux, rng.uniform(size=rings)),
        stick=Stick(float(rng.uniform()), NAN, 1e4 + frame, 1.0 + frame),
        traction=Traction(1e-3 * frame, 2e-5, 3e-6 * frame, 1e-8, 0.11 * frame, NAN),
        stress=StressProfile(*(rng.normal(size=rings + 2) for _ in range(3))),
    )


@dataclass
class Session:
    """What was written."""

    path: Path
    volts: NDArray[np.float64]
    forces: NDArray[np.float64]
    images: dict[int, NDArray[np.uint8]]
    snapshots: list[Snapshot]
    events: list[Event]
    positions: list[tuple[int, float]]


def stamp_of(frame: int) -> float:
    """What the camera's clock gave to a frame, seconds."""
    return 1e6 + frame / 3


def record(
    path: Path, *, flush_each: bool = True, **changed: Any
) -> tuple[SessionRecorder, Session]:
    """A session of 8 triggers (3 is lost), 1000 samples with 3 missing, results of 6 frames, not
    yet finished.
    """
    rng = np.random.default_rng(7)
    written = Session(path, rng.normal(size=(1003, 2)), rng.normal(size=(1003, 2)), {}, [], [], [])
    written.volts[500:503] = written.forces[500:503] = np.nan
    writer = make_writer(path, **changed)
    blocks = [(0, 250), (250, 500), (503, 750), (750, 1003)]
    for frame in range(8):
        if frame % 2 == 0:
            first, end = blocks[frame // 2]
            writer.append(Samples(first, written.volts[first:end], written.forces[first:end]))
            written.positions.append((end, 1e-3 + 1e-7 * frame))
            writer.append(Position(*written.positions[-1]))
        if frame == 3:
            writer.append(LostFrame(3, 5 + 3 * 125, "no image within 0.5 s"))
            continue
        written.images[frame] = rng.integers(0, 256, SHAPE, np.uint8)
        image = written.images[frame]
        writer.append(Frame(frame, 5 + 125 * frame, image, stamp_s=stamp_of(frame)))
        if frame != 5:
            written.snapshots.append(
                make_snapshot(frame, field=frame > 1, rings=0 if frame < 2 else 3 + frame % 3)
            )
            writer.append(written.snapshots[-1])
        written.events.append(Event(125 * frame, "phase", f"phase {frame} µ"))
        writer.append(written.events[-1])
        if flush_each:
            writer.flush()
    return writer, written


def assert_same(path: Path, written: Session, lost: tuple[int, ...] = ()) -> None:
    """Everything measured is in the session at `path`, but for some images."""
    with SessionReader(path) as read:
        images = {index: image for index, _, image in read.frames()}
        assert images.keys() == written.images.keys() - set(lost)
        for index, image in images.items():
            assert_array_equal(image, written.images[index])
        assert_array_equal(read.forces().volts, written.volts)
        assert_array_equal(read.forces().forces, written.forces)
        assert read.gaps() == [(500, 3)]
        assert read.events() == written.events
        assert (
            list(zip(*(column.tolist() for column in read.positions()), strict=True))
            == written.positions
        )
        assert (3, 380, "no image within 0.5 s") in read.lost_frames()
        assert read.header.config_toml.startswith("[run]")


def finish(writer: SessionRecorder, *last: Record) -> None:
    """Give a session its last records and how the run ended, and close it."""
    for record_ in (*last, OUTCOME):
        writer.append(record_)
    writer.close()


def close_beside_journal(writer: SessionRecorder) -> None:
    """Close as a kill between the last two steps leaves a session: with its journal."""
    journal = journal_of(writer.path)
    content = journal.read_bytes()
    writer.close()
    journal.write_bytes(content)


def assert_identical(a: object, b: object) -> None:
    """Two records are equal field by field: type, dtype, shape and every bit, NaN included."""
    assert type(a) is type(b)
    if is_dataclass(a):
        for field in fields(a):
            assert_identical(getattr(a, field.name), getattr(b, field.name))
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    else:
        np.testing.assert_equal(a, b)


def session_of_format(version: int, folder: Path) -> Path:
    """A session that the program of an earlier format wrote."""
    path, name = folder / f"format_{version}.h5", f"session_format_{version}.h5.gz"
    path.write_bytes(gzip.decompress((Path(__file__).parents[1] / "data" / name).read_bytes()))
    return path


def copy_recording(path: Path, to: Path) -> None:
    """Copy the files of a session that is being recorded, as a kill would leave them."""
    for file in files_of(path).values():
        if file.exists():
            shutil.copy(file, to.with_name(file.name.replace(path.name, to.name)))


def alter(path: Path, dataset: str, row: int) -> None:
    """Flip one bit of a row of a dataset where it lies on the disk."""
    with h5py.File(path) as file:
        column = file[dataset]
        chunk = column.id.get_chunk_info_by_coord(
            (row - row % column.chunks[0], *[0] * (column.ndim - 1))
        )
        place = chunk.byte_offset + (row % column.chunks[0]) * column.dtype.itemsize * int(
            np.prod(column.chunks[1:])
        )
    with path.open("r+b") as raw:
        raw.seek(place)
        (byte,) = raw.read(1)
        raw.seek(place)
        raw.write(bytes([byte ^ 1]))
