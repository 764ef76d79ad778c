"""A bench whose constants are not those of its settings: what it measures before it is calibrated,
and after.
"""

import numpy as np
import pytest
from whole_runs import ran

from app.calibrations.certifying import evaluated
from app.calibrations.weights import ForceCalibration, WeightOptions
from app.evaluation.setup import sensor_chain
from app.settings.config import load
from slipscope import Session

SMALL = (
    *("camera.width=64", "camera.height=64", "dic.box=20", "recording.results=forces"),
    *("run.background_time=0", "run.shear_tolerance=0.1", "run.normal_force=0.3"),
    *(
        "run.velocity=100",
        "run.travel=150",
        "sim.law=cattaneo-mindlin",
        "sim.friction=0.8",
        "sim.pressure=hertz",
    ),
)
STIFFNESS_SHEAR, NORMAL, P_IN_Q = 9579 * 1.06, 689 * 0.985, 0.02  # of the bench as it is
WEIGHTS = WeightOptions(normal="0.3 0.6", shear="0.3 0.6", cycles=2, hold=0.5)


def bench(*settings):
    """The settings of a bench with those constants, whatever the settings say of them."""
    said = load(None, [*SMALL, *settings]).forces
    errors = (
        f"forces.stiffness_shear {STIFFNESS_SHEAR / said.stiffness_shear:.9f}",
        f"forces.sensitivity_normal {NORMAL / said.stiffness_normal:.9f}",
        f"forces.shear_from_normal {P_IN_Q - said.coupling[1][0]:.9f}",
    )
    return load(None, [*SMALL, *settings, f"sim.errors={list(errors)}".replace("'", '"')])


def friction(config, path):
    """Q/P at the end of the drive, where the contact slides, and its uncertainty by the
    calibration.
    """
    with Session(ran(config, path)) as session:
        _, normal, shear = session.forces
    end = slice(len(normal) - 500, None)
    P, Q = normal[end].mean(), shear[end].mean()
    sd = np.hypot(*sensor_chain(config).relative_uncertainty()) * Q / P
    cross = config.uncertainty.coupling
    return P, Q / P, np.hypot(sd, cross)


@pytest.mark.slow
def test_a_calibration_brings_forces_within_their_stated_uncertainty(tmp_path):
    before, (plan,) = bench(), ForceCalibration().plan(bench(), WEIGHTS)
    found = evaluated(ForceCalibration(), [ran(plan, tmp_path / "weights.h5")], WEIGHTS)
    found.write(tmp_path / "forces.zip", overwrite=False)
    after = bench(f'calibration.certificates=["{(tmp_path / "forces.zip").as_posix()}"]')

    _, mu, sd = friction(before, tmp_path / "before.h5")
    assert abs(mu - 0.8) > 2.5 * sd  # what nobody has calibrated is wrong beyond what is stated
    _, mu, sd = friction(after, tmp_path / "after.h5")
    assert sd < 0.0015
    assert mu == pytest.approx(0.8, abs=2 * sd)
