"""What `slipscope figures` takes for six runs with pictures of 1600 x 1200 px: processor time of
all figures in three formats with their tables, the numbers and the report.

    python -m benchmarks paper_figures RESULTS.h5 [--plot docs/paper.png]

RESULTS.h5 is what `slipscope analyze` makes of the six loads of the paper; the picture shows some
of the figures.
"""

from __future__ import annotations

import io
import tempfile
import time
from pathlib import Path

from PIL import Image

from app.cli.figure_files import write
from app.report.paper.collection import FIGURES, draw
from app.report.paper.style import FORMATS, picture
from app.session.results import read_results
from benchmarks.report import Report

SUBJECT = "Figures and report"
SHOWN = (("3", "15"), ("6a", "pressure"))  # rows of the picture
WIDTH, MOST_S = 700, 40.0


def measure(report: Report, results: Path, *, plot: Path | None = None) -> None:
    """Time of the whole folder."""
    found = read_results(results)
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        write(found, Path(folder), list(FIGURES), FORMATS, lambda *_: None)
        whole = time.process_time() - began
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    report.add("figures", len(FIGURES), "")
    report.add("processor time of everything", whole, "s", MOST_S)
    report.add("written", size * 1e-6, "MB")
    if plot:
        _compose(found).save(plot, optimize=True)


def _compose(found: object) -> Image.Image:
    """Some of the figures side by side."""
    rows = []
    for names in SHOWN:
        pictures = [Image.open(io.BytesIO(picture(draw(n, found).figure, "png"))) for n in names]
        sizes = [(WIDTH, WIDTH * p.height // p.width) for p in pictures]
        rows.append([p.convert("RGB").resize(s) for p, s in zip(pictures, sizes, strict=True)])
    heights = [max(p.height for p in row) for row in rows]
    sheet = Image.new("RGB", (2 * WIDTH, sum(heights)), "white")
    for n, row in enumerate(rows):
        for k, one in enumerate(row):
            sheet.paste(one, (k * WIDTH, sum(heights[:n]) + (heights[n] - one.height) // 2))
    return sheet.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
