"""A saved session sent through the same analysis again, frame for frame as it was analysed.

No device is involved, nor could be.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from app.config import from_record, revised
from app.effort import Effort
from app.engine.pipeline import Pipeline
from app.engine.watched import Watched
from app.errors import UserError
from app.offline.comparison import Comparison, difference
from app.offline.loop import Measurements, Trigger, analyse
from app.offline.playback import Browser, Playback
from app.records import STEP, Counts, Health, Outcome, Phase, Position, ReceivedFrame, Snapshot
from app.session.datasets import span_of
from app.session.reader import SessionReader
from app.settings import Config

__all__ = ["Comparison", "Replay", "difference"]


class Replay(Watched):
    """A session played again, with the same methods as a live `app.engine.run.Run`.

    Parameters
    ----------
    pace : float or None
        Seconds of the experiment per second; None: as fast as the machine can.
    overrides : sequence of str
        ``table.key=value`` of settings that differ from those of the session.

    Raises
    ------
    UserError, ConfigError
        There is no session, it has no results to repeat, or a setting can not be changed.
    """

    def __init__(self, path: Path, *, pace: float | None, overrides: Sequence[str] = ()) -> None:
        with SessionReader(path) as session:
            recorded = from_record(session.header.config_toml, f"{path}: settings")
            check_agree(session, recorded)
            config = revised(recorded, overrides)
            super().__init__(config, f"replay of {path.name}", Pipeline(config))
            self._recorded_counts = session.outcome.counts
            self._frames = self._frames_of(session)
            self._efforts = {} if overrides else _efforts(session)
        self.path = path
        self.playback = Playback(pace)
        self.browser = Browser(path)
        self._comparison = Comparison()
        self._phase = self._reason = self._preparing = ""
        self._latest_image: NDArray[Any] | None = None
        self.is_refused = False  # whether it failed because the session can not be read

    def start(self) -> None:
        """Begin to play; returns at once.

        Raises
        ------
        RuntimeError
            It has begun before.
        """
        with self._starting:
            if self._state != "idle":
                raise RuntimeError(f"replay: it is {self._state} already; make a new one")
            self._state = "running"
        self._thread = threading.Thread(target=self._play, name="slipscope-replay", daemon=True)
        self._thread.start()

    @property
    def frame_count(self) -> int:
        """Number of frames to play."""
        return len(self._frames)

    @property
    def can_browse(self) -> bool:
        """Whether any frame can be looked at."""
        return True

    @property
    def is_browsing(self) -> bool:
        """Whether a recorded frame is shown rather than the newest one that was played."""
        return self.browser.number is not None

    @property
    def place(self) -> int:
        """Number of the frame that is shown, from 0."""
        number = self.browser.number
        return max(0, self._done - 1) if number is None else number

    def request_stop(self, reason: str) -> None:
        """End after the current frame."""
        self._reason = self._reason or reason
        self.playback.end()

    def stop_motion(self) -> None:
        """End the replay, in which nothing moves."""
        self.request_stop("STOP MOTION was pressed")

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

    def health(self) -> Health:
        """State and progress at this moment; the counts are those of the recorded run, except for
        the frames analysed here.
        """
        paused = "paused; Space continues" if self.playback.is_paused else ""
        return Health(
            state=self._state,
            reason=self._reason or self._preparing or paused,
            phase=self._phase,
            counts=self._outcome.counts if self._outcome else self._counts(),
            queue_fill=0.0,
            queue_seconds=0.0,
            disk_free_bytes=-1,  # nothing is written
            sample=self._analysis.history.end,
            uncertain=len(self._analysis.uncertain),
            progress=1.0 if self._outcome else self._done / len(self._frames),
        )

    def comparison(self) -> Comparison:
        """The replayed results against the recorded ones."""
        return self._comparison

    @property
    def _done(self) -> int:
        return len(self._analysis.series)

    def _counts(self) -> Counts:
        skipped = max(0, self._recorded_counts.frames_received - len(self._frames))
        return replace(self._recorded_counts, frames_analysed=self._done, frames_skipped=skipped)

    def _play(self) -> None:
        outcome = None
        try:
            self._preparing = "compiling the image correlation"
            with SessionReader(self.path) as session:
                outcome = self._analyse(session)
        except UserError as error:
            self.is_refused, self._reason = True, str(error)
        except Exception as error:
            self._reason = f"replay of {self.path.name}: {error}"
        finally:
            self._end(outcome or Outcome("failed", self._reason, self._counts(), None, {}))

    def _analyse(self, session: SessionReader) -> Outcome:
        self._comparison.begin(session)
        outcome = analyse(
            self._analysis,
            self._measurements(session),
            self._triggers(session),
            self._comparison,
            lambda: self._why_ended("analysed frames were replayed"),
            self._efforts,
        )
        return replace(outcome, counts=self._counts())

    def _why_ended(self, done: str) -> str:
        self._reason = self._reason or f"all {self._done} {done}"
        return self._reason

    def _frames_of(self, session: SessionReader) -> list[int]:
        """Trigger numbers of the frames to play, in order."""
        analysed, _ = session.analysed_frames(), session.images_path  # may be in another file
        if not analysed:
            raise UserError(
                f"{session.path}: no frame of this session was analysed; give -o ANALYSIS.h5 to do"
                " so now"
            )
        return analysed

    def _measurements(self, session: SessionReader) -> Measurements:
        return measurements_of(session)

    def _triggers(self, session: SessionReader) -> Iterator[Trigger]:
        """Each frame when it is its turn."""
        spans = {row[0]: span_of(row[0], *row[5:]) for row in session.triggers().tolist()}
        for index in self._frames:
            _, sample, image = session.frame(index)
            if not self._is_due(sample):
                return
            yield ReceivedFrame(index, sample, image, span=spans.get(index)), image
            self._show(sample, image)

    def _is_due(self, sample: int) -> bool:
        """Whether a frame is to be played, once its time has come; False: the replay is over."""
        self._preparing = ""
        return self.playback.wait_for_turn(sample / self.sample_rate_hz)

    def _show(self, sample: int, image: NDArray[Any]) -> None:
        """Let the window see a frame that has been analysed."""
        self._latest_image = image
        self._phase = str(self._analysis.history.phase_at(sample))


def measurements_of(session: SessionReader) -> Measurements:
    """What a session recorded beside its images."""
    positions = zip(*(column.tolist() for column in session.positions()), strict=True)
    return Measurements(
        session.forces().volts,
        session.gaps(),
        [Position(*position) for position in positions],
        session.events(),
    )


def _efforts(session: SessionReader) -> dict[int, Effort]:
    """What was computed of each frame, by its trigger number."""
    names = ["frame", *(one.name for one in fields(Effort))]
    return {frame: Effort(*held) for frame, *held in session.results()[names].tolist()}


def check_agree(session: SessionReader, config: Config) -> None:
    """Refuse a session whose settings, clock, images and phases do not agree: it was changed after
    it was recorded, and could ask for more memory than there is.

    Raises
    ------
    UserError
    """
    header, camera = session.header, config.camera
    for what, said, held in (
        ("images (rows, columns)", camera.shape, header.frame_shape),
        ("pixels", str(camera.dtype), header.frame_dtype),
        ("sample rate", config.forces.sample_rate, header.sample_rate_hz),
        ("divisor", camera.divisor, header.divisor),
        ("exposure in samples", config.exposure_samples, header.exposure_samples),
    ):
        if said != held:
            raise UserError(
                f"{session.path}: {what}: {held} in the session, {said} in its settings; somebody"
                " changed it, use a copy of it if there is one"
            )
    phases = {event.text for event in session.events() if event.kind == "phase"}
    if not phases or not phases <= {*Phase}:
        raise UserError(
            f"{session.path}: its events name no phases, or others than an experiment has;"
            " somebody changed it, use a copy of it if there is one"
        )
    steps = [event.text for event in session.events() if event.kind == STEP]
    for text in steps:
        number = text.partition(" ")[0]
        if not (number.isdecimal() and len(number) < 4):
            raise UserError(
                f"{session.path}: an event of a step begins with its number, found '{text[:80]}';"
                " somebody changed it, use a copy of it if there is one"
            )
