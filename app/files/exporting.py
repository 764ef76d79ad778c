"""What a session or a file of results holds, in the files of other programs: images, tables,
arrays, ParaView, films.
"""

from __future__ import annotations

import math
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from analysis.arrays import F64
from app.evaluation.setup import sensor_chain, zeroed
from app.files.array_files import Array, session_arrays, table_arrays, write_mat, write_npz
from app.files.field_files import FieldTable, stated
from app.files.kinds import KINDS, RESULTS
from app.files.paraview import write_pvd
from app.files.tabular import Tables
from app.records.lens_motion import lens_xy_m
from app.records.quantities import counted
from app.records.record_types import STEP, ZERO, DisplacementField, Event, Snapshot
from app.session.datasets import with_revocations
from app.session.field_series import is_results
from app.session.reader import SessionReader
from app.session.result_tables import TABLES, results_table
from app.session.results import ResultsReader
from app.session.tables import SESSION, force_columns, session_table, stage_um
from app.settings.config import settings_of, to_toml
from app.system.disk import bytes_text
from app.system.errors import UserError
from app.system.outputs import check_output, check_output_folder, new_file, new_folder, write_csv
from app.system.progress import HowFar, unheard

# of an image: the sample of the forces on which its exposure began, its time from sample 0, the
# sample on which its phase did; P_N, Q_N: means over the exposure; stage_um: in its middle; first,
# last: triggers that may have taken it; step, step_sample: of the protocol, and where it began
FRAMES = "frame,sample,time_s,phase,phase_sample,P_N,Q_N,stage_um,file,reason,first,last,"
FRAMES += "step,step_sample,camera_s"
MOST_LOOKED_AT = 200  # fields, for the colour range of a film
# what an export of images, and one for ParaView, writes into a folder
_IMAGES = re.compile(r"\d{6,}\.tiff|(metadata|forces)\.csv|settings\.toml")
_FIELDS = re.compile(r"\d{6,}\.vti")
_READINGS = ("normal_V", "shear_V")


def export(
    held: str | os.PathLike[str],
    output: str | os.PathLike[str],
    what: str = "",
    *,
    frames: str = "",
    overwrite: bool = False,
    on_progress: HowFar = unheard,
) -> str:
    """Write what a session or a file of results holds; one sentence about what was written.

    Files appear only when they are complete; one frame at a time is in memory; for .mat,
    one array at a time.

    Parameters
    ----------
    held : str or Path
        The session, or the file of results.
    output : str or Path
        A folder (no ending), or a file with the ending .csv, .npz, .mat or, of a session, .pvd,
        .mp4 or .gif.
    what : str
        The content, such as ``"rings"``, a table of a .csv; empty: the first for that ending in the
        list of ``slipscope export --help``.
    frames : str
        Trigger numbers as ``first:end:step``, the end not included, or one number; empty: all.

    Raises
    ------
    UserError
        It cannot be written so, the output exists, or there is nothing to write; nothing was
        written.

    Examples
    --------
    >>> slipscope.export("sample7.h5", "rings.csv", "rings", frames="100:200")  # doctest: +SKIP
    'rings.csv: 2400 rows'
    """
    held, output = Path(held), Path(output)
    has_runs = is_results(held)
    kind = _kind(output, what, RESULTS if has_runs else KINDS)
    wanted = frame_range(frames) if frames else None
    if kind in KINDS[""]:
        check_output_folder(output, overwrite)
    else:
        name = "file of results" if has_runs else "session"
        check_output(output, overwrite, inputs={name: [held]})
    if has_runs:
        with ResultsReader(held) as results:
            tables = Tables(
                TABLES,
                lambda what: results_table(results, what, wanted),
                on_progress,
                wanted is not None,
            )
            if kind == "tables":
                return tables.write_all(output, overwrite)
            if kind == "arrays":
                return _write_arrays(table_arrays(tables), output, overwrite)
            return tables.write(kind, output, overwrite)
    with SessionReader(held) as reader:
        chosen = _Chosen(reader, wanted, on_progress)
        if kind in SESSION:
            return chosen.tables.write(kind, output, overwrite)
        return _WRITERS[kind](chosen, output, overwrite)


