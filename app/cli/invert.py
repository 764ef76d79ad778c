"""`slipscope invert`: shear tractions from displacement fields in files."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from analysis.options import SettingError, options
from app.cli.terminal import DONE, Bar, output, print_json, print_table
from app.files.field_files import FieldSeries, read_fields
from app.files.inverting import (
    ENDINGS,
    InvertedField,
    invert_series,
    with_centre,
    write_tractions,
)
from app.records.quantities import measured_text
from app.report.summary_rows import plain
from app.settings.sections import ContactSettings, InversionSettings, flag
from app.system.errors import UserError
from app.system.outputs import check_output

SHOWN = 40  # lines of the table
FRAMES_TOLD = 12  # that have a note


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

    `given` are settings of `InversionSettings`, by name; they take precedence over those of a
    session, and what a file of fields can not say must be among them.
    """
    if destination is not None:
        check_output(destination, overwrite, endings=ENDINGS, inputs={"file of fields": [path]})
    series = read_fields(path, given.get("pixel"), given.get("box"))
    if "centre" in given:
        series = replace(series, centre_m=given["centre"])
    series = with_centre(series.only(frames) if frames else series)
    settings = _settings({"roughness": 0.0, "thickness": 0.0, **series.contact, **given})
    failures: list[str] = []
    inverted: list[InvertedField] = []
    with Bar("inverting", quiet=as_json) as bar:
        for one in invert_series(series, settings, failures):
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
                    "method": settings.method,
                    "notes": list(series.notes),
                    "fields": [_data(one) for one in inverted],
                    "failures": failures,
                }
            )
        )
    else:
        _tell(inverted, series, settings.method, destination, failures)
    return DONE


def _settings(known: dict[str, Any]) -> InversionSettings:
    missing = [flag(name) for name in options(ContactSettings) if name not in known]
    if missing:
        raise UserError(
            f"invert: {', '.join(missing)} not given; a file of fields does not say what they were"
            " measured on"
        )
    try:
        return InversionSettings(**known)
    except SettingError as error:
        raise UserError(f"invert: {error}") from None


def notes_once(results: list[InvertedField]) -> list[str]:
    """The notes on the fields, those that differ in their numbers once, with the frames that have
    them.
    """
    alike: dict[str, dict[int, str]] = {}
    for one in results:
        for note in one.result.notes:
            alike.setdefault(re.sub(r"\d[\d.e+-]*", "", note), {})[one.number] = note
    said = []
    for notes in alike.values():
        first = next(iter(notes.values()))
        if len(results) == 1 or (len(notes) == len(results) and set(notes.values()) == {first}):
            said.append(first)
            continue
        frames = ", ".join(map(str, list(notes)[:FRAMES_TOLD]))
        more = f" and {len(notes) - FRAMES_TOLD} more" if len(notes) > FRAMES_TOLD else ""
        which = f"frame{'s' if len(notes) > 1 else ''} {frames}{more}"
        told = f"{which}, the first: " if len(set(notes.values())) > 1 else f"{which}: "
        said.append(f"{told}{first}")
    return said


def _data(one: InvertedField) -> dict[str, Any]:
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
    results: list[InvertedField],
    series: FieldSeries,
    method: str,
    destination: Path | None,
    failures: list[str],
) -> None:
    x, y = series.centre_m or (math.nan, math.nan)
    step = max(1, math.ceil(len(results) / SHOWN))
    rows = []
    for one in islice(results, 0, None, step):
        found = one.result
        row = (
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
        rows.append(row)
    output().print(
        f"{method}: {len(results)} fields, contact's centre at x = {x * 1e3:.3f} mm, y ="
        f" {y * 1e3:.3f} mm"
    )
    headings = ("frame", "Q (N)", "D (um)", "max (kPa)", "r (mm)", "residual", "stopped")
    print_table(headings, rows, texts=("stopped",), numbers="left")
    output().print(
        "Q: integral of sigma; max: the largest sigma of the profile, and where; residual: in units"
        " of the noise"
    )
    if step > 1:
        output().print(f"every {step}th field shown")
    for note in dict.fromkeys([*series.notes, *notes_once(results), *failures[:3]]):
        output().print(f"note: {note}")
    if len(failures) > 3:
        output().print(f"note: {len(failures)} fields could not be inverted")
    if destination:
        output().print(f"results: {destination}")
