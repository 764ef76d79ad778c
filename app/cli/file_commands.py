"""The commands of `slipscope` that read and write files, without a bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option, Typer

from analysis.settings import Correlation
from app.cli import completion
from app.cli.command_options import (
    JsonFlag,
    Overrides,
    Overwrite,
    SessionFile,
    command,
    output_file,
)

if TYPE_CHECKING:
    from app.files.correlating import CorrelationSummary

app = Typer()
# groups of options of `slipscope import`
SCALES, TABLES, FRAMES = "Pixels and clocks", "Form of the tables", "Frames"
# as in `app.files.kinds`, which takes its time to import
_BOTH = ("rings", "stress", "law", "pressure", "budget", "cycles", "slides", "notes", "profile")
OF_SESSION: tuple[str, ...] = (
    "fields",
    "results",
    "forces",
    *_BOTH,
    "summary",
    "run",
    "triggers",
    "stage",
)
OF_SESSION += ("events", "gaps", "counts", "versions")
OF_RESULTS: tuple[str, ...] = (
    "summary",
    "runs",
    "joint",
    "joint_notes",
    "results",
    *_BOTH,
    "fields",
    "noise",
)
OF_RESULTS += ("made_with",)


def _one_of(names: tuple[str, ...]) -> str:
    first, *others, last = names
    return f"{first} (default), {', '.join(others)} or {last}"


@command(app)
def dic(
    reference: Annotated[
        Path,
        Argument(
            metavar="REFERENCE",
            help="The image before any displacement; of a folder or a multi-page TIFF, the first"
            " image.",
        ),
    ],
    images: Annotated[
        list[Path] | None,
        Argument(
            metavar="IMAGE...",
            help="Images to compare with it, in order; also folders and multi-page TIFFs.",
            show_default=False,
        ),
    ] = None,
    *,
    fields: Annotated[Path, output_file("FIELDS.h5|.csv|.npz", "File for the fields.")],
    correlation: Correlation,
    mask: Annotated[
        Path | None,
        Option(metavar="IMAGE", help="Image of the same size; only its non-zero pixels are used."),
    ] = None,
    roi: Annotated[
        tuple[int, int, int, int] | None,
        Option(
            metavar="LEFT TOP RIGHT BOTTOM",
            help="Region of the box centres [px]. Default: the whole image.",
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Measure displacement fields between plain image files: grey PNG, TIFF or BMP, 8 or 16 bit,
    all of one size.

    A CSV begins with the columns frame,x_px,y_px,ux_px,uy_px,status: frame 1 is the first image
    after the reference, x_px and y_px are box centres, (0, 0) is the centre of the top-left pixel,
    y points down, status is ok or the reason why the point is lost. Finally prints the points per
    second, the medians of standard uncertainty and correlation, and the number of lost points by
    reason.

    Example: `slipscope dic rest.tif pull_*.tif -o fields.csv --box 27`
    """
    from app.cli.terminal import DONE, FAILED, Bar, print_json, say
    from app.files.correlating import correlate_files
    from app.report.summary_rows import plain

    with Bar("correlating", quiet=as_json) as bar:
        summary = correlate_files(
            reference,
            images or [],
            fields,
            correlation,
            mask=mask,
            roi=roi,
            overwrite=overwrite,
            on_progress=bar.show,
        )
    if as_json:
        print_json(plain(summary))
    else:
        _report(summary)
    if summary.statuses["ok"]:
        return DONE
    why = (
        "; --min-contrast is the least contrast of a box"
        if summary.statuses["low_contrast"]
        else ""
    )
    say(f"{summary.output}: no point of any image was measured{why}")
    return FAILED


def _report(summary: CorrelationSummary) -> None:
    from app.cli.terminal import print_line

    frames = f"frames 1 to {summary.frames}" if summary.frames > 1 else "frame 1"
    fates = ", ".join(f"{count} {status}" for status, count in summary.statuses.items() if count)
    print_line(f"{summary.output}: {frames}, {summary.points} points each: {fates}")
    quality = (
        f"; median standard uncertainty {summary.ux_std_px:.4f} px of u_x, {summary.uy_std_px:.4f}"
        f" px of u_y; median correlation {summary.zncc:.4f}"
    )
    print_line(
        f"{summary.points_per_s:,.0f} points/s" + (quality if summary.statuses["ok"] else "")
    )
    for remark in summary.remarks:
        print_line(remark)
    if summary.full_scale:
        print_line(
            f"{summary.saturated:.2%} of the pixels of the reference share the grey level"
            f" {summary.full_scale}, at which the grey scale seems to end: they count as saturated;"
            " --full-scale says where it ends"
        )
    if summary.updates:
        print_line(
            f"reference replaced {summary.updates} times, which adds {summary.drift_px:.4f} px to"
            " the uncertainty of u_x"
        )