def _kind(output: Path, what: str, kinds: Mapping[str, tuple[str, ...]]) -> str:
    ending = "" if output.is_dir() else output.suffix.lower()
    if ending not in kinds:
        raise UserError(
            f"{output}: the ending '{ending}' is not known; give a folder (no ending) or"
            f" {', '.join(list(kinds)[1:])}"
        )
    if what and what not in kinds[ending]:
        able = ", ".join(dict.fromkeys(kinds[ending]))
        raise UserError(f"{output}: {what} cannot be written so; '{ending}' takes {able}")
    return what or kinds[ending][0]


def frame_range(text: str) -> range:
    """Trigger numbers from ``first:end:step`` or one number; all for an empty text.

    Raises
    ------
    UserError
        It is neither.
    """
    if re.fullmatch(r"\d{1,15}", text):
        return range(int(text), int(text) + 1)
    parts = re.fullmatch(r"(\d{0,15}):(\d{0,15})(?::(\d{1,15}))?", text or ":")
    if parts is None or int(parts[3] or 1) == 0:
        raise UserError(
            f"--frames: '{text}' cannot be read; give first:end:step, such as 10:200:5 (200 is not"
            " included), or one number"
        )
    return range(int(parts[1] or 0), int(parts[2] or 10**15), int(parts[3] or 1))


class _Chosen:
    """A session, and the frames of it that are to be written."""

    def __init__(self, reader: SessionReader, frames: range | None, tell: HowFar) -> None:
        self.reader, self.header, self.tell, self.frames = reader, reader.header, tell, frames
        wanted = frame_range("") if frames is None else frames
        triggers = with_revocations(reader.triggers(), reader.events())
        self.triggers = triggers[[int(index) in wanted for index in triggers["index"]]]
        # rows of results that have a displacement field
        results = enumerate(zip(reader.analysed_frames(), reader.have_fields(), strict=True))
        self.measured = [i for i, (index, is_there) in results if is_there and index in wanted]
        self.tables = Tables(
            tuple(SESSION),
            lambda what: session_table(reader, what, frames),
            tell,
            frames is not None,
        )

    def fields(self) -> Iterator[tuple[Snapshot, DisplacementField]]:
        """The displacement field of each frame that has one.

        Raises
        ------
        UserError
            None has.
        """
        if not self.measured:
            raise UserError(
                f"{self.reader.path}: no displacement field was measured on these frames;"
                " `slipscope info` lists what there is"
            )
        for n, i in enumerate(self.measured):
            self.tell(f"field {n + 1} of {len(self.measured)}", n / len(self.measured))
            snapshot = self.reader.snapshot(i)
            assert snapshot.field is not None
            yield snapshot, snapshot.field


