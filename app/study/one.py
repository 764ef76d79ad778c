"""One session through the full offline analysis: everything that its pictures give, as a
`app.records.study_results.RunResult`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64, Array, Rows
from app.evaluation.conclusions import Conclusion
from app.evaluation.frame_analysis import Analysis
from app.evaluation.pipeline import Pipeline
from app.evaluation.series import Thinned
from app.evaluation.setup import pixel_correction
from app.records.effort import Effort, Product
from app.records.legs import numbered_instants
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import REFERENCE, ContactResult, End, Event, Phase, Record, Snapshot
from app.records.snapshot_numbers import ROW, numbers_of
from app.records.study_results import LawSeries, Origin, Pictures, RingSeries, RunResult
from app.replay.browser import frames_of, measurements_of, pattern_for
from app.replay.loop import Trigger, analyse
from app.replay.replay import check_agree
from app.session.reader import SessionReader
from app.settings.config import revised, settings_of as recorded_settings, to_toml
from app.settings.sections import Config
from app.study.instants import instants_of
from app.study.noise import box_noise
from app.study.pictures import box_search, grey8
from app.system.errors import UserError
from app.system.progress import ShareDone, unheard
from drivers.protocols import Frame, LostFrame

FRAMES_SHARE = 0.6  # share of a session's time that its frames take
MOST_FRAMES = 8192  # most frames whose profiles are kept, an even number
AT_REST = 2  # images, from which the noise is taken
# of every frame: displacements as far from the contact as anything but a picture of them needs
PROFILES = Effort(int(Product.CONTACT | Product.SETTLED))


def run_result(
    path: Path,
    overrides: Sequence[str] = (),
    on_progress: ShareDone = unheard,
    threads: int | None = None,
) -> RunResult:
    """All results of a session, every frame of which is analysed again.

    Parameters
    ----------
    overrides : sequence of str
        ``table.key=value`` of the settings to change, see `app.settings.config.ANALYSED`.
    on_progress : callable
        Told the share that is done.
    threads : int, optional
        Of the image correlation; None: as the settings say. Results do not depend on it.

    Raises
    ------
    UserError, ConfigError
        There is no session, it has no images, or a setting cannot be changed.
    """
    with SessionReader(path) as session:
        config = settings_of(session, overrides)
        used = config
        if threads is not None:
            used = replace(config, dic=replace(config.dic, threads=threads))
        found = _analysed(session, used, lambda share: on_progress(FRAMES_SHARE * share))
        shots, law = found.taken.snapshots, found.conclusion.law
        instants = numbered_instants(shots, found.conclusion.summary)
        chosen = [shots[i] for i in instants]
        beside = [shots[i - 1] for i in instants if i] if used.camera.readout else []
        reference, background = (grey8(picture, used) for picture in found.pictures)
        even = pixel_correction(found.pattern)
        rest = [even(session.frame(number)[2]) for number in found.taken.at_rest[1:]]
        middle = (used.camera.width - 1) / 2, (used.camera.height - 1) / 2
        centre = found.contact.centre_px if found.contact else middle
        later = ((shot.frame, even(session.frame(shot.frame)[2])) for shot in reversed(chosen))
        return RunResult(
            origin=_origin(session, config),
            summary=found.conclusion.summary,
            contact=found.contact,
            pictures=Pictures(reference, background, used.camera.pixel),
            frames=found.taken.frames(),
            rings=found.taken.rings(),
            law=_law(shots, found.conclusion),
            instants=instants_of(
                used, session, found.pattern, (*found.taken.before, *beside), chosen, law.E
            ),
            noise=box_noise(used, found.pictures[0], rest),
            search=box_search(used, found.pictures[0], centre, later),
        )


class _AnalysedFrames(NamedTuple):
    """What all frames of a session gave, without the 160 MB of the correlation that gave it."""

    taken: _Taken
    conclusion: Conclusion
    contact: ContactResult | None
    pictures: tuple[Array | None, Array | None]
    pattern: PixelPattern | None


def _analysed(session: SessionReader, used: Config, on_progress: ShareDone) -> _AnalysedFrames:
    taken, frames = _Taken(), frames_of(session)
    pipeline = Pipeline(used, pattern_for(session, used))
    outcome = analyse(
        Analysis(used, pipeline),
        measurements_of(session),
        _triggers(session, pipeline.notes, on_progress),
        taken,
        lambda: (End.PLAYED, f"all {len(frames)} frames were analysed"),
        dict.fromkeys(frames, PROFILES),
    )
    if pipeline.conclusion is None or outcome.summary is None:
        raise UserError(
            f"{session.path}: none of its images is the one that was recorded; use a whole copy of"
            " it"
        )
    # the summary has a note on frames whose trigger is uncertain
    conclusion = pipeline.conclusion._replace(summary=outcome.summary)
    return _AnalysedFrames(taken, conclusion, pipeline.contact, pipeline.pictures, pipeline.pattern)


def settings_of(session: SessionReader, overrides: Sequence[str]) -> Config:
    """The settings of the analysis of a session.

    Raises
    ------
    UserError, ConfigError
        They do not fit the session, or a setting cannot be changed.
    """
    recorded = recorded_settings(session)
    check_agree(session, recorded)
    return revised(recorded, ("recording.results=fields", *overrides))


def content_of(session: SessionReader) -> str:
    """SHA-256 of all that a session recorded, of its images by their checksums."""
    header, found = session.header, hashlib.sha256()
    checksums = "/entry/triggers/checksum"
    sums = [session.file.read(session.dataset(checksums)).tolist()] if session.format >= 4 else []
    for part in (
        header.started,
        header.config_toml,
        session.triggers()[["index", "sample", "received"]].tolist(),
        session.forces().volts.tobytes(),
        [column.tolist() for column in session.positions()],
        session.events(),
        sums,
    ):
        found.update(part if isinstance(part, bytes) else repr(part).encode())
    return found.hexdigest()


def _triggers(
    session: SessionReader, notes: list[str], on_progress: ShareDone
) -> Iterator[Trigger]:
    """Every trigger with its image; `notes` gets a sentence about images that were altered."""
    count = len(session.triggers())
    records = (one for one in session.records() if isinstance(one, Frame | LostFrame))
    for done, (record, after) in enumerate(pairwise(chain(records, (None,)))):
        assert record is not None
        coming = (after.index, after.sample, after.image) if isinstance(after, Frame) else None
        yield record, record.image if isinstance(record, Frame) else None, coming
        on_progress((done + 1) / count)
    if altered := sum(isinstance(lost, LostFrame) for lost in session.altered):
        notes.append(f"{altered} images are not those that were recorded, and were left out")


class _Taken:
    """Takes the results of each frame, without its fields, thinned to `MOST_FRAMES`.

    Attributes
    ----------
    snapshots : list of Snapshot
    before : list of Snapshot
        What fields rest on: the last frame of the free block, and the reference.
    at_rest : list of int
        The first few frames under load and at rest.
    """

    def __init__(self) -> None:
        self.snapshots = Thinned[Snapshot](MOST_FRAMES)
        self.at_rest: list[int] = []
        self._free: list[Snapshot] = []
        self._reference: list[Snapshot] = []
        self._reference_frame = -1

    @property
    def before(self) -> list[Snapshot]:
        return self._free + self._reference

    def append(self, record: Record, /) -> None:
        if isinstance(record, Event) and record.kind == REFERENCE:
            self._reference_frame = record.number
        if not isinstance(record, Snapshot):
            return
        snapshot, phase = replace(record, field=None), record.conditions.phase
        if phase is Phase.BACKGROUND:
            self._free = [snapshot]
        elif phase is Phase.REFERENCE and len(self.at_rest) <= AT_REST:
            if snapshot.frame == self._reference_frame:
                self._reference = [snapshot]
            if self._reference:
                self.at_rest.append(snapshot.frame)
        self.snapshots.add(snapshot)

    def flush(self) -> None:
        """Do nothing: nothing is written."""

    def frames(self) -> Rows:
        """The numbers of every frame."""
        numbers = map(numbers_of, self.snapshots)
        return np.array([tuple(one[name] for name in ROW.names or ()) for one in numbers], ROW)

    def rings(self) -> RingSeries:
        """The profiles of every frame."""
        rings, stress = ([getattr(s, n) for s in self.snapshots] for n in ("rings", "stress"))
        return RingSeries(
            *(_table(rings, name) for name in ("radius_m", "ux_m", "sd_m")),
            *(_table(stress, name) for name in ("radius_m", "stress_pa", "sd_pa")),
        )


def _table(profiles: Sequence[object], name: str) -> F64:
    """One curve of each profile, NaN beyond its end and where there is no profile."""
    rows = [np.empty(0) if p is None else getattr(p, name) for p in profiles]
    table = np.full((len(rows), max(map(len, rows), default=0)), np.nan)
    for held, row in zip(table, rows, strict=True):
        held[: len(row)] = row
    return table


def _law(snapshots: Sequence[Snapshot], conclusion: Conclusion) -> LawSeries:
    """The points of the law in rows of all frames."""
    _, law, numbers = conclusion
    slip, ratio = (np.full((len(snapshots), len(law.radius)), np.nan) for _ in range(2))
    if len(law.slip):
        row_of = {s.frame: row for row, s in enumerate(snapshots)}
        for number, *points in zip(numbers, law.slip, law.ratio, strict=True):
            if number in row_of:
                slip[row_of[number]], ratio[row_of[number]] = points
    return LawSeries(slip, ratio)


def _origin(session: SessionReader, config: Config) -> Origin:
    outcome, header = session.outcome, session.header
    return Origin(
        session=session.path.name,
        started=header.started,
        state=outcome.ended_as,
        reason=outcome.reason,
        config_toml=to_toml(config),
        sample=header.sample,
        operator=header.operator,
        note=header.note,
        checksum=content_of(session),
    )
