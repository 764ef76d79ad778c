"""A program that records until it is killed: ``python killed_recorder.py SESSION.h5
FRAMES_PER_SECOND ROWS COLUMNS``.

Prints, for each frame that was handed to the recorder with its samples, its number and the time of
the monotonic clock. What it records can be told from the number alone, so that `lost_by_kill` knows
what there should be.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.acquisition.recorder_thread import Recorder
from app.records.record_types import Header, Samples
from app.session.reader import SessionReader
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from drivers.protocols import Frame

DIVISOR = 42  # samples from one frame to the next
QUEUE_S, FLUSH_S = 4.0, 0.4  # as by default


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
    """What a kill cost: frames sent, frames lost, seconds from the first lost frame and from the
    first lost samples to the kill (0: none), and the repair's sentence.
    """

    sent: int
    lost: int
    lost_s: float
    forces_lost_s: float
    repaired: str


def lost_by_kill(
    path: Path,
    rate: float,
    shape: tuple[int, int],
    delay_s: float,
    environment: Mapping[str, str] | None = None,
) -> Kill:
    """Start a recording with more in its environment, kill it `delay_s` after its first frame,
    repair the session and compare all with what was sent.
    """
    command = [sys.executable, __file__, str(path), str(rate), str(shape[0]), str(shape[1])]
    own = os.environ | (environment or {})
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=own) as child:
        assert child.stdout is not None
        first = child.stdout.readline()
        time.sleep(delay_s)
        killed = time.monotonic()
        child.kill()
        lines = [first, *child.stdout.read().splitlines(keepends=True)]
    sent = {int(line.split()[0]): float(line.split()[1]) for line in lines if line.endswith("\n")}
    repaired = path.with_name("repaired-" + path.name)
    found = repair(path, repaired)
    with SessionReader(repaired) as session:
        kept = set()
        for index, sample, image in session.frames():
            assert sample == index * DIVISOR
            assert np.array_equal(image, image_of(index, shape)), f"frame {index} was altered"
            kept.add(index)
        volts, forces = session.forces().volts, session.forces().forces
        for n in range(len(forces) // DIVISOR):
            here = slice(n * DIVISOR, (n + 1) * DIVISOR)
            assert np.array_equal(forces[here], forces_of(n)), (
                f"the samples of frame {n} were altered"
            )
            assert np.array_equal(volts[here], 2 * forces_of(n))
    whole = len(forces) // DIVISOR  # blocks of samples

    def lost_s(lost: list[int]) -> float:
        return max((killed - sent[n] for n in lost), default=0.0)

    lost = [n for n in sent if n not in kept]
    blocks = [n for n in sent if n >= whole]
    return Kill(len(sent), len(lost), lost_s(lost), lost_s(blocks), str(found))


if __name__ == "__main__":
    record(Path(sys.argv[1]), float(sys.argv[2]), (int(sys.argv[3]), int(sys.argv[4])))
