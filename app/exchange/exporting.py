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
from app.exchange.arrays import write_mat, write_npz, write_pvd
from app.exchange.fields import FieldTable
from app.outputs import check_output, check_output_folder, new_file, new_folder
from app.results import Snapshot
from app.session import layout
from app.session.reader import SessionReader

Tell = Callable[[str, float], None]

KINDS = {  # ending -> what can be written so, the first unasked
    "": ("images",),
    ".csv": ("fields", "results", "forces"),
    ".npz": ("arrays",),
    ".mat": ("arrays",),
    ".pvd": ("paraview",),
}
FRAMES = "frame,sample,time_s,phase,phase_sample,P_N,Q_N,stage_um,file,reason"
FORCES = "sample,time_s,P_N,Q_N,normal_V,shear_V,stage_um"
BLOCK = 8192  # samples of a forces table made at a time
# what an export writes into a folder
_OWN = re.compile(r"\d{6,}\.(tiff|vti)|(metadata|forces)\.csv|settings\.toml")


def export(
    session: Path,
    output: Path,
    what: str = "",
    *,
    frames: str = "",
    overwrite: bool = False,
    on_progress: Tell | None = None,
) -> str:
    """What was written, one sentence. Files appear only when they are complete; one frame at a time
    is in memory (see `write_mat`).

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
        Something asked can not be done, the output exists, or there is nothing to write; nothing
        was written.
    """
    kind = _kind(output, what)
    if frames and kind == "forces":
        raise UserError(
            f"{output}: the forces are written sample by sample, frames {frames} were asked of"
            " them; leave --frames out"
        )
    wanted = frame_range(frames)
    if kind == "images":
        check_output_folder(output, overwrite)
    else:
        check_output(output, overwrite, inputs={"session": [session]})
    with SessionReader(session) as reader:
        chosen = _Chosen(reader, wanted, on_progress or (lambda _text, _share: None))
        return _WRITERS[kind](chosen, output, overwrite)


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
    """Trigger numbers from ``first:end:step`` or one number; empty: all.

    Raises
    ------
    UserError
        It is neither.
    """
    single = re.fullmatch(r"\d{1,15}", text)
    parts = re.fullmatch(r"(\d{0,15}):(\d{0,15})(?::(\d{1,15}))?", text)
    if single:
        return range(int(text), int(text) + 1)
    if text and (parts is None or (parts[3] is not None and int(parts[3]) == 0)):
        raise UserError(
            f"--frames: '{text}' was asked; give first:end:step, such as 10:200:5 (200 is not"
            " included), or one number"
        )
    first, end, step = parts.groups() if parts else ("", "", "")
    return range(int(first or 0), int(end or 10**15), int(step or 1))


class _Chosen:
    """A session, and the frames of it that were asked for."""

    def __init__(self, reader: SessionReader, wanted: range, tell: Tell) -> None:
        self.reader, self.tell = reader, tell
        triggers = reader.triggers()
        self.triggers = triggers[[int(index) in wanted for index in triggers["index"]]]
        # rows of results
        self.results = [i for i, index in enumerate(reader.analysed_frames()) if index in wanted]

    def snapshots(self) -> Iterator[Snapshot]:
        """What was found on each of the frames, with progress."""
        for n, i in enumerate(self.results):
            self.tell(f"frame {n + 1} of {len(self.results)}", n / len(self.results))
            yield self.reader.snapshot(i)

    def has_fields(self) -> None:
        """Refuse frames without displacement fields."""
        if not any(self.reader.snapshot(i).ux_px.size for i in reversed(self.results)):
            raise UserError(
                f"{self.reader.path}: no displacement field was measured on these frames;"
                " `slipscope info` lists what there is"
            )


