"""A killed session of which one bit of the journal is flipped, and what its repair lacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from session_material import SHAPE, copy_recording, make_writer

from app.records.record_types import Event, Samples
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.repair import repair
from drivers.protocols import Frame

FRAMES = 213
BLOCK = 42  # samples from one frame to the next


class DamagedJournal:
    """A session as a kill leaves it in a folder, to be damaged as often as one likes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        rng = np.random.default_rng(5)
        self._images = rng.integers(0, 256, (FRAMES, *SHAPE), np.uint8)
        self._forces = rng.normal(size=(FRAMES * BLOCK, 2))
        writer = make_writer(folder / "open.h5", divisor=BLOCK)
        for n, image in enumerate(self._images):
            here = slice(n * BLOCK, (n + 1) * BLOCK)
            writer.append(Samples(here.start, 2 * self._forces[here], self._forces[here]))
            writer.append(Frame(n, here.start, image))
            if n % 10 == 0:
                writer.append(Event(here.start, "phase", f"frame {n}"))
        writer.flush()
        copy_recording(folder / "open.h5", folder / "killed.h5")
        writer.discard()
        self._journal = journal_of(folder / "killed.h5").read_bytes()

    def lost_by_bit(self, seed: int) -> tuple[int, int]:
        """Flip a random bit, repair: frames and samples that are missing; the others are as they
        were given, and the repair knows how many are not there.
        """
        rng = np.random.default_rng(seed)
        content = bytearray(self._journal)
        content[rng.integers(len(content))] ^= 1 << rng.integers(8)
        journal_of(self._folder / "killed.h5").write_bytes(content)
        output = self._folder / "repaired.h5"
        repaired = repair(self._folder / "killed.h5", output, overwrite=True)
        with SessionReader(output) as session:
            images = {n: image for n, _, image in session.frames()}
            forces, volts = session.forces().forces, session.forces().volts
        for n, image in images.items():
            assert np.array_equal(image, self._images[n]), f"frame {n} was altered"
        known = np.isfinite(forces[:, 0])
        assert np.array_equal(forces[known], self._forces[: len(forces)][known])
        assert np.array_equal(volts[known], 2 * forces[known])
        frames, samples = FRAMES - len(images), len(self._forces) - np.count_nonzero(known)
        assert not repaired.found.is_whole
        return frames, int(samples)
