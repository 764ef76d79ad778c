"""Whole simulated benches whose constants their settings do not know, from the settings over the
runs and their sessions to the certificate; see `hidden_benches`.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from hidden_benches import Found
from whole_runs import ran

from app.calibrations.actuator import ActuatorCalibration, ActuatorOptions
from app.calibrations.certifying import evaluated
from app.calibrations.lens_holder import LensHolder, LensHolderOptions
from app.calibrations.pattern_map import PatternCalibration, PatternOptions
from app.calibrations.pixel_scale import ScaleCalibration, ScaleOptions
from app.calibrations.session_readings import relative_sd_of_forces
from app.runs.live import scenario
from app.settings.certificates import read_certificate
from app.settings.config import load

SMALL = "camera.width=240", "camera.height=200", "run.normal_force=0.3", "dic.threads=1"
STRIP = 80


def certify(path, calibration, options, *settings):
    """Calibrate a bench and write the certificate at `path`; the settings of its first run."""
    plan = calibration.plan(load(None, settings), options)
    with TemporaryDirectory() as folder:
        sessions = [Path(folder) / f"{n}.h5" for n in range(len(plan))]
        for config, session in zip(plan, sessions, strict=True):
            ran(config, session)
        evaluated(calibration, sessions, options).write(path, overwrite=False)
    return plan[0]


def certified(calibration, options, *settings):
    """The measurements in the certificate of a bench by their keys, and the settings of its first
    run.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "c.zip"
        config = certify(path, calibration, options, *SMALL, *settings)
        return {one.key: one for one in read_certificate(path).values}, config


def hidden(**factors):
    """The setting that makes these constants others than the settings say."""
    names = ", ".join(f'"{key.replace("__", ".")} {by:.9f}"' for key, by in factors.items())
    return f"sim.errors=[{names}]"


def scale(seed) -> Found:
    """A free block that is moved, under a turned camera with a lens; its stage has no error."""
    rng = np.random.default_rng([30, seed])
    factor, turned, k = rng.uniform(0.98, 1.02), rng.uniform(-3, 3), rng.uniform(-1, 1)
    # of each bench another, which its encoder rounds otherwise
    travel = rng.uniform(140e-6, 160e-6)
    told, _ = certified(
        *(ScaleCalibration(), ScaleOptions(travel=travel, velocity=50e-6, relative=0.0)),
        *(hidden(camera__pixel=factor), f"sim.seed={seed}"),
        *(f"sim.drive_angle={turned}", f"sim.distortion={k}"),
    )
    truths = {"pixel_m": 7.04e-6 * factor, "angle_degrees": turned, "distortion_percent": k}
    return {f"scale, {key}": (told[key].value, told[key].sd, v) for key, v in truths.items()}


def compliance(seed) -> Found:
    """Marks on the lens; pixel and sensor differ from the settings by what these state."""
    rng = np.random.default_rng([31, seed])
    said = load(None, ())
    pixel, newtons = 1 + rng.standard_normal(2) * (
        said.uncertainty.pixel,
        relative_sd_of_forces(said)[1],
    )
    gives = rng.uniform(0.8, 1.25)
    told, _ = certified(
        LensHolder(),
        LensHolderOptions(region=(f"inside 0 0 240 0 240 {STRIP} 0 {STRIP}",), cycles=1),
        *("camera.pixel=12", "camera.divisor=125", "run.velocity=10"),
        *(f"sim.lens_marks={STRIP}", "sim.pressure=hertz", f"sim.seed={seed}"),
        hidden(
            sample__lens_compliance=gives, camera__pixel=pixel, forces__sensitivity_shear=newtons
        ),
    )
    found = told["lens_compliance_m_n"]
    return {"compliance": (found.value, found.sd, gives * said.sample.lens_compliance)}


def actuator(seed) -> Found:
    """A stage that is slower than it was asked to be, with lost motion."""
    rng = np.random.default_rng([32, seed])
    lost, force = rng.uniform(0.5, 2.0), rng.uniform(0.1, 1.4)
    told, config = certified(
        *(ActuatorCalibration(), ActuatorOptions(travel=60e-6, velocity=10e-6)),
        *(f"run.normal_force={force}", f"sim.backlash={lost}", f"sim.seed={seed}"),
    )
    truths = {"velocity_ratio": scenario(config).speed_factor, "backlash_m": lost * 1e-6}
    return {f"actuator, {key}": (told[key].value, told[key].sd, v) for key, v in truths.items()}


def pattern(seed) -> Found:
    """Unequal pixels under a block that is moved."""
    unequal = np.random.default_rng([33, seed]).uniform(0.5, 2)
    told, _ = certified(
        *(PatternCalibration(), PatternOptions(pictures=40)),
        *(f"sim.unequal_pixels={unequal}", f"sim.seed={seed}"),
    )
    found = told["unequal_percent"]
    return {"unequal pixels": (found.value, found.sd, unequal)}
