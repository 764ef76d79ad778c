"""What other libraries reach on the same exact pictures: speed on one core, translation, and the
graded ring of the contact.

    python benchmarks/dic_peers.py [--frames 5] [--peers "OpenCV LK" ...]

A peer is a function ``start(reference) -> step(image) -> (x, y, ux, uy)``: flat arrays in pixels at
points of the reference, NaN where the point is lost. All measure boxes of 20-21 px every 10 px of
pictures of 1600 x 1200. OpenPIV is there if it is installed.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.speckle import SIZE, Frame, images

Array = NDArray[Any]
Measured = tuple[Array, Array, Array, Array]
Step = Callable[[NDArray[np.uint8]], Measured]
Peer = Callable[[NDArray[np.uint8]], Step]

BOX = 20
# a box that is nearer to the border of the picture, before or after it moved, is not scored
BORDER_PX = 6
WRONG_PX = 1.0  # a point further from the truth counts as lost, not as noise
SMOOTHING = {"Iterations": 1, "Alpha": 3, "Delta": 1, "Gamma": 0}
DIS = {"FinestScale": 1, "GradientDescentIterations": 10, "PatchSize": 8, "PatchStride": 3}


class Score(NamedTuple):
    """Errors of u_x in pixels over all frames, and the share of points that are lost or wrong."""

    worst_bias: float
    sigma: float
    rmse: float
    lost: float


def score_translation(
    frames: Iterable[Frame], measured: Iterable[Measured], box: int = BOX
) -> Score:
    """Greatest bias of a frame, scatter within the frames and total error, of the scored points of
    every frame.
    """
    return _score(
        [_errors(frame, *points, box)[0] for frame, points in zip(frames, measured, strict=True)]
    )


def score_ring(frames: Iterable[Frame], measured: Iterable[Measured], box: int = BOX) -> Score:
    """The same in the graded zone of the contact; ``rmse`` is the figure to compare."""
    errors = [_errors(frame, *points, box) for frame, points in zip(frames, measured, strict=True)]
    return _score([error[ring] for error, ring in errors])


def _errors(
    frame: Frame, x: Array, y: Array, ux: Array, uy: Array, box: int
) -> tuple[Array, Array]:
    """Errors of u_x at the scored points, NaN where lost or wrong, and which of them lie in the
    ring.
    """
    true_x, true_y = frame.truth(x, y)
    least = box / 2 + BORDER_PX
    last_y, last_x = (size - 1 - least for size in frame.image.shape)
    scored = (
        (np.minimum(x, x + true_x) >= least)
        & (np.maximum(x, x + true_x) <= last_x)
        & (y >= least)
        & (y <= last_y)
    )
    right = np.maximum(abs(ux - true_x), abs(uy - true_y)) <= WRONG_PX
    return np.where(right, ux - true_x, np.nan)[scored], frame.truth.ring(x, y)[scored]


def _score(errors: Sequence[Array]) -> Score:
    found = [error[np.isfinite(error)] for error in errors]
    every, biases = (
        np.concatenate(found),
        [error.mean() if error.size else np.nan for error in found],
    )
    within = np.concatenate([error - bias for error, bias in zip(found, biases, strict=True)])
    return Score(
        np.nanmax(np.abs(biases)),
        within.std(),
        np.sqrt(np.mean(every**2)),
        1 - every.size / sum(map(len, errors)),
    )


def follow(peer: Peer, frames: Sequence[Frame]) -> tuple[list[Measured], list[float]]:
    """The fields of a sequence whose first frame is the reference, and the processor seconds of
    each; one call before warms up.
    """
    peer(frames[0].image)(frames[1].image)
    step, fields, spent = peer(frames[0].image), [], []
    for frame in frames[1:]:
        began = time.process_time()
        fields.append(step(frame.image))
        spent.append(time.process_time() - began)
    return fields, spent


def lattice(shape: tuple[int, ...]) -> Array:
    """Points every 10 px that are 15 px or more inside, shape (2, n): x and y."""
    return np.mgrid[15 : shape[0] - 14 : 10, 15 : shape[1] - 14 : 10].reshape(2, -1)[::-1]


def lucas_kanade(reference: NDArray[np.uint8]) -> Step:
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

    def step(image: NDArray[np.uint8]) -> Measured:
        nonlocal last
        last, kept, _ = cv2.calcOpticalFlowPyrLK(reference, image, origin, last.copy(), **options)
        return x, y, *np.where(kept == 1, (last - origin)[:, 0], np.nan).T

    return step


def dense_flow(reference: NDArray[np.uint8]) -> Step:
    """DIS as the package crappy sets it for live use, started from the last flow; the mean of each
    box.
    """
    x, y = lattice(reference.shape)
    flow, last = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST), None
    for name, value in (
        DIS | {f"VariationalRefinement{name}": value for name, value in SMOOTHING.items()}
    ).items():
        getattr(flow, f"set{name}")(value)

    def step(image: NDArray[np.uint8]) -> Measured:
        nonlocal last
        last = flow.calc(reference, image, last)
        return x, y, *cv2.boxFilter(last, -1, (21, 21))[y, x].T

    return step


def match_template(reference: NDArray[np.uint8], search: int = 2) -> Step:
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

    def step(image: NDArray[np.uint8]) -> Measured:
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


def openpiv(reference: NDArray[np.uint8]) -> Step:
    """Window deformation in 5 passes, 64 to 20 px."""
    from openpiv import settings, windef

    options = settings.PIVSettings(
        windowsizes=(64, 32, 20, 20, 20), overlap=(32, 16, 10, 10, 10), num_iterations=5
    )
    options.deformation_method, options.interpolation_order, options.sig2noise_method = (
        "second image",
        5,
        None,
    )
    options.sig2noise_validate = options.smoothn = options.show_all_plots = False
    options.normalized_correlation = options.use_vectorized = True
    first = reference.astype(np.int32)

    def step(image: NDArray[np.uint8]) -> Measured:
        with contextlib.redirect_stdout(None):  # it reports every pass
            x, y, ux, uy, _ = windef.first_pass(first, second := image.astype(np.int32), options)
            for k in range(1, options.num_iterations):
                ux, uy = np.ma.masked_array(ux, mask=False), np.ma.masked_array(uy, mask=False)
                x, y, ux, uy, _, _ = windef.multipass_img_deform(
                    first, second, k, x, y, ux, uy, options
                )
        return tuple(np.ma.filled(a, np.nan).ravel() for a in (x, y, ux, uy))

    return step


PEERS: dict[str, Peer] = {
    "OpenCV LK": lucas_kanade,
    "OpenCV DIS": dense_flow,
    "OpenCV matchTemplate": match_template,
} | ({"OpenPIV deformation": openpiv} if importlib.util.find_spec("openpiv") else {})


def main() -> None:
    """Print the table."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument(
        "--frames",
        type=int,
        metavar="N",
        help="only the first N of the 20 or 21 moved frames of each set",
    )
    ask.add_argument("--peers", nargs="+", default=list(PEERS), choices=PEERS, metavar="PEER")
    options = ask.parse_args()
    cv2.setNumThreads(1)
    print(
        f"{SIZE[1]} x {SIZE[0]} px; errors in px: translation worst bias / sigma / rmse, ring rmse;"
        " lost or wrong points in %"
    )
    print(
        "peer                      points/s   noise 0: translation           ring     noise 2:"
        " translation           ring     lost"
    )
    for name in options.peers:
        cells, spent, lost, points = [], [], 0.0, 0
        for noise, (kind, score) in product(
            (0, 2), (("translation", score_translation), ("contact", score_ring))
        ):
            frames = list(images(kind, noise))[: options.frames and options.frames + 1]
            measured, seconds = follow(PEERS[name], frames)
            bias, sigma, rmse, wrong = score(frames[1:], measured)
            cells.append(
                f"  {bias:.4f} / {sigma:.4f} / {rmse:.4f}"
                if kind == "translation"
                else f"  {rmse:.4f}"
            )
            spent, lost, points = spent + seconds, max(lost, wrong), measured[0][0].size
        print(
            f"{name:24s} {points / np.median(spent):9.0f} {'  '.join(cells)}  {100 * lost:6.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
