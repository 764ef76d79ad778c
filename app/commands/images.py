"""`slipscope dic`: displacement fields between plain image files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.settings import Correlation
from app.commands.terminal import DONE, Bar, output

if TYPE_CHECKING:
    from app.exchange.correlating import CorrelationSummary


def dic(
    reference: Path,
    images: Sequence[Path],
    fields: Path,
    correlation: Correlation,
    *,
    mask: Path | None,
    roi: tuple[int, int, int, int] | None,
    overwrite: bool,
) -> int:
    """Correlate image files and write the fields; the exit code."""
    from app.exchange.correlating import correlate_files

    with Bar("correlating", quiet=False) as bar:
        summary = correlate_files(
            reference,
            images,
            fields,
            correlation,
            mask=mask,
            roi=roi,
            overwrite=overwrite,
            on_progress=bar.show,
        )
    _report(summary)
    return DONE


def _report(summary: CorrelationSummary) -> None:
    fates = ", ".join(f"{count} {status}" for status, count in summary.statuses.items() if count)
    output().print(
        f"{summary.output}: frames 1 to {summary.frames}, {summary.points} points each: {fates}"
    )
    quality = (
        f"; median standard uncertainty {summary.ux_std_px:.4f} px of u_x, {summary.uy_std_px:.4f}"
        " px of u_y;"
        f" median correlation {summary.zncc:.4f}"
    )
    output().print(
        f"{summary.points_per_s:,.0f} points/s" + (quality if summary.statuses["ok"] else "")
    )
    if summary.updates:
        output().print(
            f"reference replaced {summary.updates} times, which adds {summary.drift_px:.4f} px to"
            " the uncertainty of u_x"
        )
