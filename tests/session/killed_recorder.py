"""A program that records until it is killed: ``python killed_recorder.py SESSION.h5
FRAMES_PER_SECOND ROWS COLUMNS``.

Prints, for each frame that was handed to the recorder with its samples, its number and the time of
the monotonic clock. What it records can be told from the number alone, so that `Recording` knows
what there should be.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from app.acquisition.recorder_thread import Recorder
from app.records.record_types import Header, Samples
from app.session.journal import StoredFrame, journal_of, read_journal
from app.session.reader import SessionReader
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from drivers.protocols import Frame

DIVISOR = 42  # samples from one frame to the next
QUEUE_S, FLUSH_S = 4.0, 0.4  # as by default
HANGS_S = 60.0


def image_of(frame: int, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """The image of a frame, which no other frame has."""
    row = np.random.default_rng(frame).integers(0, 256, shape[1], np.uint8)
    return row + 3 * np.arange(shape[0], dtype=np.uint8)[:, None]


def forces_of(frame: int) -> NDArray[np.float64]:
    """The forces that come with a frame, (DIVISOR, 2)."""
    return np.random.default_rng(frame).normal(size=(DIVISOR, 2))


def record(path: Path, rate: float, shape: tuple[int, int]) -> None:
    """Record until somebody kills this program."""
    header = Header(
        config_toml="",
        sample_rate_hz=DIVISOR * rate,
        frame_shape=shape,
        frame_dtype="uint8",
        exposure_samples=10,
        divisor=DIVISOR,
        first_trigger=0,
        pixel_m=7e-6,
        grid_x_px=np.arange(4.0),
        grid_y_px=np.arange(3.0),
        versions={},
    )
    sink = SessionRecorder.create(path, header)
    recorder = Recorder(
        sink,
        QUEUE_S,
        rate * shape[0] * shape[1],
        FLUSH_S,
        sender_waits=False,
        on_failure=sys.exit,
    )
    for _, work in recorder.works():
        threading.Thread(target=work, daemon=True).start()
    began = time.monotonic()
    for n in range(1 << 30):
        image, forces = image_of(n, shape), forces_of(n)
        time.sleep(max(0.0, began + n / rate - time.monotonic()))
        recorder.append(Samples(n * DIVISOR, 2 * forces, forces))
        recorder.append(Frame(n, n * DIVISOR, image))
        print(n, time.monotonic(), flush=True)


@dataclass(frozen=True, slots=True)
class Kill:
    """What a kill cost: when each frame was sent and the program killed, the frames whose image and
    those whose samples are lost, and the repair's sentence.
    """

    sent: Mapping[int, float]
    killed: float
    lost: list[int]
    forces_lost: list[int]
    repaired: str

    def seconds(self, lost: list[int]) -> float:
        """From the first of the lost frames to the kill; 0 without any."""
        return max((self.killed - self.sent[n] for n in lost), default=0.0)


class Recording:
    """Another program, with more in its environment, that records.

    Attributes
    ----------
    sent : dict
        The frames that were handed to its recorder so far, and when.
    """

    def __init__(
        self,
        path: Path,
        rate: float,
        shape: tuple[int, int],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.sent: dict[int, float] = {}
        self._path, self._shape = path, shape
        command = [sys.executable, __file__, str(path), str(rate), str(shape[0]), str(shape[1])]
        own = os.environ | (environment or {})
        self._child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=own)
        self._listening = threading.Thread(target=self._listen)
        self._listening.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._child.kill()
        self._child.wait()
        self._listening.join()

    def _listen(self) -> None:
        assert self._child.stdout is not None
        with self._child.stdout as lines:
            for line in lines:
                if line.endswith("\n"):
                    frame, sent = line.split()
                    self.sent[int(frame)] = float(sent)

    def wait_until_sent(self, frames: int) -> None:
        """Return when so many frames were handed to the recorder."""
        self._wait(lambda: len(self.sent) >= frames)

    def wait_until_held(self, frames: int) -> None:
        """Return when the system has so many frames with their samples."""

        def is_held() -> bool:
            held = [*read_journal(journal_of(self._path))]
            images = sum(isinstance(one, StoredFrame) for one in held)
            samples = sum(len(one.forces) for one in held if isinstance(one, Samples))
            return images >= frames and samples >= DIVISOR * frames

        self._wait(is_held)

    def _wait(self, is_so: Callable[[], bool]) -> None:
        give_up = time.monotonic() + HANGS_S
        while not is_so():
            assert self._child.poll() is None, "the program has ended"
            assert time.monotonic() < give_up, f"nothing comes after {len(self.sent)} frames"
            time.sleep(0.005)

    def kill(self) -> Kill:
        """Kill the program, repair the session and compare all with what was sent."""
        killed = time.monotonic()
        self.__exit__()
        repaired = self._path.with_name("repaired-" + self._path.name)
        found = repair(self._path, repaired)
        with SessionReader(repaired) as session:
            kept = set()
            for index, sample, image in session.frames():
                assert sample == index * DIVISOR
                assert np.array_equal(image, image_of(index, self._shape)), f"{index} was altered"
                kept.add(index)
            volts, forces = session.forces().volts, session.forces().forces
        whole = len(forces) // DIVISOR
        for n in range(whole):
            here = slice(n * DIVISOR, (n + 1) * DIVISOR)
            assert np.array_equal(forces[here], forces_of(n)), f"the samples of {n} were altered"
            assert np.array_equal(volts[here], 2 * forces_of(n))
        lost = [n for n in self.sent if n not in kept]
        return Kill(self.sent, killed, lost, [n for n in self.sent if n >= whole], str(found))


if __name__ == "__main__":
    record(Path(sys.argv[1]), float(sys.argv[2]), (int(sys.argv[3]), int(sys.argv[4])))
