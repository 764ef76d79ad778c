"""A saved session analysed again with other settings: a second set of results, in a file of its own
beside the session.

The session is only read: what was measured is never written to again. The new file is a session
like any other, with its own settings, versions and computer, whose images are those of the first
(`/entry/source`); replay, export and `Session` take it as it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from zlib import crc32

from analysis.options import as_written
from app.records.record_types import REFERENCE, Event, Outcome, SourceSession, TriggerRow
from app.replay.browser import Browser, frames_of
from app.replay.loop import Measurements, Trigger, record_analysis
from app.replay.replay import Replay
from app.session.columns import storable
from app.session.files import check_new_session
from app.session.reader import SessionReader
from app.session.versions import versions
from app.settings.config import to_toml
from app.system.errors import UserError, spelled_out
from drivers.protocols import LostFrame


class Reanalysis(Replay):
    """A replay of every frame of a session, whether it was analysed during the run or not, that
    writes its results to `output`.

    Parameters
    ----------
    overrides : sequence of str
        ``table.key=value`` of the settings to change, see `app.settings.config.ANALYSED`.

    Raises
    ------
    UserError, ConfigError
        There is no session, it has no images, the output cannot be written, or a setting cannot
        be changed.
    """

    kind = "analysis"

    def __init__(
        self,
        path: Path,
        output: Path,
        *,
        pace: float | None,
        overrides: Sequence[str] = (),
        overwrite: bool = False,
    ) -> None:
        everything = "recording.results=fields"
        super().__init__(path, pace=pace, overrides=(everything, *overrides))
        with SessionReader(path) as session:
            self.source = session.header.source or SourceSession(path.name, session.header.started)
            self.recorded_summary = session.outcome.summary
            check_new_session(output, overwrite, read=[path, session.images_path])
        folder = path.absolute().parent
        if output.absolute().parent.resolve() != folder.resolve():
            raise UserError(
                f"{output}: a further analysis lies beside its session, which holds the images;"
                f" give a name in {folder}"
            )
        if self.source.session != spelled_out(storable(self.source.session)):
            raise UserError(
                f"{path}: a further analysis says which session it is of, and a file cannot hold"
                " this name; rename the session, to letters and digits"
            )
        self.output = output
        self.title = f"{output.name}: {path.name} analysed again"
        self.browser = Browser(output)
        self._changes = ", ".join(overrides) or "the same settings"
        self._overwrite = overwrite

    @property
    def can_browse(self) -> bool:
        """Whether any frame that was analysed can be looked at: once the file is complete."""
        return self._outcome is not None and self._outcome.state == "done" and self._done > 0

    def show(self, frame: int) -> None:
        """As of any replay, but no frame after the last one that was analysed."""
        super().show(min(frame, self._newest))

    def has_results(self, frame: int) -> bool:
        """Whether there are results of a recorded frame: of every one that was analysed."""
        return frame <= self._newest

    def _frames_of(self, session: SessionReader) -> list[int]:
        return frames_of(session)

    def _analyse(self, session: SessionReader) -> Outcome:
        header = replace(
            session.header,
            versions=versions(),
            config_toml=to_toml(self.config),
            pixel_m=self.pixel_m,
            grid_x_px=self.grid_x_px,
            grid_y_px=self.grid_y_px,
            started="",
            **as_written(self.config.about),
            source=self.source,
            compression="none",
            auxiliary=None,  # they stay in the session
            pattern=self._analysis.pipeline.pattern,
        )
        return record_analysis(
            self._analysis,
            self._measurements(session),
            self._triggers(session),
            header,
            self.output,
            lambda: self._ended_by("frames were analysed"),
            overwrite=self._overwrite,
        )

    def _measurements(self, session: SessionReader) -> Measurements:
        measured = super()._measurements(session)
        how = f"{session.path.name} analysed again, with {self._changes}"
        events = [event for event in measured.events if event.kind != REFERENCE]
        return replace(measured, events=[*events, Event(len(measured.volts), "analysis", how)])

    def _triggers(self, session: SessionReader) -> Iterator[Trigger]:
        rows = session.triggers().tolist()
        frames = self._read(session, [index for index, _, received, *_ in rows if received])
        for index, sample, received, _, reason, *span in rows:
            if not received:
                yield LostFrame(index, sample, reason, *span[:2]), None, None
                continue
            frame, after = next(frames, (None, None))
            if frame is None:
                return
            image, row = frame[2], session.image_row(index)
            yield TriggerRow(index, sample, row, "", 0, crc32(image.data), *span), image, after
        next(frames, None)  # shows the last one
