"""Writes a session while it happens: images at once, everything small in batches at each flush.

Write, then count: an image goes to the file before the row that says it is there, and a write that
fails is taken back, so that a full disk leaves a session without phantom rows. After `flush` the
file is complete in itself and on the disk. Beside it grows a journal (`journal`): with it `repair`
brings back what a killed program or a power cut left of the rest. `close` reads the session back,
holds it against the journal, and removes that only where both agree.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import re
from array import array
from bisect import bisect_left
from collections.abc import Mapping
from contextlib import ExitStack
from io import FileIO
from pathlib import Path
from typing import Any, Self
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from app.results import ContactResult, Event, Outcome, Snapshot, Source
from app.session import layout
from app.session.columns import Table, append_fields, append_image, make_group, storable
from app.session.files import abandon, check_room, new_files
from app.session.journal import Journal
from app.session.layout import GROUPS, LATER, NO_ROW
from app.session.receipt import Receipt, verify

LOOK_BYTES = 4096  # of each end of an image
# the missing samples are written as NaN; more than this is a wrong sample number, not a gap
LONGEST_GAP_S = 3600.0


class SessionWriter:
    """One session being recorded; made by `create`, used from one thread at a time.

    Attributes
    ----------
    receipt : Receipt or None
        After `close`: what was read back.
    """

    def __init__(
        self, path: Path, file: h5py.File, journal: Journal, sample_rate_hz: float
    ) -> None:
        self._path = path
        self._file = file
        self._journal = journal
        # the same file once more, to have it brought to the disk
        self._on_disk = FileIO(path, "r+")
        self.receipt: Receipt | None = None
        self._images = file["/entry/instrument/camera/data"]
        self._fields = [file[f"/entry/fields/{name}"] for name in layout.FIELDS]
        self._samples = Table(file, "/entry/forces")
        self._gaps = Table(file, "/entry/gaps")
        self._triggers = Table(file, "/entry/triggers")
        self._positions = Table(file, "/entry/instrument/actuator")
        self._events = Table(file, "/entry/events")
        self._results = Table(file, "/entry/results")
        self._rings = Table(file, "/entry/rings")
        self._stress = Table(file, "/entry/stress")
        self._field_frames = Table(file, "/entry/fields")
        self._longest_gap = int(LONGEST_GAP_S * sample_rate_hz)
        # triggers of the frames received, in their order, and their rows
        self._received, self._received_rows = array("q"), array("q")
        self._analysed: list[int] = []  # rows of triggers, marked at the next flush

    @classmethod
    def create(
        cls,
        path: Path,
        *,
        config_toml: str,
        sample_rate_hz: float,
        frame_shape: tuple[int, int],
        frame_dtype: np.dtype[Any],
        exposure_samples: int,
        divisor: int,
        first_trigger: int,
        pixel_m: float,
        grid_x_px: NDArray[np.float64],
        grid_y_px: NDArray[np.float64],
        versions: Mapping[str, str],
        started: str = "",
        source: Source | None = None,
        compression: str = "none",
        overwrite: bool = False,
    ) -> Self:
        """A new session at `path`, ready to record.

        Parameters
        ----------
        frame_shape : (int, int)
            Rows and columns of an image.
        first_trigger, divisor, exposure_samples : int
            Sample of trigger 0, samples per trigger, samples per exposure.
        grid_x_px, grid_y_px : ndarray, shape (nx,) and (ny,)
            Centres of the correlation boxes.
        versions : mapping
            Name -> version of the programs and libraries in use.
        started : str
            Time of day, ISO 8601; now if it is not given.
        source : Source, optional
            The session beside it that holds the images; then they are named by
            `append_source_frame`, not recorded.
        compression : str
            Of the images: "none" or "gzip".

        Raises
        ------
        UserError
            A session of that name exists and `overwrite` was not asked, or the file can not be made
            there.
        """
        path = Path(path)
        started = started or _now()
        sizes = {
            "rows": frame_shape[0],
            "columns": frame_shape[1],
            "nx": len(grid_x_px),
            "ny": len(grid_y_px),
            "programs": len(versions),
        }
        values: dict[str, Any] = {
            "/entry/title": "SlipScope loading experiment",
            "/entry/program_name": "SlipScope",
            "/entry/start_time": started,
            "/entry/end_time": "",
            "/entry/run/state": layout.UNFINISHED,
            "/entry/run/reason": "the session was not closed: the program ended before the run; `slipscope repair` brings back the rest",
            "/entry/run/resources": "{}",
            "/entry/settings/toml": config_toml,
            "/entry/versions/name": list(versions.keys()),
            "/entry/versions/version": list(versions.values()),
            "/entry/clock/sample_rate": sample_rate_hz,
            "/entry/clock/first_trigger": first_trigger,
            "/entry/clock/divisor": divisor,
            "/entry/clock/exposure": exposure_samples,
            "/entry/instrument/camera/pixel": pixel_m,
            "/entry/fields/x": grid_x_px,
            "/entry/fields/y": grid_y_px,
        }
        header = {
            "config_toml": config_toml,
            "sample_rate_hz": sample_rate_hz,
            "frame_shape": list(frame_shape),
            "frame_dtype": str(frame_dtype),
            "exposure_samples": exposure_samples,
            "divisor": divisor,
            "first_trigger": first_trigger,
            "pixel_m": pixel_m,
            "grid_x_px": np.asarray(grid_x_px).tolist(),
            "grid_y_px": np.asarray(grid_y_px).tolist(),
            "versions": dict(versions),
            "started": started,
            "source": dataclasses.asdict(source) if source else None,
            "compression": compression,
        }
        journal, file = new_files(path, overwrite)
        try:
            file.attrs.update(
                {
                    "NX_class": "NXroot",
                    "default": "entry",
                    "creator": "SlipScope",
                    layout.FORMAT_ATTRIBUTE: layout.FORMAT_VERSION,
                }
            )
            for group in GROUPS:
                if group.path not in LATER:
                    make_group(file, group, sizes, values, frame_dtype, compression)
            if source is not None:
                named = {
                    "/entry/source/session": source.session,
                    "/entry/source/start_time": source.started,
                }
                make_group(
                    file,
                    next(group for group in GROUPS if group.path == "/entry/source"),
                    {},
                    named,
                )
            file["/entry"].attrs["default"] = "results"
            journal.note("session", header)
            writer = cls(path, file, journal, sample_rate_hz)
            writer.flush()
            return writer
        except BaseException:
            file.close()
            journal.close()
            path.unlink(missing_ok=True)
            journal.path.unlink(missing_ok=True)
            raise

    def append_samples(
        self, first: int, volts: NDArray[np.float64], forces: NDArray[np.float64]
    ) -> None:
        """Record consecutive samples from number `first` on: readings in volts and forces in
        newtons, both (n, 2), normal and shear.

        Samples missing before them are recorded as a gap and as NaN.

        Raises
        ------
        ValueError
            `first` lies before a sample that is recorded already, or absurdly far after it.
        """
        self._check_place(first)
        if volts.shape != forces.shape or volts.shape[1:] != (2,):
            raise ValueError(
                f"session: volts {volts.shape} and forces {forces.shape} must both be (n, 2)"
            )
        self._journal.samples(first, volts, forces)
        self._add_samples(first, volts, forces)

    def _check_place(self, sample: int) -> None:
        expected = len(self._samples)
        if not 0 <= sample - expected <= self._longest_gap:
            raise ValueError(
                f"session: samples from {sample} on were given where {expected} comes next; they"
                " can not be placed"
            )

    def _add_samples(
        self, first: int, volts: NDArray[np.float64], forces: NDArray[np.float64]
    ) -> None:
        expected = len(self._samples)
        if missing := first - expected:
            self._gaps.append(first=expected, count=missing)
            nothing = np.full((missing, 2), np.nan)
            volts, forces = np.concatenate([nothing, volts]), np.concatenate([nothing, forces])
        self._samples.extend(
            normal_force=forces[:, 0],
            shear_force=forces[:, 1],
            normal_sensor=volts[:, 0],
            shear_sensor=volts[:, 1],
        )

    def append_gap(self, first: int, count: int, reason: str) -> None:
        """Record that `count` samples from `first` on are missing: rows of NaN, and an event that
        says why.
        """
        self._check_place(first)
        self._check_place(first + count)
        self._journal.note("gap", first, count, reason)
        nothing = np.full((count, 2), np.nan)
        self._add_samples(first, nothing, nothing)
        self._gaps.append(first=first, count=count)
        self._events.append(sample=first, kind="gap", text=f"{count} samples lost: {reason}")

    def append_frame(
        self, index: int, sample: int, image: NDArray[Any], checksum: int | None = None
    ) -> None:
        """Record the image of trigger `index`, exposed from `sample` on; it is written at once.
        `checksum` is its CRC-32, if it is known.

        Raises
        ------
        ValueError
            The image has another shape or dtype than the session.
        OSError
            It could not be written, or the disk is all but full; the session is as it was before
            and can be finished.
        """
        check_room(self._path, image.nbytes)
        image = np.ascontiguousarray(image)
        checksum = crc32(image.data) if checksum is None else checksum
        end = self._file.id.get_filesize()
        row, chunk = append_image(self._images, image)
        try:
            self._journal.note(
                "frame", index, sample, self._place_of(row, chunk, end), chunk.nbytes, checksum
            )
        except BaseException:
            self._images.resize(row, axis=0)
            raise
        self._add_frame(index, sample, row, checksum)

    def _place_of(self, row: int, chunk: NDArray[np.uint8], end: int) -> int:
        """Where in the file an image lies: where the file ended before, as a look shows; HDF5 goes
        through all images to tell.
        """
        if all(
            self._lies_at(end + at, chunk[at : at + LOOK_BYTES])
            for at in (0, max(0, chunk.nbytes - LOOK_BYTES))
        ):
            return end
        return int(self._images.id.get_chunk_info_by_coord((row, 0, 0)).byte_offset)

    def _lies_at(self, place: int, part: NDArray[np.uint8]) -> bool:
        self._on_disk.seek(place)
        return self._on_disk.read(part.nbytes) == part.tobytes()

    def append_source_frame(self, index: int, sample: int, row: int, checksum: int) -> None:
        """Record that the image of trigger `index` lies in that row of the source, with that
        CRC-32; OSError on an all but full disk.
        """
        check_room(self._path, 0)
        self._journal.note("source_frame", index, sample, row, checksum)
        self._add_frame(index, sample, row, checksum)

    def _add_frame(self, index: int, sample: int, row: int, checksum: int) -> None:
        self._received.append(index)
        self._received_rows.append(len(self._triggers))
        self._triggers.append(
            index=index, sample=sample, image=row, reason="", analysed=0, checksum=checksum
        )

    def append_lost_frame(self, index: int, sample: int, reason: str) -> None:
        """Record that trigger `index` gave no image, and why."""
        self._journal.note("lost_frame", index, sample, reason)
        self._triggers.append(
            index=index, sample=sample, image=NO_ROW, reason=reason, analysed=0, checksum=0
        )

    def append_position(self, sample: int, position_m: float) -> None:
        """Record where the stage was at `sample`."""
        self._journal.note("position", sample, position_m)
        self._positions.append(sample=sample, position=position_m)

    def append_event(self, event: Event) -> None:
        """Record something that happened."""
        self._journal.note("event", event.sample, event.kind, event.text)
        self._events.append(sample=event.sample, kind=event.kind, text=event.text)

    def append_snapshot(self, snapshot: Snapshot) -> None:
        """Record what was found on a frame, which must be recorded already. Its field, if it has
        one, is written at once.

        Raises
        ------
        ValueError
            The frame is not in the session, or its field is not on the session's grid.
        OSError
            The field could not be written; the session is as it was before.
        """
        place = bisect_left(self._received, snapshot.frame)
        if self._received[place : place + 1] != array("q", [snapshot.frame]):
            raise ValueError(
                f"session: results of frame {snapshot.frame} were given, but that frame is not"
                " recorded"
            )
        field = NO_ROW
        if snapshot.ux_px.size:
            field = append_fields(
                self._fields, [getattr(snapshot, name) for name in layout.FIELDS.values()]
            )
            self._field_frames.append(frame=snapshot.frame)
        self._analysed.append(self._received_rows[place])
        self._rings.append(
            **{name: getattr(snapshot, attribute) for name, attribute in layout.RINGS.items()}
        )
        self._stress.append(
            **{name: getattr(snapshot, attribute) for name, attribute in layout.STRESS.items()}
        )
        row = {name: getattr(snapshot, attribute) for name, attribute in layout.RESULTS.items()}
        row["phase"] = layout.PHASES.index(snapshot.phase)
        counts = {
            "ring_count": len(snapshot.ring_radius_m),
            "stress_count": len(snapshot.stress_radius_m),
        }
        self._results.append(**row, **counts, field=field)

    def write_contact(self, contact: ContactResult) -> None:
        """Record the apparent contact, once."""
        values = {
            f"/entry/{name}": getattr(contact, attribute)
            for name, attribute in layout.CONTACT.items()
        }
        self._make("/entry/profile", values, profile=len(contact.profile_grey))
        self._make("/entry/contact", values)

    def finish(self, outcome: Outcome) -> None:
        """Record how the run ended, once."""
        if not self._file:
            raise OSError(
                f"{self._path}: it could not be written to its end; `slipscope repair` brings back"
                " everything"
            )
        self._make(
            "/entry/counts",
            {
                f"/entry/counts/{name}": value
                for name, value in dataclasses.asdict(outcome.counts).items()
            },
        )
        if outcome.summary is not None:
            values = {
                f"/entry/summary/{name}": getattr(outcome.summary, attribute)
                for name, attribute in layout.SUMMARY.items()
            }
            self._make("/entry/summary", values, notes=len(outcome.summary.notes))
        self._write_text("/entry/run/resources", json.dumps(outcome.resources, default=str))
        self._write_text("/entry/run/reason", outcome.reason)
        self._write_text("/entry/end_time", _now())
        self.flush()
        self._write_text("/entry/run/state", outcome.state)
        self.flush()

    def explain(self, reason: str) -> None:
        """Record why a session is not the account of a whole run."""
        self._write_text("/entry/run/reason", reason)

    def flush(self) -> None:
        """Bring everything recorded so far to the disk; the file is readable from there on,
        whatever happens to the program.

        The images come before the journal that names them, so that what the journal on the disk
        promises is there.

        Raises
        ------
        OSError
            It could not be written. The session is closed then, as it is, for HDF5 may spoil what
            is there if it goes on; the journal and the images hold everything.
        """
        try:
            for table in (self._gaps, self._samples, self._triggers, self._positions, self._events):
                table.flush()
            for table in (self._rings, self._stress, self._field_frames, self._results):
                table.flush()
            if self._analysed:
                self._file["/entry/triggers/analysed"][sorted(set(self._analysed))] = 1
                self._analysed.clear()
            self._file.flush()
        except (OSError, RuntimeError) as error:
            cause = re.search("error message = '([^']*)'", str(error))  # of many lines by HDF5
            abandon(self._file, self._on_disk, self._journal)
            found = cause[1] if cause else " ".join(str(error).split())
            raise OSError(
                f"{self._path}: it can not be written: {found}; `slipscope repair` brings back"
                " everything"
            ) from error
        os.fsync(self._on_disk.fileno())
        self._journal.sync()

    def close(self) -> None:
        """Flush, let go of the file, read it back, remove the journal. May be called twice; a
        session that was not finished says so.

        Raises
        ------
        OSError
            The last rows could not be written.
        UserError
            What was read back is not what was recorded. The journal is kept in both cases.
        """
        if not self._file:
            return
        with ExitStack() as closing:
            for thing in (self._journal, self._on_disk, self._file):
                closing.callback(thing.close)
            self.flush()
        self.receipt = verify(self._path, self._journal.path)
        self._journal.path.unlink()

    def discard(self) -> None:
        """Let go of the session and remove it, with its journal."""
        with ExitStack() as closing:
            for path in (self._journal.path, self._path):
                closing.callback(path.unlink, missing_ok=True)
            closing.callback(abandon, self._file, self._on_disk, self._journal)

    def _make(self, path: str, values: Mapping[str, Any], **sizes: int) -> None:
        group = next(group for group in GROUPS if group.path == path)
        make_group(self._file, group, sizes, values)

    def _write_text(self, path: str, text: str) -> None:
        self._file[path][()] = storable(text)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).astimezone().isoformat(timespec="seconds")
