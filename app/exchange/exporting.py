"""What a session holds, in the files of other programs: images, tables, arrays, ParaView."""

from __future__ import annotations

import csv
import math
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.config import from_record, to_toml
from app.errors import UserError
from app.exchange.arrays import write_mat, write_npz
from app.exchange.fields import FieldTable
from app.exchange.paraview import write_pvd
from app.exchange.tables import cell_of
from app.numbers import NUMBERS
from app.outputs import check_output, check_output_folder, new_file, new_folder
from app.records import (
    DisplacementField,
    Snapshot,
)
from app.session.reader import SessionReader

KINDS = {  # ending -> what can be written so; the first is the default
    "": ("images",),
    ".csv": ("fields", "results", "forces"),
    ".npz": ("arrays",),
    ".mat": ("arrays",),
    ".pvd": ("paraview",),
}
FRAMES = "frame,sample,time_s,phase,phase_sample,P_N,Q_N,stage_um,file,reason,first,last"
FORCES = "sample,time_s,P_N,Q_N,normal_V,shear_V,stage_um"
BLOCK = 8192  # samples of a forces table made at a time
# what an export writes into a folder
_OURS = re.compile(r"\d{6,}\.(tiff|vti)|(metadata|forces)\.csv|settings\.toml")


def export(
    session: Path,
    output: Path,
    what: str = "",
    *,
    frames: str = "",
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] = lambda text, share: None,
) -> str:
    """Write what a session holds; one sentence about what was written.

    Files appear only when they are complete; one frame at a time is in memory (but see
    `app.exchange.arrays.write_mat`).

    Parameters
    ----------
    output : Path
        A folder (no ending), or a file whose ending is in `KINDS`.
    what : str
        One of `KINDS` for that ending; empty: the first.
    frames : str
        Trigger numbers as ``first:end:step``, the end not included, or one number; empty: all.

    Raises
    ------
    UserError
        It can not be written so, the output exists, or there is nothing to write; nothing was
        written.
    """
    kind = _kind(output, what)
    if frames and kind == "forces":
        raise UserError(
            f"{output}: the forces are written sample by sample, not for frames {frames}; leave"
            " --frames out"
        )
    wanted = frame_range(frames)
    if kind == "images":
        check_output_folder(output, overwrite)
    else:
        check_output(output, overwrite, inputs={"session": [session]})
    with SessionReader(session) as reader:
        return _WRITERS[kind](_Chosen(reader, wanted, on_progress), output, overwrite)


def _kind(output: Path, what: str) -> str:
    ending = "" if output.is_dir() else output.suffix.lower()
    if ending not in KINDS:
        raise UserError(
            f"{output}: the ending '{ending}' is not known; give a folder (no ending) or"
            f" {', '.join(list(KINDS)[1:])}"
        )
    if what and what not in KINDS[ending]:
        raise UserError(
            f"{output}: {what} can not be written so; '{ending}' takes {' or '.join(KINDS[ending])}"
        )
    return what or KINDS[ending][0]


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
            f"--frames: '{text}' can not be read; give first:end:step, such as 10:200:5 (200 is not"
            " included), or one number"
        )
    return range(int(parts[1] or 0), int(parts[2] or 10**15), int(parts[3] or 1))