def _write_images(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    reader, header, triggers = chosen.reader, chosen.header, chosen.triggers
    if not len(triggers):
        raise UserError(
            f"{reader.path}: it has none of the frames that were chosen; `slipscope info` says how"
            " many there are"
        )
    received = int(triggers["received"].sum())
    needed = received * math.prod(header.frame_shape) * np.dtype(header.frame_dtype).itemsize
    free = shutil.disk_usage(output.parent).free
    if needed > free:
        raise UserError(
            f"{output}: the images need {bytes_text(needed)}, {bytes_text(free)} are free; make"
            " room or choose --frames"
        )
    config, forces = settings_of(reader), force_columns(reader)
    for event in reader.events():
        if event.kind == ZERO:
            zero = zeroed(sensor_chain(config), event).zero_v
            if event.sample > 0 and zero != config.forces.zero:
                # by the settings, which have the last zero, the readings mean other forces
                forces = {name: forces[name] for name in forces if name not in _READINGS}
            config = replace(config, forces=replace(config.forces, zero=zero))
    settings = to_toml(config)
    with new_folder(output, overwrite, _IMAGES) as folder:
        exposures = _Exposures(reader)
        with _text(folder / "metadata.csv") as table:
            write_csv(table, [FRAMES.split(",")])
            for n, (index, sample, is_there, _, reason, first, last, stamp_s) in enumerate(
                triggers.tolist()
            ):
                name = f"{index:06d}.tiff" if is_there else ""
                chosen.tell(name or f"frame {index}", n / len(triggers))
                if is_there:
                    image = reader.frame(index)[2]
                    # uncompressed; OpenCV itself opens only some paths on Windows
                    _, encoded = cv2.imencode(".tiff", image, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
                    (folder / name).write_bytes(encoded.tobytes())
                stamp = repr(stamp_s) if math.isfinite(stamp_s) else ""
                row = [index, *exposures.cells(sample), name, reason, first, last]
                write_csv(table, [[*row, *exposures.step(sample), stamp]], digits=0)
        chosen.tables.write_to(folder / "forces.csv", "forces", forces)
        (folder / "settings.toml").write_text(settings, encoding="utf-8")
    return (
        f"{output}: {counted(received, 'image')},"
        f" {counted(len(triggers) - received, 'lost frame')}, metadata.csv, forces.csv,"
        " settings.toml"
    )


class _Exposures:
    """What the bench did during exposures, as cells of a table."""

    def __init__(self, reader: SessionReader) -> None:
        self._header, self._forces = reader.header, reader.forces().forces
        self._positions = reader.positions()
        self._phases = [event for event in reader.events() if event.kind == "phase"]
        self._steps = [event for event in reader.events() if event.kind == STEP]

    def cells(self, sample: int) -> list[Any]:
        """Cells sample, time_s, phase, phase_sample, P_N, Q_N, stage_um."""
        length = self._header.exposure_samples
        exposed = self._forces[sample : sample + length]
        forces = exposed.mean(axis=0) if len(exposed) else np.full(2, np.nan)
        phase = _last(self._phases, sample)
        stage = stage_um(*self._positions, np.array([sample + length / 2]))
        numbers = [*forces.tolist(), *stage.tolist()]
        began = [phase.text, phase.sample] if phase else ["", ""]
        return [sample, sample / self._header.sample_rate_hz, *began, *numbers]

    def step(self, sample: int) -> list[Any]:
        """Cells step and step_sample; empty where no step is known."""
        step = _last(self._steps, sample)
        return [step.number, step.sample] if step else ["", ""]


def _last(events: list[Event], sample: int) -> Event | None:
    """The last of some events at a sample."""
    return next((event for event in reversed(events) if event.sample <= sample), None)


def _text(path: Path) -> Any:
    return path.open("x", encoding="utf-8", newline="\n")


def _write_fields(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    x_px, y_px = chosen.header.grid_x_px, chosen.header.grid_y_px
    dic = settings_of(chosen.reader).dic
    with new_file(output, overwrite) as path, _text(path) as file:
        measured_in = stated(chosen.header.pixel_m, dic.averaging_box_px, dic.noise_box_px)
        table = FieldTable(file, x_px, y_px, ("lens_px", *measured_in))
        for snapshot, field in chosen.fields():
            lens_px = _lens_px(snapshot, chosen.header.pixel_m)[0]
            known = "" if math.isnan(lens_px) else lens_px
            table.append(snapshot.frame, field, known, *measured_in.values())
    return f"{output}: {counted(len(chosen.measured), 'field')} of {len(x_px) * len(y_px)} points"


def _lens_px(snapshot: Snapshot, pixel_m: float) -> tuple[float, float]:
    """Motion of the lens along x and y, NaN where it is not known."""
    if snapshot.motion is None:
        return math.nan, math.nan
    x_m, y_m = lens_xy_m(snapshot.motion)
    return x_m / pixel_m, y_m / pixel_m


def _write_arrays(arrays: Iterable[Array], output: Path, overwrite: bool) -> str:
    write = write_mat if output.suffix.lower() == ".mat" else write_npz
    with new_file(output, overwrite) as path:
        return f"{output}: {write(path, arrays)} arrays"


def _write_paraview(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    folder = output.with_suffix("")
    check_output_folder(folder, overwrite)
    with (
        new_file(output, overwrite) as path,
        new_folder(folder, overwrite, _FIELDS) as unfinished,
    ):
        write_pvd(path, unfinished, folder.name, chosen.header, chosen.fields())
    return f"{output}: {len(chosen.measured)} fields, one file each in {folder}"


def _write_film(what: str, chosen: _Chosen, output: Path, overwrite: bool) -> str:
    from app.files.film import RATES_HZ, FilmScene, write_film  # with matplotlib
    from app.report.figures import field_limits

    reader, header, shown = chosen.reader, chosen.header, chosen.measured
    axis, pixel_m = ("ux", "uy").index(what), chosen.header.pixel_m

    def map_of(snapshot: Snapshot, field: DisplacementField) -> F64:
        lens_px = _lens_px(snapshot, pixel_m)[axis]
        u_px = (field.ux_px, field.uy_px)[axis]
        return np.asarray((u_px.astype(np.float64) - np.nan_to_num(lens_px)) * (pixel_m * 1e6))

    def limits() -> tuple[float, float]:
        """The smallest and largest of the colours' ends of fields throughout the run."""
        ends = []
        for i in {shown[k] for k in np.linspace(0, len(shown) - 1, MOST_LOOKED_AT, dtype=int)}:
            snapshot = reader.snapshot(i)
            assert snapshot.field is not None
            ends.append(field_limits(map_of(snapshot, snapshot.field), is_signed=axis == 1))
        low, high = zip(*ends, strict=True)
        return min(low), max(high)

    shots = ((snapshot, map_of(snapshot, field)) for snapshot, field in chosen.fields())
    first = next(shots)  # refuses a session without fields
    if min(first[1].shape) < 2:
        raise UserError(f"{output}: a film needs two boxes or more along x and y")
    samples = reader.results()["sample"][shown]
    dt_s = float(np.median(np.diff(samples))) / header.sample_rate_hz if len(shown) > 1 else 0.25
    rate_hz = float(np.clip(1 / max(dt_s, 1e-9), *RATES_HZ))
    contact, (rows, columns) = reader.contact(), header.frame_shape
    centre = contact.centre_px if contact else (math.nan, math.nan)
    if not all(map(math.isfinite, centre)):
        centre = (columns - 1) / 2, (rows - 1) / 2
    x_mm, y_mm = (
        (grid - c) * pixel_m * 1e3
        for grid, c in zip((header.grid_x_px, header.grid_y_px), centre, strict=True)
    )
    radius_mm = contact.apparent_radius_m * 1e3 if contact else math.nan
    name = f"$u_{what[1]}$ (µm)"
    scene = FilmScene(x_mm, y_mm, name, limits(), axis == 1, radius_mm, rate_hz)
    with new_file(output, overwrite) as path:
        coding = write_film(path, scene, chain([first], shots))
    return (
        f"{output}: film of {len(shown)} fields, {rate_hz:.3g} images/s,"
        f" {rate_hz * dt_s:.3g} times as fast as the run, {coding}"
    )


_WRITERS: dict[str, Callable[[_Chosen, Path, bool], str]] = {
    "images": _write_images,
    "tables": lambda chosen, output, overwrite: chosen.tables.write_all(output, overwrite),
    "fields": _write_fields,
    "arrays": lambda chosen, output, overwrite: _write_arrays(
        session_arrays(chosen.reader, chosen.frames, chosen.measured, chosen.tell),
        output,
        overwrite,
    ),
    "paraview": _write_paraview,
    "ux": partial(_write_film, "ux"),
    "uy": partial(_write_film, "uy"),
}
