"""Reads a session back, also one that was cut short, and refuses whatever is not one with a
sentence that says why.

A file is material from outside: what it says is checked (`app.session.checked`) before it is used.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Self
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.results import ContactResult, Counts, Event, Phase, Snapshot, Source, Summary
from app.session import layout
from app.session.checked import CheckedFile
from app.session.layout import FORMAT_ATTRIBUTE, FORMAT_VERSION, NO_ROW, TEXT

_ITEMS = {item.path: item for item in layout.ITEMS}
_NO_FIELD = np.empty((0, 0), np.float32)


class SessionReader:
    """A session on disk; use it in a ``with`` statement. Nothing but small tables is kept in
    memory.

    Attributes
    ----------
    format : int
        Version of the format in which it was written.

    Raises
    ------
    UserError
        From here and from every method: no such file, not a session, cut short, damaged, or written
        by a newer SlipScope.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._file = CheckedFile(self.path, "session")
        try:
            self._check_format()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()
        if (images := self.__dict__.get("_images", self)) is not self:
            images.close()

    @cached_property
    def source(self) -> Source | None:
        """The session that holds the images of a further analysis; None where they are in this
        file.
        """
        if not self._file.has("/entry/source"):
            return None
        return Source(self._text("/entry/source/session"), self._text("/entry/source/start_time"))

    @cached_property
    def lacking(self) -> frozenset[str]:
        """Attributes of a snapshot that this session is too old to hold; they read as NaN."""
        groups = {
            "results": layout.RESULTS,
            "rings": layout.RINGS,
            "stress": layout.STRESS,
            "fields": layout.FIELDS,
        }
        names = (
            (f"/entry/{group}/{name}", a)
            for group, columns in groups.items()
            for name, a in columns.items()
        )
        return frozenset(a for path, a in names if _ITEMS[path].since > self.format)

    @cached_property
    def config_toml(self) -> str:
        """The settings used, as TOML."""
        return self._text("/entry/settings/toml")

    @cached_property
    def sample_rate_hz(self) -> float:
        """Rate of the DAQ sample clock."""
        return self._quantity("/entry/clock/sample_rate")

    @cached_property
    def exposure_samples(self) -> int:
        """Samples per exposure."""
        return int(self._quantity("/entry/clock/exposure"))

    @cached_property
    def divisor(self) -> int:
        """Samples from one trigger to the next."""
        return int(self._quantity("/entry/clock/divisor"))

    @cached_property
    def first_trigger(self) -> int:
        """Sample of trigger 0."""
        return int(self._quantity("/entry/clock/first_trigger", -1))

    @cached_property
    def pixel_m(self) -> float:
        """Side of a pixel on the interface."""
        return self._quantity("/entry/instrument/camera/pixel")

    @cached_property
    def frame_shape(self) -> tuple[int, int]:
        """Rows and columns of an image."""
        rows, columns = self._dataset("/entry/instrument/camera/data").shape[1:]
        return int(rows), int(columns)

    @cached_property
    def frame_dtype(self) -> np.dtype[Any]:
        """Type of a pixel."""
        dtype: np.dtype[Any] = self._dataset("/entry/instrument/camera/data").dtype
        return dtype

    @cached_property
    def compression(self) -> str:
        """How the images in this file are compressed: "none" or "gzip"."""
        return (
            "gzip"
            if self._dataset("/entry/instrument/camera/data").compression == "gzip"
            else "none"
        )

    @cached_property
    def grid_x_px(self) -> NDArray[np.float64]:
        """Centres of the correlation boxes along x, shape (nx,)."""
        x: NDArray[np.float64] = self._read("/entry/fields/x")
        return x

    @cached_property
    def grid_y_px(self) -> NDArray[np.float64]:
        """Centres of the correlation boxes along y, shape (ny,)."""
        y: NDArray[np.float64] = self._read("/entry/fields/y")
        return y

    @cached_property
    def versions(self) -> dict[str, str]:
        """Name -> version of what the run ran on."""
        table = self._table("/entry/versions")
        return dict(zip(table["name"], table["version"], strict=True))

    @cached_property
    def started(self) -> str:
        """Time of day when the session was made, ISO 8601."""
        return self._text("/entry/start_time")

    @cached_property
    def ended(self) -> str:
        """Time of day when the run ended, ISO 8601; empty if it was not finished."""
        return self._text("/entry/end_time")

    @cached_property
    def state(self) -> str:
        """How the run ended: "done", "failed", or "unfinished" of a session cut short."""
        return self._text("/entry/run/state")

    @cached_property
    def reason(self) -> str:
        """Why the run ended, one sentence."""
        return self._text("/entry/run/reason")

    @cached_property
    def resources(self) -> dict[str, Any]:
        """Memory, processor and wall time of the run; empty if it was not finished."""
        with self._file.reading("/entry/run/resources"):
            return dict(json.loads(self._text("/entry/run/resources")))

    def events(self) -> list[Event]:
        """What happened, in order."""
        table = self._table("/entry/events")
        return [
            Event(int(s), kind, text)
            for s, kind, text in zip(table["sample"], table["kind"], table["text"], strict=True)
        ]

    def forces(self) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
        """First sample, readings in volts and forces in newtons, both (n, 2): normal, shear.

        Rows of missing samples are NaN.
        """
        table = self._table("/entry/forces")
        volts = np.column_stack([table["normal_sensor"], table["shear_sensor"]])
        return 0, volts, np.column_stack([table["normal_force"], table["shear_force"]])

    def stretches(self) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
        """First sample, volts and newtons of the forces between the gaps; an empty one at the end
        if they end with a gap.
        """
        start, volts, forces = self.forces()
        for first, count in [*self.gaps(), (len(volts), 0)]:
            yield start, volts[start:first], forces[start:first]
            start = first + count

    def gaps(self) -> list[tuple[int, int]]:
        """First sample and length of each gap in the forces."""
        table = self._table("/entry/gaps")
        return list(zip(table["first"].tolist(), table["count"].tolist(), strict=True))

    def positions(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Samples at which the stage was read, and its positions in metres."""
        table = self._table("/entry/instrument/actuator")
        return table["sample"], table["position"]

    def triggers(self) -> NDArray[np.void]:
        """Every trigger and its fate: fields index, sample, received, analysed, reason (why it was
        lost).
        """
        table = self._triggers
        kinds: list[tuple[str, Any]] = [
            ("index", "i8"),
            ("sample", "i8"),
            ("received", "?"),
            ("analysed", "?"),
            ("reason", object),
        ]
        rows = np.empty(len(table["index"]), dtype=kinds)
        rows["received"] = table["image"] != NO_ROW
        for name in ("index", "sample", "analysed", "reason"):
            rows[name] = table[name]
        return rows

    def lost_frames(self) -> list[tuple[int, int, str]]:
        """Index, sample and reason of each trigger without an image."""
        return [
            (int(row["index"]), int(row["sample"]), row["reason"])
            for row in self.triggers()
            if not row["received"]
        ]

    def frames(self) -> Iterator[tuple[int, int, NDArray[Any]]]:
        """Index, sample and image of each frame received, in the order of the triggers."""
        for index in self._frame_rows:
            yield self.frame(index)

    def frame(self, index: int) -> tuple[int, int, NDArray[Any]]:
        """Index, sample and image of the frame of trigger `index`."""
        if index not in self._frame_rows:
            raise UserError(
                f"{self.path}: there is no image of trigger {index} in this session; `slipscope"
                " info` lists what there is"
            )
        row = self._frame_rows[index]
        image = self._images._row("/entry/instrument/camera/data", self.image_row(index))
        if self._images is not self and crc32(image.data) != self._triggers["checksum"][row]:
            raise UserError(
                f"{self._images.path}: the image of trigger {index} is not the one that was"
                " analysed; use a whole copy of it"
            )
        return index, int(self._triggers["sample"][row]), image

    @property
    def images_path(self) -> Path:
        """The file that holds the images: this one, or the source."""
        return self._images.path

    def image_row(self, index: int) -> int:
        """Row of the image of trigger `index` in the file that holds the images."""
        return int(self._triggers["image"][self._frame_rows[index]])

    def analysed_frames(self) -> list[int]:
        """Trigger numbers of the frames analysed during the run, in that order."""
        return [int(index) for index in self._results["frame"]]

    def results(self) -> NDArray[np.void]:
        """The numbers found on each analysed frame, in order, by the names of `Snapshot`; NaN where
        this session is too old.
        """
        kinds: list[tuple[str, Any]] = [
            (attribute, _ITEMS[f"/entry/results/{name}"].dtype)
            for name, attribute in layout.RESULTS.items()
        ]
        rows = np.full(
            len(self._results["frame"]),
            0,
            dtype=[(name, "U16" if name == "phase" else kind) for name, kind in kinds],
        )
        for name, attribute in layout.RESULTS.items():
            rows[attribute] = self._results.get(name, np.nan)
        rows["phase"] = [self._phase(number) for number in self._results["phase"]]
        return rows

    def snapshots(self) -> Iterator[Snapshot]:
        """What was found on each analysed frame, in order."""
        yield from map(self.snapshot, range(len(self._results["frame"])))

    def snapshot(self, i: int) -> Snapshot:
        """What was found on the `i`-th analysed frame."""
        n = len(self._results["frame"])
        if not 0 <= i < n:
            raise UserError(
                f"{self.path}: result {i} was asked, this session has {n}, counted from 0"
            )
        row = {name: column[i].item() for name, column in self._results.items()}
        found = {
            attribute: row[name]
            for name, attribute in layout.RESULTS.items()
            if attribute not in self.lacking
        }
        found["phase"] = self._phase(row["phase"])
        rings = self._profiles("rings", layout.RINGS, i, row["ring_count"])
        stress = self._profiles("stress", layout.STRESS, i, row.get("stress_count", 0))
        return Snapshot(**found, **rings, **stress, **self._field(row["field"]))

    def contact(self) -> ContactResult | None:
        """The apparent contact; None where it was not measured."""
        if not self._file.has("/entry/contact"):
            return None
        values = {
            attribute: self._value(f"/entry/{name}") for name, attribute in layout.CONTACT.items()
        }
        return ContactResult(**values)

    def summary(self) -> Summary | None:
        """What the experiment comes down to; None in a run that was not finished or failed."""
        if not self._file.has("/entry/summary"):
            return None
        held = {
            name: attribute
            for name, attribute in layout.SUMMARY.items()
            if _ITEMS[f"/entry/summary/{name}"].since <= self.format
        }
        return Summary(
            **{attribute: self._value(f"/entry/summary/{name}") for name, attribute in held.items()}
        )

    def counts(self) -> Counts:
        """The account of the run; of a session cut short, of what is in the file."""
        if self._file.has("/entry/counts"):
            return Counts(
                **{
                    field.name: int(self._read(f"/entry/counts/{field.name}"))
                    for field in dataclasses.fields(Counts)
                }
            )
        triggers, frames, analysed = (
            len(self._triggers["index"]),
            len(self._frame_rows),
            len(set(self.analysed_frames())),
        )
        samples, lost = (
            len(self._table("/entry/forces")["normal_force"]),
            sum(count for _, count in self.gaps()),
        )
        return Counts(
            triggers=triggers,
            frames_received=frames,
            frames_recorded=frames,
            frames_lost=triggers - frames,
            frames_analysed=analysed,
            frames_skipped=frames - analysed,
            samples=samples - lost,
            samples_lost=lost,
        )

    @cached_property
    def _images(self) -> SessionReader:
        """The session that holds the images: this one, or the one beside it that was analysed once
        more.
        """
        if self.source is None:
            return self
        with self._file.reading("/entry/source/session"):
            path = self.path.with_name(self.source.session)
        if not path.is_file():
            raise UserError(
                f"{self.path}: its images are in {path.name}, which does not lie beside it; put"
                " both into one folder"
            )
        held = SessionReader(path)
        found = (held.source, held.started, held.frame_shape, held.frame_dtype)
        if found != (None, self.source.started, self.frame_shape, self.frame_dtype):
            held.close()
            raise UserError(
                f"{self.path}: {path.name} is not the session that was analysed; put that one"
                " beside it"
            )
        return held

    @cached_property
    def _triggers(self) -> dict[str, NDArray[Any]]:
        return self._table("/entry/triggers")

    @cached_property
    def _frame_rows(self) -> dict[int, int]:
        """Trigger number -> row of triggers, of the frames received."""
        received = np.flatnonzero(self._triggers["image"] != NO_ROW)
        return {int(self._triggers["index"][row]): int(row) for row in received}

    @cached_property
    def _results(self) -> dict[str, NDArray[Any]]:
        return self._table("/entry/results")

    def _phase(self, number: int) -> Phase:
        if not 0 <= number < len(layout.PHASES):
            raise self._damaged("/entry/results/phase", f"{number} is no phase")
        return layout.PHASES[number]

    def _profiles(self, group: str, columns: dict[str, str], i: int, count: int) -> dict[str, Any]:
        held = {
            name: attribute for name, attribute in columns.items() if attribute not in self.lacking
        }
        rows = {
            attribute: self._row(f"/entry/{group}/{name}", i) for name, attribute in held.items()
        }
        if not all(0 <= count <= len(row) for row in rows.values()):
            raise self._damaged(
                f"/entry/results/{group.removesuffix('s')}_count", f"{count} values are claimed"
            )
        return {attribute: row[:count] for attribute, row in rows.items()}

    def _field(self, row: int) -> dict[str, Any]:
        if row == NO_ROW:
            return dict.fromkeys(layout.FIELDS.values(), _NO_FIELD) | {
                "status": _NO_FIELD.astype(np.uint8)
            }
        held = {
            name: attribute
            for name, attribute in layout.FIELDS.items()
            if attribute not in self.lacking
        }
        found = {
            attribute: self._row(f"/entry/fields/{name}", row) for name, attribute in held.items()
        }
        return found | dict.fromkeys(
            self.lacking & set(layout.FIELDS.values()), np.full_like(found["ux_px"], np.nan)
        )

    def _check_format(self) -> None:
        version = self._file.number(FORMAT_ATTRIBUTE)
        if version is None or version < 1:
            raise UserError(
                f"{self.path}: an HDF5 file, but not a SlipScope session; give a file that"
                " `slipscope run` wrote"
            )
        if version > FORMAT_VERSION:
            raise UserError(
                f"{self.path}: written by a newer SlipScope (format {version}, this one reads"
                f" {FORMAT_VERSION}); bring SlipScope up to date"
            )
        self.format = version
        for item in layout.ITEMS:
            if item.group not in layout.LATER and item.since <= self.format:
                self._dataset(item.path)

    def _dataset(self, path: str) -> h5py.Dataset:
        item = _ITEMS[path]
        return self._file.dataset(path, item.shape, item.dtype)

    def _read(self, path: str) -> Any:
        return self._file.read(self._dataset(path))

    def _quantity(self, path: str, least: float = 0.0) -> float:
        """A number that must be finite and more than `least`."""
        value = float(self._read(path))
        if not least < value < math.inf:
            raise self._damaged(path, f"it is {value:g}")
        return value

    def _text(self, path: str) -> str:
        return str(self._read(path))

    def _value(self, path: str) -> Any:
        """A number, a pair of numbers as a tuple, an array, or a tuple of texts, as the result
        types hold them.
        """
        value, item = self._read(path), _ITEMS[path]
        if item.dtype == TEXT or item.shape == (2,):
            return tuple(value.tolist())
        return value if item.shape else float(value)

    def _row(self, path: str, row: int) -> NDArray[Any]:
        dataset = self._dataset(path)
        if not 0 <= row < dataset.shape[0]:
            raise self._damaged(path, f"row {row} is needed, it has {dataset.shape[0]}")
        with self._file.reading(path):
            values: NDArray[Any] = dataset[row]
            return values

    def _table(self, group: str) -> dict[str, NDArray[Any]]:
        """The columns of a group, cut to the shortest: a program that was killed may have
        lengthened only some.
        """
        held = [
            item
            for item in layout.items_of(group)
            if len(item.shape) == 1 and item.since <= self.format
        ]
        columns = {item.name: self._read(item.path) for item in held}
        rows = min(len(column) for column in columns.values())
        return {name: column[:rows] for name, column in columns.items()}

    def _damaged(self, path: str, found: str) -> UserError:
        return self._file.damaged(path, found)
