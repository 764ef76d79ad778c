"""Speed and errors of a correlation on the pictures of `benchmarks.speckle`: the same table for the
methods of `analysis.dic` and for other libraries.

A correlation is here a function ``start(reference) -> step(image) -> (x, y, ux, uy)``: flat arrays
in pixels at points of the reference, NaN where the point is lost; a fifth one is the standard
uncertainty of ux, where there is one.
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import ROOT, Report
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


@dataclass(frozen=True, slots=True)
class Program:
    """A program of `benchmarks/peer_programs.py`, which correlates a whole series, and the Python
    that has it.
    """

    name: str
    python: str

    def follow(self, frames: Sequence[Frame]) -> tuple[list[Measured], list[float]]:
        """See `follow`."""
        with tempfile.TemporaryDirectory() as folder:
            np.save(Path(folder, "frames.npy"), np.stack([frame.image for frame in frames]))
            command = [
                self.python,
                str(ROOT / "benchmarks" / "peer_programs.py"),
                self.name,
                folder,
            ]
            threads = {f"{x}_NUM_THREADS": "1" for x in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                env=os.environ | threads,
                cwd=folder,  # some leave logs where they are started
                check=False,
            )
            if done.returncode:
                raise RuntimeError(f"{self.name}: {done.stderr.strip().splitlines()[-1]}")
            with np.load(Path(folder, "fields.npz")) as found:
                fields = list(zip(*(found[k] for k in ("x", "y", "ux", "uy")), strict=True))
                return fields, [float(found["seconds"])] * len(fields)


def installed(python: str, names: Iterable[str]) -> list[str]:
    """Which of these programs that Python has; a program's package has no hyphen."""
    find = "import sys, importlib.util as u; print([bool(u.find_spec(n)) for n in sys.argv[1:]])"
    packages = {"sun-dic": "sundic", "al-dic": "al_dic"}
    words = [packages.get(name, name) for name in names]
    done = subprocess.run([python, "-c", find, *words], capture_output=True, text=True, check=True)
    return [name for name, has in zip(names, json.loads(done.stdout.lower()), strict=True) if has]


def follow(start: Start | Program, frames: Sequence[Frame]) -> tuple[list[Measured], list[float]]:
    """The fields of a sequence whose first frame is the reference, and the processor seconds of
    each, after one call that warms everything up.
    """
    if isinstance(start, Program):
        return start.follow(frames)
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
    return np.asarray(every[np.abs(every) < 8])


def table(
    report: Report,
    starts: Mapping[str, Start | Program],
    limit: int | None,
    bounds: Mapping[tuple[str, str], float] | None = None,
) -> None:
    """Report the errors of both sets without and with noise of 2 grey levels, the points per second
    with noise, and the lost points, for each correlation. `bounds` are the promised errors, pixels,
    by the names of the correlation and the column.
    """
    bounds = bounds or {}
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
                points = measured[0][0].size
                if noise:
                    spent += seconds
                    normalised.append(over_uncertainty(frames[1:], measured))
            translation, ring = scores
            lost = max(lost, translation.lost, ring.lost)
            errors = {
                "bias": translation.worst_bias,
                "sigma": translation.sigma,
                "ring": ring.rmse,
            }
            for kind, error in errors.items():
                column = f"{kind}, noise {noise}"
                report.add(name, error, "px", bounds.get((name, column)), column=column)
        report.add(name, points / np.median(spent), "1/s", column="points per second")
        report.add(name, 100 * lost, "%", column="lost or wrong")
        unit = np.concatenate(normalised)
        if unit.size:
            report.add(name, unit.std(), column="error over stated uncertainty")