def _write_images(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    reader, triggers = chosen.reader, chosen.triggers
    if not len(triggers):
        raise UserError(
            f"{reader.path}: it has none of the frames that were asked; `slipscope info` says how"
            " many there are"
        )
    received = int(triggers["received"].sum())
    needed = received * int(np.prod(reader.frame_shape)) * reader.frame_dtype.itemsize
    free = shutil.disk_usage(output.parent).free
    if needed > free:
        raise UserError(
            f"{output}: the images need {needed / 1e9:.2f} GB, {free / 1e9:.2f} GB are free; make"
            " room or choose --frames"
        )
    settings = to_toml(from_record(reader.config_toml, f"{reader.path}: settings"))
    with new_folder(output, overwrite, _OWN) as folder:
        rows = _Conditions(reader)
        with _text(folder / "metadata.csv") as table:
            table.write(
                "# sample: that of the forces on which the exposure began; time_s: from sample 0;"
                " phase_sample: on which its phase did;\n"
                "# P_N, Q_N: means over the exposure; stage_um: in its middle. A pixel is"
                f" {reader.pixel_m * 1e6:.9g} um\n{FRAMES}\n"
            )
            cells = csv.writer(table, lineterminator="\n")
            for n, (index, sample, is_there, _, reason) in enumerate(triggers.tolist()):
                name = f"{index:06d}.tiff" if is_there else ""
                chosen.tell(name or f"frame {index}", n / len(triggers))
                if is_there:
                    _, pixels = cv2.imencode(
                        ".tiff", reader.frame(index)[2], [cv2.IMWRITE_TIFF_COMPRESSION, 1]
                    )
                    # OpenCV itself opens only some paths on Windows
                    (folder / name).write_bytes(pixels.tobytes())
                cells.writerow([index, *rows.of(sample), name, reason])
        _forces_table(chosen, folder / "forces.csv")
        (folder / "settings.toml").write_text(settings, encoding="utf-8")
    return (
        f"{output}: {received} images, {len(triggers) - received} lost frames, metadata.csv,"
        " forces.csv, settings.toml"
    )


class _Conditions:
    """What the bench did during an exposure, as the cells of a table."""

    def __init__(self, reader: SessionReader) -> None:
        self._rate, self._exposure = reader.sample_rate_hz, reader.exposure_samples
        self._forces = reader.forces()[2]
        self._stage = _stage_um(reader)
        self._phases = [
            (event.sample, event.text) for event in reader.events() if event.kind == "phase"
        ]

    def of(self, sample: int) -> list[str]:
        """Cells sample, time_s, phase, phase_sample, P_N, Q_N, stage_um."""
        exposed = self._forces[sample : sample + self._exposure]
        forces = exposed.mean(axis=0) if len(exposed) else np.full(2, np.nan)
        began, phase = next(
            (found for found in reversed(self._phases) if found[0] <= sample), ("", "")
        )
        stage = self._stage(np.array([sample + self._exposure / 2]))
        return [
            str(sample),
            _cell(sample / self._rate),
            phase,
            str(began),
            *map(_cell, forces.tolist()),
            _cell(float(stage[0])),
        ]


def _stage_um(reader: SessionReader) -> Callable[[NDArray[Any]], NDArray[np.float64]]:
    """Position of the stage in um at samples, linear between its readings; NaN where it was never
    read.
    """
    samples, metres = reader.positions()
    known = np.isfinite(metres)
    if not known.any():
        return lambda at: np.full(len(at), np.nan)
    return lambda at: np.interp(at, samples[known], metres[known] * 1e6)


def _cell(value: float) -> str:
    """The number with all its digits, so that it comes back to the bit; nothing for NaN."""
    return "" if math.isnan(value) else repr(value)


def _text(path: Path) -> Any:
    return path.open("x", encoding="utf-8", newline="\n")


def _write_forces(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    with new_file(output, overwrite) as path:
        return f"{output}: {_forces_table(chosen, path)} samples"


def _forces_table(chosen: _Chosen, path: Path) -> int:
    """Number of samples written, one a line, missing ones without forces."""
    reader = chosen.reader
    first, volts, newtons = reader.forces()
    stage = _stage_um(reader)
    with _text(path) as table:
        table.write(
            f"# {reader.sample_rate_hz:.9g} samples a second; cells of missing samples are"
            f" empty\n{FORCES}\n"
        )
        for start in range(0, len(volts), BLOCK):
            chosen.tell("forces", start / len(volts))
            samples = np.arange(start, min(start + BLOCK, len(volts))) + first
            rows = np.column_stack(
                [newtons[start : start + BLOCK], volts[start : start + BLOCK], stage(samples)]
            ).tolist()
            for sample, row in zip(samples.tolist(), rows, strict=True):
                table.write(
                    f"{sample},{sample / reader.sample_rate_hz!r},{','.join(map(_cell, row))}\n"
                )
    return len(volts)


def _write_results(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    if not chosen.results:
        raise UserError(
            f"{chosen.reader.path}: none of these frames was analysed; `slipscope info` lists what"
            " there is"
        )
    names = list(layout.RESULTS.values())
    with new_file(output, overwrite) as path, _text(path) as table:
        table.write(",".join(names) + "\n")
        for snapshot in chosen.snapshots():
            values = (getattr(snapshot, name) for name in names)
            table.write(
                ",".join(_cell(v) if isinstance(v, float) else str(v) for v in values) + "\n"
            )
    return f"{output}: results of {len(chosen.results)} frames"


def _write_fields(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    reader = chosen.reader
    chosen.has_fields()
    count = 0
    with new_file(output, overwrite) as path, _text(path) as file:
        file.write(
            f"# a pixel is {reader.pixel_m * 1e6:.9g} um; (0, 0) is the centre of the top-left"
            " pixel, y points down; the motion of the lens is not taken off\n"
        )
        table = FieldTable(file, reader.grid_x_px, reader.grid_y_px)
        for snapshot in chosen.snapshots():
            if snapshot.ux_px.size:
                table.append(snapshot.frame, snapshot)
                count += 1
    points = len(reader.grid_x_px) * len(reader.grid_y_px)
    return f"{output}: {count} fields of {points} points"


def _write_arrays(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    with new_file(output, overwrite) as path:
        write = write_mat if output.suffix.lower() == ".mat" else write_npz
        return f"{output}: {write(path, chosen.reader, chosen.results, chosen.tell)}"


def _write_paraview(chosen: _Chosen, output: Path, overwrite: bool) -> str:
    chosen.has_fields()
    folder = output.with_suffix("")
    check_output_folder(folder, overwrite)
    with new_file(output, overwrite) as path, new_folder(folder, overwrite, _OWN) as images:
        count = write_pvd(path, images, folder.name, chosen.reader, chosen.snapshots())
    return f"{output}: {count} fields, one file each in {folder}"


_WRITERS: dict[str, Callable[[_Chosen, Path, bool], str]] = {
    "images": _write_images,
    "fields": _write_fields,
    "results": _write_results,
    "forces": _write_forces,
    "arrays": _write_arrays,
    "paraview": _write_paraview,
}
