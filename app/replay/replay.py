"""A saved session sent through the same analysis again, frame for frame as it was analysed.

No device is involved, nor could be.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path

from analysis.arrays import Array
from app.evaluation.observed_run import ObservedRun
from app.evaluation.pipeline import Pipeline
from app.evaluation.timeline import ReplayVerdict, timeline_of
from app.records.bench_view import Health
from app.records.effort import Effort
from app.records.record_types import STEP, Counts, End, Outcome, Phase, Snapshot
from app.replay.browser import Browser, measurements_of, pattern_for
from app.replay.comparison import Comparison
from app.replay.loop import Measurements, Read, Trigger, analyse
from app.replay.playback import Playback
from app.session.reader import SessionReader
from app.settings.config import revised, settings_of
from app.settings.sections import Config
from app.system.errors import UserError
from app.system.stopping import StopAnswer, not_connected
from drivers.protocols import Frame


class Replay(ObservedRun):
    """A session played again, with the same methods as a live `app.acquisition.run.Run`.

    Its place is the number of a recorded frame: of the newest one that was replayed or, once
    another was chosen (`show`), of that one, from which `play` goes on with the recorded results
    until the replay has caught up.

    Parameters
    ----------
    pace : float or None
        Seconds of the experiment per second; None: as fast as the machine can.
    overrides : sequence of str
        ``table.key=value`` of settings that differ from those of the session.

    Raises
    ------
    UserError, ConfigError
        There is no session, it has no results to repeat, or a setting cannot be changed.
    """

    kind = "replay"

    def __init__(self, path: Path, *, pace: float | None, overrides: Sequence[str] = ()) -> None:
        with SessionReader(path) as session:
            recorded = settings_of(session)
            check_agree(session, recorded)
            config = revised(recorded, overrides)
            pipeline = Pipeline(config, pattern_for(session, config))
            super().__init__(config, f"replay of {path.name}", pipeline)
            self._recorded_counts = counts = session.outcome.counts
            self._frames = self._frames_of(session)
            self._efforts = {} if overrides else _efforts(session)
            self.timeline = timeline_of(
                session.triggers(),
                session.results(),
                session.events(),
                session.gaps(),
                session.outcome.summary,
                sample_rate_hz=session.header.sample_rate_hz,
                exposure=session.header.exposure_samples,
                end=counts.samples + counts.samples_lost,
            )
        self.path = path
        self.playback = Playback(pace)
        self.browser = Browser(path)
        self._comparison = Comparison()
        self._choosing = threading.RLock()
        self._phase = self._reason = self._preparing = ""
        self._latest_image: Array | None = None
        self.is_refused = False  # whether it failed because the session cannot be read

    def start(self) -> None:
        """Begin to play, unless it was ended before; returns at once.

        Raises
        ------
        RuntimeError
            It has begun before.
        """
        with self._starting:
            if self._is_called_off:
                return
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
        return self._chosen() is not None

    @property
    def is_playing(self) -> bool:
        """Whether the place moves by itself."""
        if self.playback.is_paused or self._state == "idle":
            return False
        return self._outcome is None or self.is_browsing

    @property
    def frame(self) -> int:
        """Number of the frame that is shown, as it was recorded."""
        number = self._chosen()
        return self._newest if number is None else number

    def show(self, frame: int) -> None:
        """Pause, and show a recorded frame: this one, or the nearest that has an image. All frames
        before it are replayed, for the curves.
        """
        with self._choosing:
            line, row = self.timeline, self.timeline.row_of(frame)
            self.playback.pause()
            self.playback.catch_up(int(line.samples[row]) / self.sample_rate_hz)
            self.browser.show(int(line.frames[row]))

    def move(self, frames: int) -> None:
        """Pause, and show the frame that was recorded so many before or after; the next one is
        replayed if it is its turn.
        """
        row = self.timeline.row_of(self.frame) + frames
        wanted = int(self.timeline.frames[min(max(row, 0), len(self.timeline.frames) - 1)])
        if frames > 0 and not self.is_browsing and wanted == self._next:
            self.playback.step()
        elif self.can_browse:
            self.show(wanted)

    def pause(self) -> None:
        """Stay at the frame that is shown."""
        with self._choosing:
            self._chosen()
            self.playback.pause()

    def play(self) -> None:
        """Go on from the frame that is shown; from the first one after the last."""
        with self._choosing:
            line, chosen = self.timeline, self._chosen()
            if self._outcome is not None and self.frame == line.frames[-1]:
                chosen = int(line.frames[0])
                self.browser.show(chosen)
            if chosen is None:
                self.playback.resume()
            else:
                sample = int(line.samples[line.row_of(chosen)])
                self.playback.resume_from(sample / self.sample_rate_hz)

    def analyse(self, frame: int) -> None:
        """Compute the results of a frame that was not analysed during the run; see `Browser`."""
        self.browser.analyse(frame)

    def has_results(self, frame: int) -> bool:
        """Whether there are results of a recorded frame."""
        return self.timeline.has_results(frame) or self.browser.is_analysed(frame)

    def verdict(self) -> ReplayVerdict | None:
        """Whether the results are those that were recorded; None while it plays."""
        compared = self._comparison
        if self._outcome is None or not compared.frames:
            return None
        return ReplayVerdict(compared.agrees, compared.sentences)

    @property
    def _newest(self) -> int:
        """The newest frame that was played; before any, the first to be."""
        return self._frames[max(0, min(self._done, len(self._frames)) - 1)]

    @property
    def _next(self) -> int | None:
        """The next one to be played."""
        is_over = self._outcome is not None or self._done >= len(self._frames)
        return None if is_over else self._frames[self._done]

    def _chosen(self) -> int | None:
        """The recorded frame that is shown in place of the newest one that was played, which takes
        its place again when both have met.
        """
        with self._choosing:
            chosen, line = self.browser.number, self.timeline
            if chosen is None or self.playback.is_paused:
                return chosen
            head_s = self.playback.head_s
            row = line.row_at(head_s * self.sample_rate_hz) if math.isfinite(head_s) else 0
            has_met = line.row_of(chosen) <= line.row_of(self._newest) <= row
            is_last = row == len(line.frames) - 1 and self._outcome is not None
            chosen = None if is_last or has_met else int(line.frames[row])
            self.browser.show(chosen)
            return chosen

    def request_stop(self, reason: str) -> None:
        """End after the current frame; a replay that has not begun never will."""
        called_off = self._call_off("replay", reason)
        self._reason = self._reason or (called_off.reason if called_off else reason)
        self.playback.end()

    def stop_motion(self) -> StopAnswer:
        """End the replay, in which nothing moves."""
        self.request_stop("STOP MOTION was pressed")
        return not_connected("this is recorded, and no bench is connected")

    def latest_image(self) -> Array | None:
        """The image of the frame that is looked at, or else of the newest one."""
        self._chosen()
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
        return Health(
            state=self._state,
            reason=self._reason or self._preparing,
            phase=self._phase,
            counts=self._outcome.counts if self._outcome else self._counts(),
            queue_fill=0.0,
            queue_seconds=0.0,
            disk_free_bytes=-1,  # nothing is written
            sample=self._analysis.history.end,
            uncertain=len(self._analysis.uncertain),
            damage=str(self._analysis.damage),
            progress=self._done / len(self._frames),
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
            self._end(outcome or Outcome(End.FAILED, self._reason, self._counts(), None, {}))

    def _analyse(self, session: SessionReader) -> Outcome:
        self._comparison.begin(session)
        outcome = analyse(
            self._analysis,
            self._measurements(session),
            self._triggers(session),
            self._comparison,
            lambda: self._ended_by("analysed frames were replayed"),
            self._efforts,
        )
        return replace(outcome, counts=self._counts())

    def _ended_by(self, done: str) -> tuple[End, str]:
        end, count = (End.STOPPED if self._reason else End.PLAYED), f"{self._done} {done}"
        if not self._reason:
            self._reason = f"all {count}"
        elif 0 < self._done < len(self._frames):
            self._reason += f"; {count} of {len(self._frames)}, and the numbers are of these alone"
        return end, self._reason

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
        spans = {row[0]: row[5:] for row in session.triggers().tolist()}
        for (index, sample, image), after in self._read(session, self._frames):
            yield Frame(index, sample, image, *spans[index]), image, after

    def _read(
        self, session: SessionReader, numbers: Iterable[int]
    ) -> Iterator[tuple[Read, Read | None]]:
        """Each frame once its time has come, and the one after it if that has no time of its own.
        The window sees it when it has been analysed.
        """
        after: Read | None = None
        for number, next_one in pairwise([*numbers, None]):
            assert number is not None
            index, sample, image = after or session.frame(number)
            self._preparing = ""
            if not self.playback.wait_for_turn(sample / self.sample_rate_hz):
                return
            after = None
            if next_one is not None and self.playback.pace is None:
                with suppress(UserError):  # it is said when it is its turn
                    after = session.frame(next_one)
            yield (index, sample, image), after
            self._latest_image = image
            self._phase = str(self._analysis.history.phase_at(sample))


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
    has_frames = bool(session.triggers()["received"].any())  # else it may have ended before one
    if (has_frames and not phases) or not phases <= {*Phase}:
        raise UserError(
            f"{session.path}: its events name no phases, or others than an experiment has;"
            " somebody changed it, use a copy of it if there is one"
        )
    for event in session.events():
        if event.kind == STEP and not 0 <= event.number < 1000:
            raise UserError(
                f"{session.path}: an event of a step has its number, found {event.number} of"
                f" '{event.text[:80]}'; somebody changed it, use a copy of it if there is one"
            )
