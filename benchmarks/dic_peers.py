"""What other libraries reach on the pictures whose displacement is exact: speed on one core,
translation, and the graded ring of the contact. All measure boxes of 20 or 21 px every 10 px of
pictures of 1600 x 1200.

    python -m benchmarks dic_peers [--frames 5] [--peers "OpenCV LK" ...] [--python PYTHON]

pyvale, sun-dic and al-dic (benchmarks/peer_programs.py) take part if they are installed, perhaps in
an environment of their own, whose PYTHON is given:

    python -m venv peers && peers/bin/pip install pyvale sun-dic al-dic psutil
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import cv2
import numpy as np

from benchmarks.report import Report
from benchmarks.scores import (
    BOX,
    Array,
    Measured,
    Picture,
    Program,
    Start,
    Step,
    installed,
    table,
)

SUBJECT = "Image correlation: other libraries"
SMOOTHING = {"Iterations": 1, "Alpha": 3, "Delta": 1, "Gamma": 0}
DIS = {"FinestScale": 1, "GradientDescentIterations": 10, "PatchSize": 8, "PatchStride": 3}


def lattice(shape: tuple[int, ...]) -> Array:
    """Points every 10 px that are 15 px or more inside, shape (2, n): x and y."""
    return np.mgrid[15 : shape[0] - 14 : 10, 15 : shape[1] - 14 : 10].reshape(2, -1)[::-1]


def lucas_kanade(reference: Picture) -> Step:
    """Pyramid level 0, window 21, at most 5 iterations from the last frame's displacement."""
    x, y = lattice(reference.shape)
    origin = last = np.stack([x, y], -1).astype(np.float32)[:, None]
    until = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 5, 0.03
    options = {
        "winSize": (21, 21),
        "maxLevel": 0,
        "criteria": until,
        "flags": cv2.OPTFLOW_USE_INITIAL_FLOW,
    }

    def step(image: Picture) -> Measured:
        nonlocal last
        last, kept, _ = cv2.calcOpticalFlowPyrLK(reference, image, origin, last.copy(), **options)
        return x, y, *np.where(kept == 1, (last - origin)[:, 0], np.nan).T

    return step


def dense_flow(reference: Picture) -> Step:
    """DIS as the package crappy sets it for live use, started from the last flow; the mean of each
    box.
    """
    x, y = lattice(reference.shape)
    flow, last = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST), None
    for name, value in (
        DIS | {f"VariationalRefinement{name}": value for name, value in SMOOTHING.items()}
    ).items():
        getattr(flow, f"set{name}")(value)

    def step(image: Picture) -> Measured:
        nonlocal last
        last = flow.calc(reference, image, last)
        return x, y, *cv2.boxFilter(last, -1, (21, 21))[y, x].T

    return step


def match_template(reference: Picture, search: int = 2) -> Step:
    """Normalised correlation around the last whole-pixel displacement; 2D Gaussian through the nine
    highest values.
    """
    x, y = lattice(reference.shape)
    boxes = [reference[j - 10 : j + 10, i - 10 : i + 10] for i, j in zip(x, y, strict=True)]
    place = np.stack([x, y], -1) - 10 - search
    start, side = place.copy(), BOX + 2 * search
    down, across = np.mgrid[-1:2, -1:2].astype(float)
    fit = np.linalg.pinv(
        np.stack([np.ones((3, 3)), across, down, across**2, across * down, down**2], -1).reshape(
            9, 6
        )
    )

    def step(image: Picture) -> Measured:
        peaks = np.full((len(x), 9), np.nan)
        for k in np.flatnonzero((place >= 0).all(1) & (place + side <= image.shape[::-1]).all(1)):
            i, j = place[k]
            scores = cv2.matchTemplate(
                image[j : j + side, i : i + side], boxes[k], cv2.TM_CCOEFF_NORMED
            )
            m, n = cv2.minMaxLoc(scores)[3]
            place[k] += m - search, n - search
            if 0 < m < 2 * search and 0 < n < 2 * search:
                peaks[k] = scores[n - 1 : n + 2, m - 1 : m + 2].ravel()
        _, bx, by, xx, xy, yy = fit @ np.log(np.maximum(peaks, 1e-3)).T
        determinant = 4 * xx * yy - xy**2
        top = np.array([xy * by - 2 * yy * bx, xy * bx - 2 * xx * by]) / determinant
        return (
            x - 0.5,
            y - 0.5,
            *np.where((determinant > 0) & (xx < 0), (place - start).T + top, np.nan),
        )

    return step


PEERS: dict[str, Start] = {
    "OpenCV LK": lucas_kanade,
    "OpenCV DIS": dense_flow,
    "OpenCV matchTemplate": match_template,
}
PROGRAMS = ("pyvale", "sun-dic", "al-dic")


def chosen(peers: Sequence[str], python: str) -> dict[str, Start | Program]:
    """The peers of these names; a sentence for each program that is not installed."""
    programs = [name for name in PROGRAMS if name in peers]
    there = installed(python, programs)
    for name in programs:
        if name not in there:
            print(f"{name} is left out: {python} does not have it; see --help")
    found: dict[str, Start | Program] = {name: PEERS[name] for name in peers if name in PEERS}
    return found | {name: Program(name, python) for name in there}


def measure(
    report: Report,
    *,
    frames: int | None = None,
    peers: Annotated[Sequence[str], (*PEERS, *PROGRAMS)] = (*PEERS, *PROGRAMS),
    python: str = sys.executable,
) -> None:
    """Fill the table."""
    cv2.setNumThreads(1)
    table(report, chosen(peers, python), frames)
