"""A power cut at any instant loses half a second and alters nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from power_cut import Disk
from session_material import SHAPE, make_snapshot, make_writer

from app.records.record_types import Event, Samples
from app.session.reader import SessionReader
from app.session.repair import repair
from drivers.protocols import Frame
from tests.same_results import difference

# 23.8 frames/s at 1 kHz: a flush each 0.42 s, 0.5 s lost at most
FRAMES, DIVISOR, FLUSH_FRAMES, LOST_AT_MOST = 120, 42, 10, 12


def image_of(frame: int) -> np.ndarray:
    """The image of a frame, which no other frame has."""
    return np.random.default_rng(frame).integers(0, 256, SHAPE, np.uint8)


class Recorded:
    """A session that was being recorded, and how far it was at each moment."""

    def __init__(self, folder: Path) -> None:
        self.disk = Disk()
        # number of writes done when a frame and its samples had been recorded
        self.moments: list[int] = []
        self.forces = np.random.default_rng(1).normal(size=(FRAMES * DIVISOR, 2))
        with self.disk.record():
            writer = make_writer(folder / "run.h5", divisor=DIVISOR)
            self.begun = len(self.disk.events)
            for frame in range(FRAMES):
                here = slice(frame * DIVISOR, (frame + 1) * DIVISOR)
                writer.append(Samples(here.start, 2 * self.forces[here], self.forces[here]))
                writer.append(Frame(frame, here.start, image_of(frame)))
                writer.append(make_snapshot(frame))
                writer.append(Event(here.start, "phase", f"frame {frame}"))
                self.moments.append(len(self.disk.events))
                if frame % FLUSH_FRAMES == FLUSH_FRAMES - 1:
                    writer.flush()
            for file in writer._files:
                file.close()

    def instant(self, seed: int, *, flushing: bool) -> int:
        """A moment to cut at, by chance."""
        rng = np.random.default_rng(seed)
        if not flushing:
            return int(rng.integers(self.begun, len(self.disk.events) + 1))
        frame = FLUSH_FRAMES * int(rng.integers(1, FRAMES // FLUSH_FRAMES))
        return int(rng.integers(self.moments[frame - 1], self.moments[frame]))

    def check(self, instant: int, seed: int, folder: Path) -> int:
        """Cut, repair, compare; how many frames were lost."""
        folder.mkdir()
        self.disk.left_by_cut(instant, np.random.default_rng(seed), folder)
        repaired = repair(folder / "run.h5", folder / "repaired.h5")
        told = sum(moment <= instant for moment in self.moments)
        with SessionReader(folder / "repaired.h5") as session:
            kept = 0
            for index, sample, image in session.frames():
                assert sample == index * DIVISOR
                assert_array_equal(image, image_of(index))
                kept += 1
            volts, forces = session.forces().volts, session.forces().forces
            # what was written after a page that was lost comes back too
            known = np.isfinite(forces[:, 0])
            sure = max(0, told - LOST_AT_MOST) * DIVISOR
            assert len(known) >= sure
            assert known[:sure].all()
            assert_array_equal(forces[known], self.forces[: len(forces)][known])
            assert_array_equal(volts, 2 * forces)
            assert sum(count for _, count in session.gaps()) == np.count_nonzero(~known)
            for snapshot in session.snapshots():
                assert difference(snapshot, make_snapshot(snapshot.frame)) == ""
        assert repaired.receipt.frames == kept
        return told - kept


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A run of 5 s, every write kept."""
    return Recorded(tmp_path_factory.mktemp("recorded"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(16))
def test_half_a_second_is_lost_at_most(recorded: Recorded, tmp_path: Path, seed: int) -> None:
    """Half of the cuts come at any instant, half in a flush."""
    assert (
        recorded.check(recorded.instant(seed, flushing=seed % 2 == 0), seed, tmp_path / "cut")
        <= LOST_AT_MOST
    )
