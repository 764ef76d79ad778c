"""Any recorded frame of a session: its picture, forces and place of the stage, with the results of
the run, or with those that are computed on request.
"""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

from analysis.arrays import Array
from app.evaluation.history import History
from app.evaluation.pipeline import Pipeline
from app.evaluation.quality import complete
from app.evaluation.setup import forces_of, pattern_of
from app.records.effort import Effort
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import REFERENCE, Conditions, DisplacementField, Position, Snapshot
from app.replay.loop import Feed, Measurements
from app.session.reader import SessionReader
from app.settings.config import settings_of
from app.settings.sections import Config
from app.system.errors import UserError

Seen = tuple[Snapshot, Array]
NOTHING = Effort(computed=0)


class Browser:
    """Shows any recorded frame of a session, by the number of its trigger.

    The file is read by `look`, which one thread calls; `show` may be called from any.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session: SessionReader | None = None
        self._wanted: int | None = None
        self._shown: tuple[int, Seen] | None = None
        self._rows: dict[int, int] = {}  # of the results, by frame
        self._computed: dict[int, Snapshot] = {}  # on request
        self._lock = threading.Lock()  # one frame is analysed at a time

    @property
    def number(self) -> int | None:
        """The frame that is looked at."""
        return self._wanted

    def show(self, number: int | None) -> None:
        """Choose the recorded frame to look at; None: no frame. Returns at once."""
        self._wanted = number

    def is_analysed(self, number: int) -> bool:
        """Whether results were computed of a frame on request."""
        return number in self._computed

    def look(self) -> Seen | None:
        """Results and image of the frame that is looked at, or None.

        The same objects as before until another frame is chosen, or its results are computed. A
        frame that was not analysed has nothing but its conditions.
        """
        wanted = self._wanted
        if wanted is None:
            return None
        computed = self._computed.get(wanted)
        if self._shown is None or self._shown[0] != wanted:
            if self._session is None:
                self._session = SessionReader(self._path)
                self._rows = _rows_of(self._session)
            image = self._session.frame(wanted)[2]
            self._shown = wanted, (computed or self._recorded(self._session, wanted), image)
        elif computed is not None and self._shown[1][0] is not computed:
            self._shown = wanted, (computed, self._shown[1][1])
        return self._shown[1]

    def analyse(self, number: int) -> Snapshot:
        """The results of a frame that was not analysed during the run, by the settings of the
        session: from the background and the reference of the run, beginning with the displacements
        of the nearest frame that has any. It may take a second. With a rolling shutter, the field
        rests on the last frame before it that the run analysed, as it would have during the run;
        the longer ago that was, the less even the motion since.

        Raises
        ------
        UserError
            There is no such frame, or no reference before it.
        """
        with self._lock, SessionReader(self._path) as session:
            if number not in self._computed:
                self._computed[number] = analysed_frame(session, number)
            return self._computed[number]

    def close(self) -> None:
        """Let go of the file."""
        if self._session is not None:
            self._session.close()

    def _recorded(self, session: SessionReader, number: int) -> Snapshot:
        if number in self._rows:
            return session.snapshot(self._rows[number])
        _, sample, _ = session.frame(number)
        config = settings_of(session)
        return Snapshot(number, sample, conditions_at(session, config, sample), effort=NOTHING)


def _rows_of(session: SessionReader) -> dict[int, int]:
    return {frame: row for row, frame in enumerate(session.analysed_frames())}


def frames_of(session: SessionReader) -> list[int]:
    """Trigger numbers of the images of a session.

    Raises
    ------
    UserError
        There are none.
    """
    triggers = session.triggers()
    received: list[int] = triggers["index"][triggers["received"]].tolist()
    if not received:
        raise UserError(
            f"{session.path}: there are no images in this session; nothing can be analysed"
        )
    return received


def measurements_of(session: SessionReader) -> Measurements:
    """What a session recorded beside its images."""
    positions = map(Position, *(column.tolist() for column in session.positions()))
    return Measurements(session.forces().volts, session.gaps(), list(positions), session.events())


def pattern_for(session: SessionReader, config: Config) -> PixelPattern | None:
    """What is undone in the pictures of a session: what was when it was recorded, or what another
    certificate says where the settings name one.

    Raises
    ------
    UserError, ConfigError
        It cannot be read.
    """
    recorded = settings_of(session)
    if config.calibration.certificates == recorded.calibration.certificates:
        return session.pattern()
    return pattern_of(config)


def conditions_at(session: SessionReader, config: Config, sample: int) -> Conditions:
    """The state of the bench during the exposure that began at `sample`, as of a live run."""
    measured = measurements_of(session)
    history = History(
        float(config.forces.sample_rate), config.exposure_samples, config.run.direction
    )
    events = sorted(measured.events, key=lambda event: event.sample)
    forces = forces_of(config, measured.volts, events)
    Feed(history, forces, measured, events).up_to(sample)
    return history.conditions(sample)


def analysed_frame(session: SessionReader, number: int) -> Snapshot:
    """The results of one frame of a session, computed now; see `Browser.analyse`."""
    config = settings_of(session)
    if config.dic.refusal:
        raise UserError(f"{session.path}: {config.dic.refusal}")
    rows = _rows_of(session)
    _, sample, image = session.frame(number)
    taken = [e for e in session.events() if e.kind == REFERENCE and e.sample < sample]
    if not taken:
        raise UserError(
            f"{session.path}: frame {number} was exposed before a reference was taken, so there"
            " are no displacements to measure; choose a later frame"
        )
    reference = taken[0].number
    if reference not in rows:
        raise UserError(
            f"{session.path}: frame {reference}, the reference, has no row of results, so nothing"
            f" can be measured against it; slipscope info --verify {session.path.name} shows what"
            " is damaged"
        )
    phases = session.results()["phase"]
    free = [frame for frame, row in rows.items() if phases[row] == "background"]
    # with a rolling shutter a field rests on the last one that was analysed
    beside = [f for f in rows if reference < f < number][-1:] if config.camera.readout else []
    everything = complete(config)
    with closing(Pipeline(config, session.pattern())) as pipeline:
        for frame in (*free[-1:], reference, *beside):
            held = session.snapshot(rows[frame])
            effort = everything if frame in beside else held.effort
            pipeline.step(frame, held.sample, session.frame(frame)[2], held.conditions, effort)
        if near := _nearest_field(session, rows, number):
            pipeline.start_from(near)
        now = conditions_at(session, config, sample)
        return pipeline.step(number, sample, image, now, everything)


def _nearest_field(
    session: SessionReader, rows: dict[int, int], number: int
) -> DisplacementField | None:
    has = session.have_fields()
    near = [frame for frame, row in rows.items() if has[row]]
    if not near:
        return None
    return session.snapshot(rows[min(near, key=lambda frame: abs(frame - number))]).field
