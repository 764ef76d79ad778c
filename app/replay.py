"""A saved session through the very same pipeline, frame for frame as it was analysed.

No device is involved, nor could be.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from analysis.dic import compile_kernels
from app.config import from_record, revised
from app.engine.feed import Feed
from app.engine.history import History
from app.engine.pipeline import Pipeline, sensor_chain, summarise
from app.engine.series import Series
from app.errors import UserError
from app.playback import Browser, Playback
from app.results import ContactResult, Counts, Health, Outcome, Phase, Snapshot
from app.session.reader import SessionReader
from app.settings import Config


@dataclass(frozen=True, slots=True)
class Comparison:
    """How far the replayed results are those of the live run, bit for bit."""

    frames: int
    identical: int
    first_difference: str

    @property
    def all_identical(self) -> bool:
        """Every replayed frame gave the recorded result."""
        return self.frames == self.identical


def difference(a: Snapshot, b: Snapshot, besides: frozenset[str] = frozenset()) -> str:
    """Name of the first quantity, besides some, in which two snapshots differ by a bit; empty when
    there is none.
    """
    for field in dataclasses.fields(Snapshot):
        if field.name in besides:
            continue
        x, y = getattr(a, field.name), getattr(b, field.name)
        same = np.array_equal(x, y, equal_nan=True) if isinstance(x, np.ndarray | float) else x == y
        if not same:
            return field.name
    return ""


class Replay:
    """A session played again: the same methods as a live `app.engine.run.Run`, for the same window.

    Parameters
    ----------
    pace : float or None
        Seconds of the experiment per second; None: as fast as the machine.
    overrides : sequence of str
        ``table.key=value`` of settings that are not those of the session.
    """

    def __init__(self, path: Path, *, pace: float | None, overrides: Sequence[str] = ()) -> None:
        with SessionReader(path) as session:
            self.config: Config = revised(
                from_record(session.config_toml, f"{path}: settings"), overrides
            )
            self._recorded_counts = session.counts()
            self._frames = self._frames_of(session)
        self.path = path
        self.title = f"replay of {path.name}"
        self.pixel_m = self.config.camera.pixel
        self.sample_rate_hz = float(self.config.forces.sample_rate)
        self.playback = Playback(pace)
        self.browser = Browser(path)
        self._pipeline = Pipeline(self.config, self.config.camera.shape)
        self.grid_x_px, self.grid_y_px = self._pipeline.grid.x_px, self._pipeline.grid.y_px
        self._history: History | None = None
        self._snapshots = Series()
        self._phase = ""
        self._latest_image: NDArray[Any] | None = None
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._state, self._reason, self._preparing = "idle", "", ""
        self._outcome: Outcome | None = None
        self._recorded: Iterator[Snapshot] = iter(())
        self._identical = 0
        self._first_difference = ""

    def start(self) -> None:
        """Begin to play; returns at once."""
        if self._state != "idle":
            raise RuntimeError(f"replay: start was asked, but it is {self._state}; make a new one")
        self._state = "running"
        self._thread = threading.Thread(target=self._play, name="slipscope-replay", daemon=True)
        self._thread.start()

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """The outcome once the replay has ended and its thread is gone, None if it has not after
        `timeout` seconds.
        """
        if self._ended.wait(timeout) and self._thread is not None:
            # an interpreter that ends while the thread lets go of its arrays may crash
            self._thread.join()
        return self._outcome

    @property
    def frame_count(self) -> int:
        """Frames that there are to replay."""
        return len(self._frames)

    @property
    def can_browse(self) -> bool:
        """Whether any frame can be looked at."""
        return True

    @property
    def is_browsing(self) -> bool:
        """Whether a recorded frame is looked at, not the newest one that was played."""
        return self.browser.number is not None

    @property
    def place(self) -> int:
        """Number of the frame that is shown, from 0."""
        number = self.browser.number
        return max(0, len(self._snapshots) - 1) if number is None else number

    def request_stop(self, reason: str) -> None:
        """End after the frame in hand."""
        self._reason = self._reason or reason
        self.playback.end()

    def stop_motion(self) -> None:
        """Nothing moves in a replay: it ends."""
        self.request_stop("STOP MOTION was pressed")

    def outcome(self) -> Outcome | None:
        """How the replay ended; None while it has not."""
        return self._outcome

    def contact(self) -> ContactResult | None:
        """The apparent contact, once the reference was reached."""
        return self._pipeline.contact

    def latest_image(self) -> NDArray[Any] | None:
        """The image of the frame that is looked at, or else of the newest one."""
        browsed = self.browser.look()
        return self._latest_image if browsed is None else browsed[1]

    def browsed(self) -> Snapshot | None:
        """Recorded results of the frame that is looked at; None while it is the newest one that was
        played.
        """
        browsed = self.browser.look()
        return None if browsed is None else browsed[0]

    def snapshots_since(self, n: int) -> list[Snapshot]:
        """The snapshots after the first `n`; only the newest one still holds its fields."""
        return self._snapshots.since(n)

    def force_history(
        self, n: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """About `n` points so far: samples, P and Q in newtons."""
        if self._history is None:
            return np.empty(0, np.int64), np.empty(0), np.empty(0)
        return self._history.block_means(n)

    def health(self) -> Health:
        """State and progress at this moment; the counts are those of the recorded run, but for the
        frames analysed here.
        """
        done = len(self._snapshots)
        return Health(
            state=self._state,
            reason=self._reason
            or self._preparing
            or ("it stands; Space goes on" if self.playback.is_paused else ""),
            phase=self._phase,
            counts=self._count(),
            queue_fill=0.0,
            queue_seconds=0.0,
            disk_free_bytes=-1,  # nothing is written
            sample=self._history.end if self._history else 0,
            progress=1.0 if self._outcome else done / len(self._frames),
        )

    def comparison(self) -> Comparison:
        """The replayed results against the recorded ones."""
        return Comparison(len(self._snapshots), self._identical, self._first_difference)

    def _count(self) -> Counts:
        recorded = self._recorded_counts
        done = len(self._snapshots)
        return replace(
            recorded,
            frames_analysed=done,
            frames_skipped=max(0, recorded.frames_received - len(self._frames)),
        )

    def _frames_of(self, session: SessionReader) -> list[int]:
        """Trigger numbers of the frames to play, in order."""
        analysed, _ = session.analysed_frames(), session.images_path  # which may be in another file
        if not analysed:
            raise UserError(
                f"{session.path}: no frame of this session was analysed; give -o ANALYSIS.h5 to do"
                " so now"
            )
        return analysed

    def _play(self) -> None:
        process = psutil.Process()
        cpu, wall, peak = process.cpu_times(), time.monotonic(), 0
        outcome = None
        try:
            self._preparing = "compiling the image correlation"
            compile_kernels(self.config.correlation)
            self._preparing = ""
            with closing(self._pipeline), SessionReader(self.path) as session:
                self._history = History(self.sample_rate_hz, session.exposure_samples)
                phases = [
                    (event.sample, Phase(event.text))
                    for event in session.events()
                    if event.kind == "phase"
                ]
                positions = zip(*(column.tolist() for column in session.positions()), strict=True)
                feed = Feed(
                    self._history, sensor_chain(self.config), session.forces()[1], positions, phases
                )
                self._begin(session)
                for number, index in enumerate(self._frames):
                    _, sample, image = session.frame(index)
                    if not self.playback.wait_for_turn(sample / self.sample_rate_hz):
                        break
                    feed.up_to(sample)
                    snapshot = self._pipeline.step(
                        index, sample, image, self._history.conditions(sample)
                    )
                    self._take(session, number, snapshot, image)
                    self._show(snapshot, image)
                    if number % 16 == 0:
                        peak = max(peak, process.memory_info().rss)
            self._reason = self._reason or f"all {len(self._snapshots)} {self._done}"
            used = process.cpu_times()
            resources = {
                "peak_memory_mib": round(max(peak, process.memory_info().rss) / 2**20, 1),
                "cpu_s": round(used.user + used.system - cpu.user - cpu.system, 2),
                "wall_s": round(time.monotonic() - wall, 2),
            }
            summary = summarise(
                self.config, self._snapshots.since(0), self.contact(), self._pipeline.notes
            )
            outcome = self._end(Outcome("done", self._reason, self._count(), summary, resources))
        except Exception as error:
            self._reason = f"replay of {self.path.name}: {error}"
            self._give_up()
        finally:
            self._outcome = outcome or Outcome("failed", self._reason, self._count(), None, {})
            self._state = self._outcome.state
            self._ended.set()

    _done = "analysed frames were replayed"

    def _begin(self, session: SessionReader) -> None:
        """What must be done before the first frame."""
        self._recorded = session.snapshots()

    def _take(
        self, session: SessionReader, number: int, snapshot: Snapshot, image: NDArray[Any]
    ) -> None:
        """The result of the next frame: compare it with what was recorded."""
        unlike = difference(
            snapshot, next(self._recorded), besides=session.lacking | {"stress_field_pa"}
        )
        if not unlike:
            self._identical += 1
        elif not self._first_difference:
            self._first_difference = f"frame {snapshot.frame}: {unlike}"

    def _end(self, outcome: Outcome) -> Outcome:
        """How it ended, once everything is done."""
        return outcome

    def _give_up(self) -> None:
        """It failed: leave nothing half done."""

    def _show(self, snapshot: Snapshot, image: NDArray[Any]) -> None:
        """Let the window see a frame."""
        self._latest_image = image
        self._phase = str(snapshot.phase)
        self._snapshots.append(snapshot)


def make_replay(path: Path, *, pace: float | None) -> Replay:
    """A replay of the session at `path`.

    Raises
    ------
    UserError
        There is no session, or nothing in it to replay.
    """
    return Replay(path, pace=pace)