@command(app)
def export(
    held: Annotated[
        Path,
        Argument(
            metavar="SESSION.h5|RESULTS.h5",
            help="A session, or results of `slipscope analyze`.",
            autocompletion=completion.files(".h5"),
        ),
    ],
    destination: Annotated[
        Path, output_file("FOLDER|FILE.csv|.npz|.mat|.pvd|.mp4|.gif", "Where to write it.")
    ],
    what: Annotated[
        str,
        Option(
            metavar="TABLE",
            help="Content of a .mp4 or .gif: ux (default) or uy. Of a .csv:"
            f" {_one_of(OF_SESSION)}. From results: {_one_of(OF_RESULTS)}."
            " Of a folder: images (default) or tables, which are all of these.",
            autocompletion=completion.words(
                "images", "tables", "ux", "uy", *OF_SESSION, *OF_RESULTS
            ),
            show_default=False,
        ),
    ] = "",
    frames: Annotated[
        str,
        Option(
            metavar="FIRST:END:STEP",
            help="Only these triggers, without END; or a single one.",
            show_default=False,
        ),
    ] = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Write the content of a session or a file of results as files for other programs.

    A folder gets the raw images (TIFF, lossless), metadata.csv with the outcome of every frame,
    forces.csv and settings.toml; `slipscope import` can read them. A .csv is one table with one
    observation in each row: displacement fields as `slipscope dic` writes them, u_x(r) and sigma(r)
    of each frame, p(r), the uncertainty from each input, ...; .npz and .mat contain all tables as
    arrays; .pvd is a series of displacement fields for ParaView, in m, y upwards; .mp4 and .gif are
    films of u_x or u_y in um with one colour range, less the motion of the lens. Columns are named
    by quantity and unit; ux_sd_um is the standard uncertainty of ux_um. Tables of results contain
    all runs, identified by the columns run and P_N.

    Example: `slipscope export sample7.h5 -o rings.csv --what rings --frames 100:400:10`
    """
    from app.cli.terminal import DONE, Bar, print_json, print_line
    from app.files import exporting
    from app.session.field_series import is_results

    with Bar("exporting", quiet=as_json) as bar:
        written = exporting.export(
            held, destination, what, frames=frames, overwrite=overwrite, on_progress=bar.show
        )
    if as_json:
        kind = "results" if is_results(held) else "session"
        print_json({kind: str(held), "output": str(destination), "written": written})
    else:
        print_line(written)
    return DONE


@command(app)
def import_(
    images: Annotated[
        list[Path],
        Argument(
            metavar="FOLDER|IMAGE...",
            help="Grey PNG, TIFF or BMP, 8 or 16 bit; a TIFF may contain many images.",
        ),
    ],
    session: Annotated[Path, output_file("SESSION.h5", "Session to write.")],
    forces: Annotated[
        Path | None,
        Option(
            metavar="FORCES.csv",
            help="Table with time_s or sample; P_N and Q_N, or normal_V and shear_V; stage_um; or"
            " the names of other programs.",
        ),
    ] = None,
    metadata: Annotated[
        Path | None,
        Option(
            metavar="METADATA.csv",
            help="Table with one row per frame: frame, sample or time_s, file, phase, reason.",
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        Option(
            metavar="BENCH.toml",
            help="Settings of sample, sensors and correlation; see `slipscope config`.",
        ),
    ] = None,
    pixel_um: Annotated[
        float | None,
        Option("--pixel", metavar="UM", help="Size of a pixel.", rich_help_panel=SCALES),
    ] = None,
    frame_rate: Annotated[
        float | None,
        Option(
            "--frame-rate",
            metavar="HZ",
            min=1e-6,
            max=1e6,
            help="Images per second.",
            rich_help_panel=SCALES,
        ),
    ] = None,
    rate_hz: Annotated[
        int | None,
        Option(
            "--rate",
            metavar="HZ",
            help="Force samples per second; default: from the table.",
            rich_help_panel=SCALES,
        ),
    ] = None,
    divisor: Annotated[
        int | None, Option(help="Samples from one image to the next.", rich_help_panel=SCALES)
    ] = None,
    offset_s: Annotated[
        float | None,
        Option(
            "--time-offset",
            metavar="SECONDS",
            help="Added to the times of the forces to match those of the images; default: from the"
            " start of the motion in both.",
            rich_help_panel=SCALES,
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        Option(
            metavar="TEXT",
            help='Meaning of the columns, by name or number: "time_s=Zeit, P_mN=Last, Q_mN=3".',
            rich_help_panel=TABLES,
        ),
    ] = None,
    delimiter: Annotated[
        str | None,
        Option(
            metavar="SIGN",
            help="Separator of cells: , ; | tab space; default: detected.",
            rich_help_panel=TABLES,
        ),
    ] = None,
    decimal: Annotated[
        str | None,
        Option(
            metavar="SIGN", help="Decimal sign: . or ,; default: detected.", rich_help_panel=TABLES
        ),
    ] = None,
    encoding: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Encoding of the tables, such as latin-1; default: detected.",
            rich_help_panel=TABLES,
        ),
    ] = None,
    is_day_first: Annotated[
        bool | None,
        Option(
            "--day-first/--month-first",
            help="Meaning of dates such as 12/11/2026; default: detected.",
            rich_help_panel=TABLES,
        ),
    ] = None,
    background: Annotated[
        int | None,
        Option(
            metavar="FRAME",
            help="Image of the free block; default: the last with P near 0.",
            rich_help_panel=FRAMES,
        ),
    ] = None,
    reference: Annotated[
        int | None,
        Option(
            metavar="FRAME",
            help="Image at rest under load; default: the last before the drive.",
            rich_help_panel=FRAMES,
        ),
    ] = None,
    drive: Annotated[
        int | None,
        Option(
            metavar="FRAME",
            help="First frame of the drive; default: where Q begins to rise.",
            rich_help_panel=FRAMES,
        ),
    ] = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Make a session from images and forces of other benches and programs, and analyse it;
    `slipscope replay` repeats the analysis bit by bit.

    Images are used in the order of the numbers in their names, frame 0 first; a missing number is a
    lost frame. If the folder contains metadata.csv, forces.csv and settings.toml, they are used.
    The program detects and reports the form of the tables, the background, the reference, the start
    of the drive, and whether both clocks agree; options override this. Forces are interpolated
    linearly between the rows of a table; missing rows give a gap. One message asks for everything
    that cannot be detected, such as the size of a pixel. The exit code is 1 if nothing could be
    measured.

    Example: `slipscope import images -o other.h5 --forces load.csv --pixel 5.2 --frame-rate 10`
    """
    from app.cli.terminal import DONE, FAILED, Bar, print_json, print_line, print_rows, say
    from app.files.forms import TableForm
    from app.files.frames import Sources
    from app.files.importing import import_files
    from app.report.summary_rows import outcome_data, outcome_rows

    sources = Sources(
        images=images,
        metadata=metadata,
        forces=forces,
        settings=settings,
        pixel_um=pixel_um,
        rate_hz=rate_hz,
        divisor=divisor,
        frame_rate=frame_rate,
        offset_s=offset_s,
        form=TableForm.given(columns or (), delimiter, decimal, encoding, is_day_first),
        background=background,
        reference=reference,
        drive=drive,
        overrides=overrides or (),
    )
    with Bar("importing", quiet=as_json) as bar:
        imported = import_files(sources, session, overwrite=overwrite, on_progress=bar.show)
    outcome = imported.outcome
    failed = imported.shortcoming
    if as_json:
        findings = {"remarks": imported.remarks, "samples_outside": imported.samples_outside}
        data = {"session": str(session), **findings, "failure": failed, **outcome_data(outcome)}
        print_json(data)
        return FAILED if failed else DONE
    counts, outside = outcome.counts, imported.samples_outside
    rows = [
        row
        if row.label != "force samples"
        else row._replace(
            value=f"{counts.samples} recorded, {counts.samples_lost - outside} lost"
            + (f", {outside} before or after the table" if outside else "")
        )
        for row in outcome_rows(outcome)
    ]
    print_rows(outcome.reason, rows)
    notes = [f"note: {note}" for note in outcome.measured.notes]
    for sentence in (*imported.remarks, *notes):
        print_line(sentence)
    print_line(f"session: {session}; `slipscope replay {session}` analyses it again")
    if failed:
        say(failed)
        return FAILED
    return DONE


@command(app)
def repair(
    session: SessionFile,
    destination: Annotated[Path, output_file("REPAIRED.h5", "Session to write.")],
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Recover every frame and sample of an interrupted session into a new file; the session itself
    is only read.

    Uses the journal (SESSION.h5.journal) that lies beside a session until the session is closed.
    Reports all losses.
    """
    from app.cli.terminal import DONE, FAILED, Bar, print_json, print_line, say
    from app.report.summary_rows import plain
    from app.session import repair as sessions
    from app.session.files import images_of

    with Bar("reading what is left", quiet=as_json) as bar:
        repaired = sessions.repair(
            session,
            destination,
            overwrite=overwrite,
            progress=lambda share: bar.show("bringing back the frames", share),
        )
    found = repaired.found
    if not found.is_whole:
        where = f" (the file of images is {images_of(session).name})"
        say(
            f"{session}: not all of it is left: {found}"
            f"{where if found.torn and repaired.source == 'journal' else ''}; nothing of it was"
            " changed: if there is a copy of its files, repair that"
        )
    if as_json:
        print_json(plain(repaired))
    else:
        print_line(str(repaired))
    return DONE if found.is_whole else FAILED
