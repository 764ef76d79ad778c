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

from app.commands.terminal import DONE, Bar, output, print_json
from app.config import averaging_box_px, from_record
from app.errors import UserError
from app.exchange.fields import FieldSeries, read_fields
from app.exchange.inverting import (
    ENDINGS,
    METHODS,
    Block,
    Inverted,
    invert_series,
    with_centre,
    write_tractions,
)
from app.outputs import check_output
from app.report.summary import measured_text, plain
from app.results import Phase
from app.sections import Config, Dic
from app.session.fields import is_session
from app.session.reader import SessionReader

SHOWN = 40  # lines of the table


def invert(
    path: Path,
    destination: Path | None,
    *,
    method: str,
    frames: list[int],
    pixel: float | None,
    box: float | None,
    centre: tuple[float, float] | None,
    overwrite: bool,
    as_json: bool,
    **material: float | None,
) -> int:
    """Invert the fields of a file; the exit code.

    `material` are the options that a session's settings can answer, None: not given.
    """
    if method not in METHODS:
        raise UserError(f"--method: {method} found; there are {', '.join(METHODS)}")
    if destination is not None:
        check_output(destination, overwrite, endings=ENDINGS, inputs={"file of fields": [path]})
    series, known = _from_session(path) if is_session(path) else _from_fields(path, pixel, box)
    if centre is not None:
        series = replace(series, centre_m=(centre[0] * 1e-3, centre[1] * 1e-3))
    series = with_centre(series.only(frames) if frames else series)
    block = _block(known | {name: value for name, value in material.items() if value is not None})
    failures: list[str] = []
    inverted: list[Inverted] = []
    with Bar("inverting", quiet=as_json) as bar:
        for one in invert_series(series, block, method, failures):
            inverted.append(one)
            bar.show("inverting", len(inverted) / len(series.frames))
    if not inverted:
        raise UserError(f"{path}: none of its fields could be inverted; {failures[0]}")
    if destination is not None:
        write_tractions(destination, series, inverted, overwrite)
    if as_json:
        print_json(
            plain(
                {
                    "centre_m": series.centre_m,
                    "method": method,
                    "fields": [_data(one) for one in inverted],
                    "failures": failures,
                }
            )
        )
    else:
        _tell(inverted, series, method, destination, failures)
    return DONE


def _from_fields(
    path: Path, pixel: float | None, box: float | None
) -> tuple[FieldSeries, dict[str, float]]:
    series = read_fields(path, None if pixel is None else pixel * 1e-6)
    side = 2 * series.pitch_m if box is None else box * 1e-6
    return series, {"box": side, "noise_box": side}


def _from_session(path: Path) -> tuple[FieldSeries, dict[str, float]]:
    with SessionReader(path) as session:
        config = from_record(session.config_toml, f"{path}: settings")
        contact = session.contact()
        drive = [
            (i, s.frame, s.normal_force_n)
            for i, s in enumerate(session.snapshots())
            if s.phase is Phase.DRIVE and s.ux_px.size
        ]
        if not drive:
            raise UserError(f"{path}: no frame of its drive was analysed; replay it first")
        rows, frames, forces = zip(*drive, strict=True)
        grid = session.grid_x_px, session.grid_y_px
    pixel_m = config.camera.pixel * 1e-6

    def fields() -> Iterator[tuple[int, Any, Any]]:
        with SessionReader(path) as session:
            for i in rows:
                s = session.snapshot(i)
                yield (
                    s.frame,
                    s.ux_px * np.float64(pixel_m) - s.lens_m,
                    s.ux_std_px * np.float64(pixel_m),
                )

    centre = (
        None
        if contact is None
        else (contact.centre_px[0] * pixel_m, contact.centre_px[1] * pixel_m)
    )
    x_m, y_m = (np.asarray(axis, np.float64) * pixel_m for axis in grid)
    force = float(np.median(forces[:: max(1, len(forces) // 20)]))
    return FieldSeries(path, x_m, y_m, frames, fields, centre), _known(
        config, force, config.dic, pixel_m
    )


def _known(config: Config, force: float, dic: Dic, pixel_m: float) -> dict[str, float]:
    sample = config.sample
    return {
        "normal_force": force,
        "modulus": sample.young_modulus,
        "poisson": sample.poisson,
        "radius": sample.lens_radius,
        "roughness": sample.roughness,
        "thickness": sample.thickness,
        "box": averaging_box_px(dic) * pixel_m,
        "noise_box": dic.box * pixel_m,
    }


def _block(asked: dict[str, Any]) -> Block:
    missing = [
        f"--{name.replace('_', '-')}"
        for name in ("normal_force", "modulus", "poisson", "radius")
        if name not in asked
    ]
    if missing:
        raise UserError(
            f"invert: {', '.join(missing)} not given; a file of fields does not say what they were"
            " measured on"
        )
    for name in ("normal_force", "modulus", "radius"):
        if not 0 < asked[name] < math.inf:
            raise UserError(
                f"--{name.replace('_', '-')}: {asked[name]:g} found; give a positive number"
            )
    if not 0 <= asked["poisson"] <= 0.5:
        raise UserError(f"--poisson: {asked['poisson']:g} found; give 0 to 0.5")
    for name in ("roughness", "thickness"):
        if not 0 <= asked.get(name, 0.0) < math.inf:
            raise UserError(f"--{name}: {asked[name]:g} found; give 0 or more")
    return Block(
        P=asked["normal_force"],
        E=asked["modulus"] * 1e6,
        nu=asked["poisson"],
        R=asked["radius"] * 1e-3,
        roughness=asked.get("roughness", 0.0) * 1e-6,
        thickness=asked.get("thickness", 0.0) * 1e-3 or math.inf,
        box=asked["box"],
        noise_box=asked["noise_box"],
    )


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
        "residual_over_noise": one.residual_over_noise,
        "stopped": str(found.stopped),
        "iterations": found.iterations,
        "is_covered": found.is_covered,
        "is_converged": found.is_converged,
        "notes": list(found.notes),
    }


def _tell(
    results: list[Inverted],
    series: FieldSeries,
    method: str,
    destination: Path | None,
    failures: list[str],
) -> None:
    x, y = series.centre_m or (math.nan, math.nan)
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
            f"{one.residual_over_noise:.2f}",
            str(found.stopped)
            + ("" if found.is_converged else ", not converged")
            + ("" if found.is_covered else ", not covered"),
        )
    output().print(
        f"{method}: {len(results)} fields, contact's centre at x = {x * 1e3:.3f} mm, y ="
        f" {y * 1e3:.3f} mm"
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
