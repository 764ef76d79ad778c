"""Speed and errors of a correlation on the pictures of `benchmarks.speckle`: the same table for the
methods of `analysis.dic` and for other libraries.

A correlation is here a function ``start(reference) -> step(image) -> (x, y, ux, uy)``: flat arrays
in pixels at points of the reference, NaN where the point is lost; a fifth one is the standard
uncertainty of ux, where there is one.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Report
from benchmarks.speckle import Frame, images

Array = NDArray[Any]
Picture = NDArray[np.uint8]
Measured = tuple[Array, ...]
Step = Callable[[Picture], Measured]
Start = Callable[[Picture], Step]

BOX = 20
BORDER_PX = (
    6  # a box closer to the border of the picture, before or after its motion, is not scored
)
WRONG_PX = 1.0  # a point further from the truth counts as lost, not as noise


class Score(NamedTuple):
    """Errors of u_x in pixels over all frames, and the share of points that are lost or wrong."""

    worst_bias: float
    sigma: float
    rmse: float
    lost: float


def score_translation(
    frames: Iterable[Frame], measured: Iterable[Measured], box: int = BOX
) -> Score:
    """Largest bias of a frame, scatter within the frames and total error, of the scored points."""
    pairs = zip(frames, measured, strict=True)
    return _score([_errors(frame, points, box)[0] for frame, points in pairs])


def score_ring(frames: Iterable[Frame], measured: Iterable[Measured], box: int = BOX) -> Score:
    """The same in the graded zone of the contact; ``rmse`` is the value to compare."""
    errors = [_errors(frame, points, box) for frame, points in zip(frames, measured, strict=True)]
    return _score([error[ring] for error, ring in errors])


def _errors(frame: Frame, points: Measured, box: int) -> tuple[Array, Array]:
    """Errors of u_x at the scored points, NaN where lost or wrong, and which points lie in the
    graded zone.
    """
    x, y, ux, uy = points[:4]
    true_x, true_y = frame.truth(x, y)
    least = box / 2 + BORDER_PX
    last_y, last_x = (size - 1 - least for size in frame.image.shape)
    stays = (np.minimum(x, x + true_x) >= least) & (np.maximum(x, x + true_x) <= last_x)
    scored = stays & (y >= least) & (y <= last_y)
    right = np.maximum(abs(ux - true_x), abs(uy - true_y)) <= WRONG_PX
    return np.where(right, ux - true_x, np.nan)[scored], frame.truth.ring(x, y)[scored]


def _score(errors: Sequence[Array]) -> Score:
    found = [error[np.isfinite(error)] for error in errors]
    biases = [error.mean() if error.size else np.nan for error in found]
    every = np.concatenate(found)
    within = np.concatenate([error - bias for error, bias in zip(found, biases, strict=True)])
    lost = 1 - every.size / sum(map(len, errors))
    return Score(np.nanmax(np.abs(biases)), within.std(), np.sqrt(np.mean(every**2)), lost)


def frames_of(name: str, noise: float, limit: int | None) -> list[Frame]:
    """The reference and the first `limit` frames of a set."""
    return list(images(name, noise))[: limit and limit + 1]


def follow(start: Start, frames: Sequence[Frame]) -> tuple[list[Measured], list[float]]:
    """The fields of a sequence whose first frame is the reference, and the processor seconds of
    each, after one call that warms everything up.
    """
    start(frames[0].image)(frames[1].image)
    step, fields, spent = start(frames[0].image), [], []
    for frame in frames[1:]:
        began = time.process_time()
        fields.append(step(frame.image))
        spent.append(time.process_time() - began)
    return fields, spent


def over_uncertainty(frames: Iterable[Frame], measured: Iterable[Measured]) -> Array:
    """Errors of u_x over their stated uncertainties, of all points; empty if there are none."""
    pairs = zip(frames, measured, strict=True)
    stated = [(m[2] - frame.truth(*m[:2])[0]) / m[4] for frame, m in pairs if len(m) > 4]
    every = np.concatenate([*stated, np.empty(0)])
    return every[np.abs(every) < 8]


def table(report: Report, starts: Mapping[str, Start], limit: int | None) -> None:
    """Report points per second, the errors of both sets without and with noise of 2 grey levels,
    and the lost points, for each correlation.
    """
    report.table(
        "Errors of u_x; translation: worst bias and sigma over 21 fractions of a pixel; ring: rms"
        " error in the zone of a contact where the slope reaches 1.9 %; noise in grey levels"
    )
    for name, start in starts.items():
        spent, lost, points, normalised = [], 0.0, 0, []
        for noise in (0, 2):
            scores = []
            for kind, score in (("translation", score_translation), ("contact", score_ring)):
                frames = frames_of(kind, noise, limit)
                measured, seconds = follow(start, frames)
                scores.append(score(frames[1:], measured))
                spent, points = spent + seconds, measured[0][0].size
                if noise:
                    normalised.append(over_uncertainty(frames[1:], measured))
            translation, ring = scores
            lost = max(lost, translation.lost, ring.lost)
            report.add(name, translation.worst_bias, "px", column=f"bias, noise {noise}")
            report.add(name, translation.sigma, "px", column=f"sigma, noise {noise}")
            report.add(name, ring.rmse, "px", column=f"ring, noise {noise}")
        report.add(name, points / np.median(spent), "1/s", column="points per second")
        report.add(name, 100 * lost, "%", column="lost or wrong")
        unit = np.concatenate(normalised)
        if unit.size:
            report.add(name, unit.std(), column="error over stated uncertainty")
