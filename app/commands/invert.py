"""`slipscope invert`: shear tractions from displacement fields in files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from app.commands.names import check_writable
from app.commands.terminal import DONE, Bar, output, print_json
from app.config import from_record
from app.errors import UserError
from app.field_files import read_fields
from app.invert_files import (
    SUFFIXES,
    Block,
    Inverted,
    Series,
    TableWriter,
    invert_series,
    noise_of,
)
from app.records import Phase, series_of
from app.report.quantities import measured_text
from app.report.summary import plain
from app.session.fields import is_session
from app.session.reader import SessionReader
from app.settings import INVERSIONS, Config, flag

SHOWN = 40  # lines of the table


def invert(
    path: Path,
    destination: Path | None,
    given: dict[str, Any],
    frames: list[int],
    *,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Invert the fields of a file; the exit code.

    `given` are settings of `InversionSettings` by name. A session holds those that are not given; a
    table does not.
    """
    method = given.get("method", INVERSIONS[0])
    if destination is not None:
        check_writable(destination)
        if destination.suffix.lower() not in SUFFIXES:
            raise UserError(
                f"{destination}: results are written as {' or '.join(SUFFIXES)}; give such an"
                " ending"
            )
        if destination.exists() and not overwrite:
            raise UserError(
                f"{destination}: a file of that name exists; choose another name or give"
                " --overwrite"
            )
    series, known = _from_session(path) if is_session(path) else _from_fields(path, given)
    if "centre" in given:
        series = replace(series, centre_m=given["centre"])
    series = _chosen(series, frames)
    block = _block(known | given)
    failures: list[str] = []
    found_centre, results = invert_series(series, block, method, failures)
    writer = TableWriter(destination, series) if destination else None
    kept: list[Inverted] = []
    is_complete = False
    try:
        with Bar("inverting", quiet=as_json) as bar:
            for n, one in enumerate(results, 1):
                kept.append(one)
                if writer:
                    writer.write(one)
                bar.show("inverting", n / series.count)
        if not kept:
            raise UserError(f"{path}: none of its fields could be inverted; {failures[0]}")
        is_complete = True
    finally:
        if writer:
            writer.close(is_complete=is_complete)
    if as_json:
        print_json(
            plain(
                {
                    "centre_m": found_centre,
                    "method": method,
                    "fields": [_data(one) for one in kept],
                    "failures": failures,
                }
            )
        )
    else:
        _tell(kept, found_centre, method, destination, failures)
    return DONE


def _from_fields(path: Path, given: dict[str, Any]) -> tuple[Series, dict[str, float]]:
    found = read_fields(path, given.get("pixel"))
    side = given.get("box", 2 * found.pitch_m[0])

    def fields() -> Iterator[tuple[int, Any, Any]]:
        return zip(found.frames, found.ux_m, found.sd_m, strict=True)

    series = Series(found.x_m, found.y_m, None, len(found.frames), fields)
    return series, {"box": side, "noise_box": side}


