"""`slipscope figures`: the figures of the paper, numbers and a report from a file of results."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

from app.cli.names import WIDTHS_MM, JsonData, check_known
from app.records.study_results import StudyResults
from app.report.document import DocumentPicture, as_html, as_markdown, blocks
from app.report.findings import findings
from app.report.paper.collection import FIGURES, draw, number_of, stem
from app.report.paper.runs import experiments
from app.report.paper.style import (
    FORMATS,
    MM,
    PALETTES,
    FigureStyle,
    NotDrawn,
    picture,
    styled,
    write_table,
)
from app.report.practice import practice_rows
from app.report.summary_json import summary_data
from app.session.results import read_results
from app.system.errors import UserError
from app.system.outputs import check_output_folder, new_folder
from app.system.progress import HowFar, unheard


def chosen(
    words: Sequence[str], only: Sequence[str], formats: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Names of figures in their order, and formats; words behind an option go with it. A number
    stands for all its figures: 6 for 6a and 6b.
    """
    kinds = list(dict.fromkeys([*formats, *(w for w in words if w in FORMATS)]))
    wanted = [*only, *(w for w in words if w not in FORMATS)]
    for kind in kinds:
        check_known("--format", kind, FORMATS)
    families = {name: {name, number_of(name)} for name in FIGURES}
    for name in wanted:
        if name not in set().union(*families.values()):
            raise UserError(f"figure {name}: there is no such figure; use {', '.join(FIGURES)}")
    names = [name for name, own in families.items() if not wanted or own.intersection(wanted)]
    return names, kinds or ["png", "pdf"]


def looks(width_mm: float, colours: str, style: str) -> FigureStyle:
    """How figures look by the options of the command; UserError where they cannot."""
    low, high = WIDTHS_MM
    if width_mm and not low <= width_mm <= high:
        raise UserError(f"--width {width_mm:g}: a figure is {low} to {high} mm wide; give that")
    check_known("--colours", colours, PALETTES)
    look = FigureStyle(width_mm, colours, style)
    try:
        with styled(look):
            return look
    except OSError as error:
        raise UserError(
            f"--style {style}: matplotlib has no such style sheet, and no file of this name is one"
            f" ({' '.join(str(error).split())[:120]})"
        ) from None


def _written(names: Sequence[str]) -> re.Pattern[str]:
    """What is written into a folder for these figures; those of others stay."""
    stems = "|".join(map(stem, names))
    figure = rf"({stems})(_inset|[a-d])?\.({'|'.join(FORMATS)}|csv)"
    return re.compile(rf"{figure}|summary\.json|report\.(html|md)")


def _check(results: StudyResults, path: Path) -> None:
    """Refuse results from which no figure can be drawn."""
    if not results.runs:
        raise UserError(f"{path}: it holds no run; analyse sessions with `slipscope analyze`")
    if not experiments(results):
        raise UserError(
            f"{path}: none of its {len(results.runs)} runs has a normal force of the drive, which"
            " every figure needs; analyse sessions with forces and a drive"
        )


def write_figures(
    path: Path,
    folder: Path,
    names: Sequence[str],
    kinds: Sequence[str],
    *,
    overwrite: bool,
    show: HowFar = unheard,
    look: FigureStyle | None = None,
) -> JsonData:
    """Draw figures of a file of results into a folder; what `summary.json` holds.

    Raises
    ------
    UserError
        The results cannot be read, no figure can be drawn of them, or the folder exists.
    """
    check_output_folder(folder, overwrite)
    results = read_results(path)
    _check(results, path)
    with new_folder(folder, overwrite, _written(names)) as unfinished:
        return write(results, unfinished, names, kinds, show, look)


def write(
    results: StudyResults,
    folder: Path,
    names: Sequence[str],
    kinds: Sequence[str],
    show: HowFar,
    look: FigureStyle | None = None,
) -> JsonData:
    """Write all files into an empty folder; what `summary.json` holds."""
    pictures = []
    for n, name in enumerate(names):
        show(f"figure {name}", n / len(names))
        pictures.append(_drawn(results, folder, name, kinds, look or FigureStyle()))
    runs = experiments(results)
    found, practice = findings(results), practice_rows(runs)
    data = summary_data(results, found, practice, pictures)
    content = list(blocks(results, found, practice, pictures))
    texts = {
        "summary.json": json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False) + "\n",
        "report.html": as_html(content),
        "report.md": as_markdown(content),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return data


def _drawn(
    results: StudyResults, folder: Path, name: str, kinds: Sequence[str], look: FigureStyle
) -> DocumentPicture:
    """Draw one figure and write its files."""
    try:
        drawn = draw(name, results, look)
    except NotDrawn as reason:
        return DocumentPicture(name, str(reason))
    files = []
    png = picture(drawn.figure, "png", look)
    for kind in kinds:
        files.append(f"{stem(name)}.{kind}")
        held = png if kind == "png" else picture(drawn.figure, kind, look)
        (folder / files[-1]).write_bytes(held)
    for part, table in drawn.tables.items():
        files.append(f"{stem(name)}{part}.csv")
        write_table(table, folder / files[-1])
    width = round(drawn.figure.get_figwidth() / MM)
    return DocumentPicture(name, drawn.caption, png, tuple(files), width)
