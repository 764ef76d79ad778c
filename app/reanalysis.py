"""A saved session analysed once more, with other settings: a second set of results in a file of its
own beside it.

The session is only read: what was measured is never written to again. The new file is a session
like any other, with its own settings, versions and computer, whose images are those of the first
(`/entry/source`); replay, export and `Session` take it as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from app.config import to_toml
from app.engine.pipeline import sensor_chain
from app.errors import UserError
from app.playback import Browser
from app.records import (
    Counts,
    Event,
    LostTrigger,
    Outcome,
    Position,
    Snapshot,
    Source,
    SourceFrame,
)
from app.replay import Replay
from app.session.reader import SessionReader
from app.session.versions import versions
from app.session.writer import SessionWriter

FLUSH_EVERY = 16  # frames


class Reanalysis(Replay):
    """A replay of every frame of a session, analysed during its run or not, that writes its results
    to `output`.

    Parameters
    ----------
    overrides : sequence of str
        ``table.key=value`` of the settings to change, see `app.config.ANALYSED`.

    Raises
    ------
    UserError, ConfigError
        There is no session, it has no images, or a setting can not be changed.
    """

    _done = "frames were analysed"

    def __init__(
        self,
        path: Path,
        output: Path,
        *,
        pace: float | None,
        overrides: Sequence[str] = (),
        overwrite: bool = False,
    ) -> None:
        super().__init__(path, pace=pace, overrides=overrides)
        with SessionReader(path) as session:
            self.source = session.header.source or Source(path.name, session.header.started)
            self.recorded_summary = session.outcome.summary
            kept = {path, session.images_path}
        if output.exists() and any(output.samefile(one) for one in kept):
            raise UserError(
                f"{output}: this is the session itself, which is never changed; give another name"
            )
        if output.absolute().parent.resolve() != path.absolute().parent.resolve():
            folder = path.absolute().parent
            raise UserError(
                f"{output}: a further analysis lies beside its session, which holds the images;"
                f" give a name in {folder}"
            )
        self.output = output
        self.title = f"{output.name}: {path.name} once more"
        self.browser = Browser(output)
        self._changes = ", ".join(overrides) or "the same settings"
        self._overwrite = overwrite
        self._writer: SessionWriter | None = None
        self._events: list[Event] = []
        self._lost: list[tuple[int, int, str]] = []
        self._lost_before = 0  # of the last frame that was analysed

    @property
    def can_browse(self) -> bool:
        """Whether any frame can be looked at: once the file is whole."""
        return self._outcome is not None and self._outcome.state == "done"

    def _frames_of(self, session: SessionReader) -> list[int]:
        received = session.triggers()["received"]
        if not received.any():
            raise UserError(
                f"{session.path}: there are no images in this session; nothing can be analysed"
            )
        return [int(index) for index in session.triggers()["index"][received]]

    def _begin(self, session: SessionReader) -> None:
        header = replace(
            session.header,
            config_toml=to_toml(self.config),
            pixel_m=self.pixel_m,
            grid_x_px=self.grid_x_px,
            grid_y_px=self.grid_y_px,
            versions=versions(),
            started="",
            source=self.source,
            compression="none",
        )
        self._writer = writer = SessionWriter.create(self.output, header, overwrite=self._overwrite)
        chain = sensor_chain(self.config)
        for block in session.samples():
            writer.append(replace(block, forces=chain.forces(block.volts)))
        for sample, metres in zip(
            *(column.tolist() for column in session.positions()), strict=True
        ):
            writer.append(Position(sample, metres))
        self._events = [event for event in session.events() if event.kind != "reference"]
        self._events.append(
            Event(
                len(session.forces().volts),
                "analysis",
                f"{session.path.name} once more, with {self._changes}",
            )
        )
        self._lost = session.lost_frames()

    def _take(
        self, session: SessionReader, number: int, snapshot: Snapshot, image: NDArray[Any]
    ) -> None:
        assert self._writer is not None
        self._write_lost_before(snapshot.frame)
        row, checksum = session.image_row(snapshot.frame), crc32(np.ascontiguousarray(image).data)
        self._writer.append(SourceFrame(snapshot.frame, snapshot.sample, row, checksum))
        if self._pipeline.reference_frame == snapshot.frame:
            self._events.append(Event(snapshot.sample, "reference", f"frame {snapshot.frame}"))
        self._writer.append(snapshot)
        if number % FLUSH_EVERY == 0:
            self._writer.flush()

    def _write_lost_before(self, index: float) -> None:
        assert self._writer is not None
        while self._lost_before < len(self._lost) and self._lost[self._lost_before][0] < index:
            self._writer.append(LostTrigger(*self._lost[self._lost_before]))
            self._lost_before += 1

    def _end(self, outcome: Outcome) -> Outcome:
        assert self._writer is not None
        if len(self._snapshots) == len(self._frames):
            self._write_lost_before(np.inf)
        for event in sorted(self._events, key=lambda event: event.sample):
            self._writer.append(event)
        contact = self.contact()
        if contact is not None:
            self._writer.append(contact)
        outcome = replace(outcome, counts=self._count())
        self._writer.append(outcome)
        self._writer.close()
        return replace(
            outcome, resources=outcome.resources | {"receipt": str(self._writer.receipt)}
        )

    def _count(self) -> Counts:
        done = len(self._snapshots)
        named = {
            "frames_received": done,
            "frames_recorded": done,
            "frames_analysed": done,
            "frames_lost": self._lost_before,
        }
        return replace(
            self._recorded_counts, triggers=done + self._lost_before, frames_skipped=0, **named
        )

    def _give_up(self) -> None:
        if self._writer is not None:
            self._writer.discard()