class _Chosen:
    """A session, and the frames of it that are to be written."""

    def __init__(
        self, reader: SessionReader, wanted: range, tell: Callable[[str, float], None]
    ) -> None:
        self.reader, self.header, self.tell = reader, reader.header, tell
        triggers = reader.triggers()
        self.triggers = triggers[[int(index) in wanted for index in triggers["index"]]]
        # rows of results, and those of them that have a displacement field
        self.rows = [i for i, index in enumerate(reader.analysed_frames()) if index in wanted]
        has_field = reader.have_fields()
        self.measured = [i for i in self.rows if has_field[i]]

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
            f"{output}: the images need {needed / 1e9:.2f} GB, {free / 1e9:.2f} GB are free; make"
            " room or choose --frames"
        )
    settings = to_toml(from_record(header.config_toml, f"{reader.path}: settings"))
    with new_folder(output, overwrite, _OURS) as folder:
        exposures = _Exposures(reader)
        with _text(folder / "metadata.csv") as table:
            table.write(
                "# sample: that of the forces on which the exposure began; time_s: from sample 0;"
                " phase_sample: on which its phase did; first, last: triggers that may have taken"
                " it;\n"
                "# P_N, Q_N: means over the exposure; stage_um: in its middle. A pixel is"
                f" {header.pixel_m * 1e6:.9g} um\n{FRAMES}\n"
            )
            cells = csv.writer(table, lineterminator="\n")
            for n, (index, sample, is_there, _, reason, *span) in enumerate(triggers.tolist()):
                name = f"{index:06d}.tiff" if is_there else ""
                chosen.tell(name or f"frame {index}", n / len(triggers))
                if is_there:
                    image = reader.frame(index)[2]
                    # uncompressed; OpenCV itself opens only some paths on Windows
                    _, encoded = cv2.imencode(".tiff", image, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
                    (folder / name).write_bytes(encoded.tobytes())
                cells.writerow([index, *exposures.cells(sample), name, cell_of(reason), *span])
        _forces_table(chosen, folder / "forces.csv")
        (folder / "settings.toml").write_text(settings, encoding="utf-8")
    return (
        f"{output}: {received} images, {len(triggers) - received} lost frames, metadata.csv,"
        " forces.csv, settings.toml"
    )


class _Exposures:
    """What the bench did during exposures, as cells of a table."""

    def __init__(self, reader: SessionReader) -> None:
        self._header, self._forces = reader.header, reader.forces().forces
        self._stage_um = _stage_um(reader)
        self._phases = [event for event in reader.events() if event.kind == "phase"]

    def cells(self, sample: int) -> list[str]:
        """Cells sample, time_s, phase, phase_sample, P_N, Q_N, stage_um."""
        length = self._header.exposure_samples
        exposed = self._forces[sample : sample + length]
        forces = exposed.mean(axis=0) if len(exposed) else np.full(2, np.nan)
        phase = next((event for event in reversed(self._phases) if event.sample <= sample), None)
        numbers = [*forces.tolist(), float(self._stage_um(np.array([sample + length / 2]))[0])]
        return [
            str(sample),
            _cell(sample / self._header.sample_rate_hz),
            cell_of(phase.text) if phase else "",
            str(phase.sample) if phase else "",
            *map(_cell, numbers),
        ]


def _stage_um(reader: SessionReader) -> Callable[[NDArray[Any]], NDArray[np.float64]]:
    """A function that gives the position of the stage in um at samples.

    Positions are linear between the readings, and NaN if there are none.
    """
    samples, metres = reader.positions()
    known = np.isfinite(metres)
    if not known.any():
        return lambda at: np.full(len(at), np.nan)
    return lambda at: np.interp(at, samples[known], metres[known] * 1e6)


def _cell(value: float) -> str:
    """The number with all its digits, so that reading it gives the same bits; nothing for NaN."""
    return "" if math.isnan(value) else repr(value)


def _text(path: Path) -> Any:
    return path.open("x", encoding="utf-8", newline="\n")


def _write_forces(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    with new_file(output, overwrite) as path:
        return f"{output}: {_forces_table(chosen, path)} samples"


def _forces_table(chosen: _Chosen, path: Path) -> int:
    """Write all samples, one a line; how many there are."""
    rate = chosen.header.sample_rate_hz
    held, stage_um = chosen.reader.forces(), _stage_um(chosen.reader)
    count, channels = len(held.volts), chosen.header.auxiliary
    further = channels.labels if channels else []
    with _text(path) as table:
        table.write(
            f"# {rate:.9g} samples a second; cells of missing samples are empty\n"
            f"{','.join([FORCES, *further])}\n"
        )
        for start in range(0, count, BLOCK):
            chosen.tell("forces", start / count)
            part, samples = slice(start, start + BLOCK), np.arange(start, min(start + BLOCK, count))
            columns = [held.forces[part], held.volts[part], stage_um(samples)]
            if held.auxiliary is not None:
                columns.append(held.auxiliary[part])
            rows = np.column_stack(columns)
            for sample, row in zip(samples.tolist(), rows.tolist(), strict=True):
                table.write(f"{sample},{sample / rate!r},{','.join(map(_cell, row))}\n")
    return count


def _write_results(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    if not chosen.rows:
        raise UserError(
            f"{chosen.reader.path}: none of these frames was analysed; `slipscope info` lists what"
            " there is"
        )
    with new_file(output, overwrite) as path, _text(path) as table:
        table.write(",".join(NUMBERS) + "\n")
        for row in chosen.reader.results()[chosen.rows].tolist():
            cells = (_cell(v) if isinstance(v, float) else cell_of(str(v)) for v in row)
            table.write(",".join(cells) + "\n")
    return f"{output}: results of {len(chosen.rows)} frames"


def _write_fields(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    x_px, y_px = chosen.header.grid_x_px, chosen.header.grid_y_px
    with new_file(output, overwrite) as path, _text(path) as file:
        file.write(
            f"# a pixel is {chosen.header.pixel_m * 1e6:.9g} um; (0, 0) is the centre of the"
            " top-left pixel, y points down; the motion of the lens is not taken off\n"
        )
        table = FieldTable(file, x_px, y_px)
        for snapshot, field in chosen.fields():
            table.append(snapshot.frame, field)
    return f"{output}: {len(chosen.measured)} fields of {len(x_px) * len(y_px)} points"


def _write_arrays(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    write = write_mat if output.suffix.lower() == ".mat" else write_npz
    with new_file(output, overwrite) as path:
        return f"{output}: {write(path, chosen.reader, chosen.rows, chosen.tell)} arrays"


def _write_paraview(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    folder = output.with_suffix("")
    check_output_folder(folder, overwrite)
    with (
        new_file(output, overwrite) as path,
        new_folder(folder, overwrite, _OURS) as unfinished,
    ):
        write_pvd(path, unfinished, folder.name, chosen.header, chosen.fields())
    return f"{output}: {len(chosen.measured)} fields, one file each in {folder}"


_WRITERS: dict[str, Callable[[_Chosen, Path, bool], str]] = {
    "images": _write_images,
    "fields": _write_fields,
    "results": _write_results,
    "forces": _write_forces,
    "arrays": _write_arrays,
    "paraview": _write_paraview,
}
