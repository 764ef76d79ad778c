"""Whether calibrations hold what they state: benches with hidden constants, each measured and
fitted as a calibration does it, against the constants. Forces also on the simulated bench, and
scale, compliance, stage and pattern on whole ones: settings, run, session, certificate.

    python -m benchmarks calibrations [--seeds 60] [--whole 6] [--only WORD...]

within 1, within 2   share of the benches (of the pictures' pixels, for a pattern) whose truth lies
                     within one and two stated standard uncertainties: 68 and 95 % of a normal
                     distribution. The share within one of 60 benches scatters by 6 %.
rms, worst           error; relative where its unit is %, but of cross-talk, which is a share of the
                     other force
stated               median of the stated standard uncertainty
mean, largest pull   (value - truth) / sd of the whole benches, of which there are few

Each bench differs from the settings by draws from their uncertainties, its readings have noise that
is correlated, drifts and outliers where the real ones have them. `--only` takes the tables whose
titles have such a word.
"""

from __future__ import annotations

import math
import multiprocessing
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.report import ROOT, Report

sys.path += [str(ROOT / "tests"), str(ROOT / "tests/calibration")]
import hidden_benches as benches
import hidden_runs as runs
import hidden_samples as samples
from seeds import joined, pulls

SUBJECT = "Calibrations"
MEASURES = (
    *("analysis", "app.calibrations", "drivers.sim"),
    # in full: the checksum of the measured code follows the names that it reads here
    *("tests.calibration.hidden_benches", "tests.calibration.hidden_runs"),
    *("tests.calibration.hidden_samples", "tests.calibration.seeds"),
)
TABLES = {
    "forces": (benches.stiffness, benches.hung, benches.pressed),
    "scale": (
        benches.scale_by_travel,
        partial(benches.scale_by_lines, shape=(480, 640), noise=2.0),
        partial(
            benches.scale_by_board,
            shape=(480, 640),
            corners=(14, 10),
            square=36.0,
            noise=2.0,
            origin=(75, 45),
        ),
    ),
    "camera": (benches.pattern_of_flat, benches.pattern_of_motion, benches.photons),
    "lens holder and stage": (
        *(samples.compliance, samples.velocity, samples.velocity_jitter, samples.lost_motion),
        *(samples.screw, samples.bow),
    ),
    "timing": (samples.lag, samples.skew, samples.clocks),
    "sample": (samples.adhesion, samples.rough, samples.rough_affine, samples.radii_over_loads),
}
WHOLE = runs.scale, runs.compliance, runs.actuator, runs.pattern
DEGREES = "degrees", 180 / math.pi
UNITS = {  # of an absolute error, and how much of it is one SI unit; others are relative
    "cross-talk": ("%", 100.0),
    "angle": DEGREES,
    "distortion": ("px", 1.0),
    "pattern": ("grey levels", 1.0),
    "drift of the picture": ("px/s", 1.0),
    "drift of the camera": ("ppm", 1e6),
    "exposure lag": ("samples", 1.0),
    "skew": ("us", 1e6),
}
ASKED = {  # rms errors, by how the name of a constant begins
    "stiffness": 0.5,
    "N/V": 0.5,
    "cross-talk": 0.1,
    "scale": 0.05,
    "angle": 0.02,
    "distortion": 0.02,
    "pattern": 0.3,
    "compliance": 3.0,
    "E by JKR": 1.5,
    "h ": 2.0,
    "h,": 2.0,
    "velocity": 0.1,
    "exposure lag": 1.0,
}
LEAST_ONE, MOST_ONE, LEAST_TWO = 60.0, 76.0, 90.0  # per cent


def measure(report: Report, *, seeds: int = 60, whole: int = 6, only: Sequence[str] = ()) -> int:
    """Measure so many benches of each kind, and so many whole ones; 1 where a bound is missed."""
    shares = []
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for title, kinds in TABLES.items():
            if only and not any(word in title for word in only):
                continue
            report.table(f"{title}: {seeds} benches of each kind")
            for kind in kinds:
                for name, measured in joined(pool.imap(kind, range(seeds), 4)).items():
                    shares.append(tell(report, name, *measured))
        if not only or any(word in "whole benches" for word in only):
            report.table(f"whole benches: {whole} of each kind")
            for kind in WHOLE:
                for name, measured in joined(pool.imap(kind, range(whole))).items():
                    tell_pulls(report, name, measured)
    if shares:
        tell_all(report, np.array(shares))
    return int(any(figure.is_missed for figure in report.results.figures))


def tell(
    report: Report, name: str, found: np.ndarray, sd: np.ndarray, true: np.ndarray
) -> tuple[float, float, int]:
    """Report one constant; its shares within one and two standard uncertainties, per cent, and of
    how many.
    """
    size = np.abs(found - true) / sd
    one, two = (100 * float(np.mean(size < sigmas)) for sigmas in (1, 2))
    unit, scale = _first(UNITS, name) or ("%", 100 / np.abs(true))
    error = np.abs(found - true) * scale
    report.row(
        name,
        within_1=(one, "%"),
        within_2=(two, "%"),
        rms=(math.sqrt(np.mean(error**2)), unit, _first(ASKED, name)),
        worst=(error.max(), unit),
        stated=(np.median(sd * scale), unit),
    )
    return one, two, len(size)


def tell_pulls(report: Report, name: str, measured: np.ndarray) -> None:
    """Report one constant of few benches; together they are off by more than chance makes them
    where the mean pull is far beyond 1/sqrt(n), or the largest one beyond 3.
    """
    off, (found, sd, true) = pulls(measured), measured
    report.row(
        name,
        mean_pull=(off.mean(), ""),
        largest_pull=(float(np.abs(off).max()), "", 4.0),
        rms=(100 * math.sqrt(np.mean((found / true - 1) ** 2)), "%"),
        stated=(100 * float(np.median(sd / np.abs(true))), "%"),
    )


def _first(table, name):
    return next((value for start, value in table.items() if name.startswith(start)), None)


def tell_all(report: Report, shares: np.ndarray) -> None:
    """Report what all constants come to."""
    one, two, count = shares.T
    report.table("all constants together")
    report.add("constants", len(shares))
    report.add("mean share within one", one.mean(), "%")
    report.add("mean share within one less the 68.3 % of a Gaussian", one.mean() - 68.3, "%", 7.7)
    report.add("mean share beyond two", 100 - two.mean(), "%", 100 - LEAST_TWO)
    report.add("constants of which fewer than 60 % are within one", int(np.sum(one < LEAST_ONE)))
    report.add("constants of which more than 76 % are within one", int(np.sum(one > MOST_ONE)))
    report.add("constants of which fewer than 90 % are within two", int(np.sum(two < LEAST_TWO)))
    sd = 46.6 / np.sqrt(count)
    edges = (np.array([[LEAST_ONE], [MOST_ONE]]) - 68.3) / sd
    by_chance = [0.5 * math.erfc(abs(edge) / math.sqrt(2)) for edge in edges.ravel()]
    report.add("outside of 60 to 76 % by chance alone, expected", sum(by_chance))
    report.add(
        "farthest share within one from 68.3 %, in its scatter", np.abs((one - 68.3) / sd).max()
    )