def _from_session(path: Path) -> tuple[Series, dict[str, float]]:
    with SessionReader(path) as session:
        config = from_record(session.header.config_toml, f"{path}: settings")
        contact = session.contact()
        numbers = [
            i
            for i, s in enumerate(session.snapshots())
            if s.conditions.phase is Phase.DRIVE and s.field is not None
        ]
        if not numbers:
            raise UserError(f"{path}: no frame of its drive was analysed; replay it first")
        some = numbers[:: max(1, len(numbers) // 20)]
        force = float(np.median(series_of(map(session.snapshot, some), "normal_force_n")))
        grid = session.header.grid_x_px, session.header.grid_y_px
    pixel_m = config.camera.pixel

    def fields() -> Iterator[tuple[int, Any, Any]]:
        with SessionReader(path) as session:
            for i in numbers:
                s = session.snapshot(i)
                assert s.field is not None
                lens_m = s.motion.lens_m if s.motion is not None else math.nan
                yield (
                    s.frame,
                    s.field.ux_px * np.float64(pixel_m) - lens_m,
                    s.field.ux_std_px * np.float64(pixel_m),
                )

    centre = (
        None
        if contact is None
        else (contact.centre_px[0] * pixel_m, contact.centre_px[1] * pixel_m)
    )
    x_m, y_m = (np.asarray(axis, np.float64) * pixel_m for axis in grid)
    return Series(x_m, y_m, centre, len(numbers), fields), _known(config, force)


def _known(config: Config, force: float) -> dict[str, float]:
    sample, dic, pixel_m = config.sample, config.dic, config.camera.pixel
    return {
        "normal_force": force,
        "modulus": sample.young_modulus,
        "poisson": sample.poisson,
        "radius": sample.lens_radius,
        "roughness": sample.roughness,
        "thickness": sample.thickness,
        "box": dic.averaging_box_px * pixel_m,
        "noise_box": dic.box * pixel_m,
    }


def _block(known: dict[str, Any]) -> Block:
    needed = ("normal_force", "modulus", "poisson", "radius")
    missing = [flag(name) for name in needed if name not in known]
    if missing:
        raise UserError(
            f"invert: {', '.join(missing)} not given; a file of fields does not say what they were"
            " measured on"
        )
    return Block(
        P=known["normal_force"],
        E=known["modulus"],
        nu=known["poisson"],
        R=known["radius"],
        roughness=known.get("roughness", 0.0),
        thickness=known.get("thickness", 0.0) or math.inf,
        box=known["box"],
        noise_box=known["noise_box"],
    )


def _chosen(series: Series, frames: list[int]) -> Series:
    if not frames:
        return series
    held = {number for number, *_ in series.fields()}
    missing = sorted(set(frames) - held)
    if missing:
        raise UserError(
            f"--frame: {missing[0]} is not there; the file has fields {min(held)} to {max(held)}"
        )

    def fields() -> Iterator[tuple[int, Any, Any]]:
        return (field for field in series.fields() if field[0] in frames)

    return replace(series, count=len(set(frames)), fields=fields)


def _data(one: Inverted) -> dict[str, Any]:
    found = one.result
    return {
        "frame": one.number,
        "Q_n": found.Q,
        "Q_sd_n": found.Q_sd,
        "D_m": found.D,
        "D_sd_m": found.D_sd,
        "peak_radius_m": one.peak_radius_m,
        "radius_m": one.profile[0],
        "sigma_pa": one.profile[1],
        "sigma_sd_pa": one.profile[2],
        "residual_over_noise": noise_of(found),
        "stopped": str(found.stopped),
        "iterations": found.iterations,
        "is_covered": found.is_covered,
        "is_converged": found.is_converged,
        "notes": list(found.notes),
    }


def _tell(
    results: list[Inverted],
    centre: tuple[float, float],
    method: str,
    destination: Path | None,
    failures: list[str],
) -> None:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for name in ("frame", "Q (N)", "D (um)", "max (kPa)", "r (mm)", "residual", "stopped"):
        table.add_column(name, no_wrap=True)
    step = max(1, math.ceil(len(results) / SHOWN))
    for one in islice(results, 0, None, step):
        found = one.result
        table.add_row(
            str(one.number),
            measured_text(found.Q, found.Q_sd),
            measured_text(found.D * 1e6, found.D_sd * 1e6),
            f"{np.nanmax(one.profile[1]) * 1e-3:.2f}",
            f"{one.peak_radius_m * 1e3:.2f}",
            f"{noise_of(found):.2f}",
            str(found.stopped)
            + ("" if found.is_converged else ", not converged")
            + ("" if found.is_covered else ", not covered"),
        )
    output().print(
        f"{method}: {len(results)} fields, contact's centre at x = {centre[0] * 1e3:.3f} mm, y ="
        f" {centre[1] * 1e3:.3f} mm"
    )
    Console(highlight=False, markup=False, width=max(Console().width, 110)).print(table)
    output().print(
        "Q: integral of sigma; max: the largest sigma of the profile, and where; residual: in units"
        " of the noise"
    )
    if step > 1:
        output().print(f"every {step}th field shown")
    for note in dict.fromkeys(
        [*(note for one in results for note in one.result.notes), *failures[:3]]
    ):
        output().print(f"note: {note}")
    if len(failures) > 3:
        output().print(f"note: {len(failures)} fields could not be inverted")
    if destination:
        output().print(f"results: {destination}")
