"""The methods and presets of SlipScope and other programs on the same pictures in the same run:
processor time of a point on one core, sigma of u_x over displacements of 0.25 to 0.8 px, and rms
error where a contact slips from its edge (slopes up to 1.9 %), with noise of 2 grey levels on
pictures of 1600 x 1200. Boxes of 20 or 21 px every 10 px (al-dic: 8 px), but for the presets.

    python -m benchmarks front [--frames 5] [--python PYTHON] [--picture docs/front.png]

PYTHON has pyvale, sun-dic and al-dic; see `python -m benchmarks dic_peers --help`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from analysis.dic import Correlation, compile_kernels
from analysis.settings import PRESETS
from app.tradeoff.drawing import along, label, plain_ticks
from app.tradeoff.study import front
from benchmarks.dic import METHODS, following
from benchmarks.dic_peers import PEERS, PROGRAMS, chosen
from benchmarks.report import Report, machine
from benchmarks.scores import follow, frames_of, score_ring, score_translation

SUBJECT = "Image correlation: speed against accuracy"
NOISE = 2
MOVED = (6, 8, 11, 14, 17)  # of the set of translations: 0.25, 0.35, 0.5, 0.65 and 0.8 px
TIME, SIGMA, SLIPPING = "time of a point", "sigma", "slipping contact"
OURS, THEIRS, LINE = "#1f5fa8", "#c0392b", "#777777"


def measure(
    report: Report,
    *,
    frames: int = 5,
    python: str = sys.executable,
    picture: Path | None = None,
) -> None:
    """Measure all, then draw."""
    cv2.setNumThreads(1)
    ours = {name: c for name, c in METHODS.items() if "tolerance" not in name}
    ours |= {f"preset {name}": Correlation.of_preset(name, threads=1) for name in PRESETS}
    for correlation in ours.values():
        compile_kernels(correlation)
    starts: dict[str, Any] = {f"SlipScope: {name}": following(c) for name, c in ours.items()}
    starts |= chosen((*PEERS, *PROGRAMS), python)
    report.table("Noise of 2 grey levels, one core")
    still = frames_of("translation", NOISE, None)
    moved = [still[0], *(still[n] for n in MOVED[:frames])]
    slipping = frames_of("contact", NOISE, frames)
    points: dict[str, dict[str, float]] = {}
    for name, start in starts.items():
        fields, _ = follow(start, moved)
        _, sigma, _, lost = score_translation(moved[1:], fields)
        fields, spent = follow(start, slipping)
        _, _, ring, lost_there = score_ring(slipping[1:], fields)
        micros = 1e6 * float(np.median(spent)) / len(fields[0][0])
        points[name] = {TIME: micros, SIGMA: sigma, SLIPPING: ring}
        report.add(name, 1e3 * float(np.median(spent)), "ms", column="time of a frame")
        report.add(name, micros, "us", column=TIME)
        report.add(name, sigma, "px", column=SIGMA)
        report.add(name, ring, "px", column=SLIPPING)
        report.add(name, 100 * max(lost, lost_there), "%", column="lost or wrong")
    if picture is not None:
        draw(points, picture)


def draw(points: dict[str, dict[str, float]], path: Path) -> None:
    """Both errors against the time of a point, and the front in each."""
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(9, 4.4), layout="constrained")
    texts = {}
    for panel, what in zip(panels, (SIGMA, SLIPPING), strict=True):
        for name, figures in points.items():
            ours = name.startswith("SlipScope")
            colour, marker = (OURS, "o") if ours else (THEIRS, "s")
            x, y = figures[TIME], figures[what]
            panel.plot(x, y, "*" if "preset" in name else marker, color=colour, ms=6)
        best = sorted(front(points, (TIME, what)), key=lambda name: points[name][TIME])
        line = [[points[n][k] for n in best] for k in (TIME, what)]
        panel.plot(*line, color=LINE, lw=0.8)
        panel.set(xscale="log", yscale="log", xlabel="processor time of a point (µs), one core")
        panel.margins(x=0.16, y=0.08)
        plain_ticks(panel.xaxis, panel.yaxis)
        texts[panel] = [
            (n.removeprefix("SlipScope: "), f[TIME], f[what], OURS if "Slip" in n else THEIRS)
            for n, f in points.items()
        ] + along(*line)
    panels[0].set_ylabel("standard deviation of $u_x$ (px)")
    panels[1].set_ylabel("rms error of $u_x$ in a slipping contact (px)")
    figure.suptitle(f"1600 x 1200 px, noise of 2 grey levels; {machine()}", fontsize=8, color=LINE)
    label(figure, texts, 6.5)
    figure.savefig(path, dpi=110)
