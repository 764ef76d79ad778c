"""A loading experiment before and after the calibration of its bench: simulated benches whose true
constants are not those of their settings (size of a pixel, sensors and their cross-talk, compliance
of the lens holder, direction of the drive, distortion of the lens, unequal pixels) measure the
same contact twice; between the two, scale, forces, pattern and compliance are calibrated.

    python -m benchmarks calibrated_bench [--seeds 6]

u       total standard uncertainty that the run states, median of the benches
pull    (value - truth) / u: rms and largest of the benches

Before a calibration the settings are wrong by several of the uncertainties that they state; the
bounds are those of the run after it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from analysis.options import UNITS
from app.calibrations.lens_holder import LensHolder, LensHolderOptions
from app.calibrations.pattern_map import PatternCalibration, PatternOptions
from app.calibrations.pixel_scale import ScaleCalibration, ScaleOptions
from app.calibrations.weights import ForceCalibration, WeightOptions
from app.records.quantities import Measurement, summary_quantities
from app.settings.config import load
from benchmarks import simulated
from benchmarks.loading_experiment import Recorded, true_values
from benchmarks.report import ROOT, Report
from slipscope import Session

sys.path += [str(ROOT / "tests"), str(ROOT / "tests/calibration")]
from hidden_runs import certify

SUBJECT = "Calibrated bench"
MEASURES = ("analysis", "app.calibrations", "app.evaluation", "drivers.sim")
STRIP = 80  # px at the top of the image, which shows marks on the lens while that is calibrated
SIZE = 640, 560  # px
PICTURE = f"camera.width={SIZE[0]}", f"camera.height={SIZE[1]}"
PIXEL = "camera.pixel=12"  # um, until a certificate gives it
MARKS = f"inside 0 0 {SIZE[0]} 0 {SIZE[0]} {STRIP} 0 {STRIP}"
CALIBRATIONS = (
    (ScaleCalibration(), ScaleOptions(velocity=50e-6), ()),
    (ForceCalibration(), WeightOptions(), ()),
    (PatternCalibration(), PatternOptions(), ()),
    (LensHolder(), LensHolderOptions(region=(MARKS,)), (f"sim.lens_marks={STRIP}",)),
)


class HiddenBench:
    """A bench with constants of its own, whatever its settings say of them."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([40, seed])
        said = load(None, [PIXEL])
        self.pixel = said.camera.pixel * rng.uniform(0.98, 1.02)
        self.normal = said.forces.stiffness_normal * rng.uniform(0.98, 1.02)
        self.shear = said.forces.stiffness_shear * rng.uniform(0.98, 1.02)
        self.coupling = rng.uniform(-0.02, 0.02, 2)
        self.compliance = said.sample.lens_compliance * rng.uniform(0.6, 1.4)
        self.world = (
            *(f"sim.seed={seed}", f"sim.drive_angle={rng.uniform(-2, 2)}"),
            *(f"sim.distortion={rng.uniform(-0.5, 0.5)}", "sim.unequal_pixels=3"),
        )

    def settings(self, certificates: Sequence[Path], *more: str) -> list[str]:
        """The settings that a file or the named certificates give, of this bench."""
        names = ", ".join(f'"{path.as_posix()}"' for path in certificates)
        pixel = [] if certificates else [PIXEL]  # the first calibration is that of the scale
        given = [
            *PICTURE,
            *pixel,
            "run.shear_tolerance=0.05",
            *self.world,
            *more,
            f"calibration.certificates=[{names}]",
        ]
        said = load(None, given)
        normal, shear = (coupling - said.forces.coupling[i][1 - i] for i, coupling in
                         enumerate(self.coupling))  # fmt: skip
        errors = (
            f"camera.pixel {self.pixel / said.camera.pixel:.9f}",
            f"forces.sensitivity_normal {self.normal / said.forces.stiffness_normal:.9f}",
            f"forces.stiffness_shear {self.shear / said.forces.stiffness_shear:.9f}",
            f"forces.normal_from_shear {normal:.9f}",
            f"forces.shear_from_normal {shear:.9f}",
            f"sample.lens_compliance {self.compliance / said.sample.lens_compliance:.9f}",
        )
        listed = ", ".join(f'"{one}"' for one in errors)
        return [*given, f"sim.errors=[{listed}]"]


def measured(path: Path, settings: Sequence[str]) -> dict[str, tuple[Measurement, float]]:
    """The results of a run with their truths."""
    made = simulated.experiment(path, settings, pace=None)
    outcome = made.outcome()
    assert outcome.state == "done", outcome.reason
    with Session(path) as session:
        assert session.summary is not None
        true = true_values(Recorded(session, made.bench.world))
        found = summary_quantities(session.summary)
    return {one.name: (one, true[one.key]) for one in found if one.key in true}


def before_and_after(seed: int) -> tuple[dict[str, tuple[Measurement, float]], ...]:
    """The results of a bench before it is calibrated, and after."""
    bench = HiddenBench(seed)
    with tempfile.TemporaryDirectory() as name:
        folder, certificates = Path(name), list[Path]()
        before = measured(folder / "before.h5", bench.settings(()))
        for calibration, options, more in CALIBRATIONS:
            path = folder / f"{calibration.name}.zip"
            certify(path, calibration, options, *bench.settings(certificates, *more))
            certificates.append(path)
        return before, measured(folder / "after.h5", bench.settings(certificates))


def pull(found: Measurement, true: float) -> tuple[float, float]:
    """Error in total standard uncertainties, and that uncertainty."""
    return (found.value - true) / found.total, found.total


def measure(report: Report, *, seeds: int = 6) -> int:
    """Measure so many benches; 1 where a bound is missed."""
    benches = [before_and_after(seed) for seed in range(seeds)]
    for title, which, bound in (("before", 0, None), ("after", 1, 3.0)):
        report.table(f"{title} the calibration, benches: {seeds}")
        for name, (first, _) in benches[0][which].items():
            pulls, totals = np.transpose([pull(*bench[which][name]) for bench in benches])
            report.row(
                name,
                u=(float(np.median(totals)) / UNITS[first.unit], first.unit),
                rms_pull=float(np.sqrt(np.mean(pulls**2))),
                largest_pull=(float(np.abs(pulls).max()), "", bound),
            )
    return int(any(figure.is_missed for figure in report.results.figures))
