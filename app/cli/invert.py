"""`slipscope invert`: shear tractions from displacement fields in files."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, Typer

from app.cli import completion
from app.cli.command_options import Given, JsonFlag, Overwrite, command, output_file
from app.cli.names import JsonData
from app.settings.sections import InversionSettings
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.files.field_files import FieldSeries
    from app.files.inverting import InvertedField

SHOWN = 40  # lines of the table
FRAMES_TOLD = 12  # most frames whose notes are printed
app = Typer()


@command(app)
def invert(
    fields: Annotated[
        Path,
        Argument(
            metavar="FIELDS.h5|.csv",
            help="A session, a file of `slipscope dic`, or a table.",
            autocompletion=completion.files(".h5", ".csv"),
        ),
    ],
    given: Annotated[dict[str, Any], Given(InversionSettings)],
    frames: Annotated[
        list[int] | None,
        Option("--frame", help="Only this field; may be repeated. Default: all."),
    ] = None,
    tractions: Annotated[
        Path | None, output_file("FILE.csv|.npz", "File for the tractions.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Compute the shear traction sigma_xz from displacement fields with the Green's tensor of the
    block; the displacement D of the block far away is fitted.

    A session contains its own E, nu, R, P and pixel size; options override them. A table has a
    header with x, y, ux and their units, such as x_px, y_mm, ux_um; ux_sd and frame are optional;
    nan means not measured. u_x is measured in the frame of the sphere, which is at rest.

    Example: `slipscope invert fields.csv --E 3.43 --poisson 0.5 --radius 128.8 --normal-force 0.5
    --pixel 7.04 -o sigma.csv`
    """
    from app.cli.terminal import DONE, Bar, print_json
    from app.files.field_files import read_fields
    from app.files.inverting import ENDINGS, contact_of, invert_series, with_centre, write_tractions
    from app.report.summary_rows import plain
    from app.system.outputs import check_output

    if tractions is not None:
        check_output(tractions, overwrite, endings=ENDINGS, inputs={"file of fields": [fields]})
    series = read_fields(fields, given.get("pixel"), given.get("box"), frames or ())
    if "centre" in given:
        series = replace(series, centre_m=given["centre"])
    series = with_centre(series)
    settings = contact_of(series, given)
    failures: list[str] = []
    inverted: list[InvertedField] = []
    with Bar("inverting", quiet=as_json) as bar:
        for one in invert_series(series, settings, failures):
            inverted.append(one)
            bar.show("inverting", len(inverted) / len(series.frames))
    if not inverted:
        raise UserError(f"{fields}: none of its fields could be inverted; {failures[0]}")
    if tractions is not None:
        write_tractions(tractions, series, inverted, overwrite)
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
        _tell(inverted, series, settings.method, tractions, failures)
    return DONE


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
        which_first = f"{which}, the first: " if len(set(notes.values())) > 1 else f"{which}: "
        said.append(f"{which_first}{first}")
    return said


def _data(one: InvertedField) -> JsonData:
    found = one.result
    return {
        "frame": one.number,
        "Q_n": found.Q,
        "Q_sd_n": found.Q_sd,
        "D_m": found.D,
        "D_sd_m": found.D_sd,
        "peak_radius_m": one.peak[0],
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
    from app.cli.terminal import print_line, print_table
    from app.records.quantities import counted, measured_text

    x, y = series.centre_m or (math.nan, math.nan)
    step = max(1, math.ceil(len(results) / SHOWN))
    rows = []
    for one in islice(results, 0, None, step):
        found = one.result
        row = (
            str(one.number),
            measured_text(found.Q, found.Q_sd),
            measured_text(found.D * 1e6, found.D_sd * 1e6),
            f"{one.peak[1] * 1e-3:.2f}",
            f"{one.peak[0] * 1e3:.2f}",
            f"{one.residual_over_noise:.2f}",
            str(found.stopped)
            + ("" if found.is_converged else ", not converged")
            + ("" if found.is_covered else ", not covered"),
        )
        rows.append(row)
    print_line(
        f"{method}: {counted(len(results), 'field')}, contact's centre at x = {x * 1e3:.3f} mm, y ="
        f" {y * 1e3:.3f} mm"
    )
    headings = ("frame", "Q (N)", "D (um)", "max (kPa)", "r (mm)", "residual", "stopped")
    print_table(headings, rows, texts=("stopped",), numbers="left")
    print_line(
        "Q: integral of sigma; max: the largest sigma of the profile, and where; residual: in units"
        " of the noise"
    )
    if step > 1:
        print_line(f"one field in {step} shown")
    for note in dict.fromkeys([*series.notes, *notes_once(results), *failures[:3]]):
        print_line(f"note: {note}")
    if len(failures) > 3:
        print_line(f"note: {len(failures)} fields could not be inverted")
    if destination:
        print_line(f"results: {destination}")
