"""Weights on the sensors of a simulated bench whose constants are not those of its settings, and
tables of loads and displacements: the certificate has what is true.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from cli.conftest import call
from hidden_benches import SMALL, hung
from seeds import errors, holds, pulls, seen_by
from whole_runs import ran

from app.calibrations.calibration import calibration_run
from app.calibrations.certifying import CalibrationRefused, evaluated
from app.calibrations.weights import ForceCalibration, WeightOptions
from app.settings.config import load
from app.settings.hung_weights import asked_weight, asking_for, hung_weights
from app.settings.protocol_steps import Approach, Ask, Hold
from app.system.errors import UserError

HIDDEN = (
    'sim.errors=["forces.stiffness_normal 1.03", "forces.sensitivity_shear 0.98",'
    ' "forces.shear_from_normal 0.01", "forces.normal_from_shear -0.003"]'
)
SHORT = WeightOptions(normal="0.3 0.6", shear="0.5 1", cycles=2, hold=0.5)
TABLE = "axis,load_N,displacement_um,normal_V,shear_V\n"
UP_AND_DOWN = [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    (config,) = ForceCalibration().plan(load(None, [*SMALL, HIDDEN]), SHORT)
    return ran(config, tmp_path_factory.mktemp("weights") / "forces-1.h5")


def table(rows):
    return TABLE + "".join(",".join(map(str, row)) + "\n" for row in rows)


@pytest.mark.slow
def test_weights_on_a_simulated_bench_tell_its_hidden_constants(session, tmp_path):
    found = evaluated(ForceCalibration(), [session], SHORT)
    settings = found.certificate.settings
    assert settings["forces.stiffness_normal"] == pytest.approx(1.03 * 689, rel=3e-4)
    assert settings["forces.stiffness_shear"] == pytest.approx(0.98 * 9579, rel=3e-4)
    assert settings["forces.sensitivity_normal"] == 300  # what weights alone do not tell
    np.testing.assert_allclose(
        settings["forces.coupling"], [[1, 0.001], [0.018, 1]], rtol=0, atol=2e-4
    )
    assert settings["forces.stiffness_uncertainty"] == pytest.approx([0.71, 9.39], rel=0.05)
    assert any("weights give newtons per volt only" in one for one in found.result.remarks)
    found.write(tmp_path / "forces.zip", overwrite=False)
    certified = f'calibration.certificates=["{(tmp_path / "forces.zip").as_posix()}"]'
    config = load(None, [*SMALL, certified])
    assert config.forces.stiffness_normal == pytest.approx(settings["forces.stiffness_normal"])
    assert config.uncertainty.coupling < 2e-4


@pytest.mark.slow
def test_simulated_benches_are_within_the_stated_uncertainties():
    found = seen_by(hung, 60)
    for name, one in found.items():
        if name.startswith("N/V"):
            assert np.abs(errors(one)).max() < 5e-3
        else:
            assert np.abs(one[0] - one[2]).max() < 1e-3
    holds(np.concatenate([pulls(one) for one in found.values()]))


def test_weights_and_displacements_of_tables_tell_the_stiffness(tmp_path):
    """Newtons and micrometres per volt that are written down here, from two files, whose
    readings have so many digits that their rounding tells nothing.
    """
    weights, screw = tmp_path / "weights.csv", tmp_path / "screw.csv"
    rows = [
        *(("normal", F, "", 0.1234567 + 5 * F, 0.2345678 + 0.04 * F) for F in UP_AND_DOWN),
        *(("shear", F, "", 0.1234567 - 0.02 * F, 0.2345678 + 4 * F) for F in UP_AND_DOWN),
    ]
    weights.write_text(table(rows))
    rows = [
        *(("normal", "", 1000 * x, 0.1234567 + 2.5 * x, 0) for x in UP_AND_DOWN),
        *(("shear", "", 100 * x, 0, 0.2345678 + 4 * x) for x in UP_AND_DOWN),
    ]
    screw.write_text(table(rows))
    found = evaluated(ForceCalibration(), [weights, screw], WeightOptions()).certificate
    # 0.2 N/V and 400 um/V; 0.25 N/V and 25 um/V
    assert found.settings["forces.stiffness_normal"] == pytest.approx(500)
    assert found.settings["forces.stiffness_shear"] == pytest.approx(10000)
    assert found.settings["forces.sensitivity_normal"] == pytest.approx(400)
    assert found.settings["forces.sensitivity_shear"] == pytest.approx(25)
    assert found.settings["forces.sign"] == [1, 1]
    np.testing.assert_allclose(found.settings["forces.coupling"], [[1, -0.004], [0.01, 1]])
    # 0.1 % of the weights and 0.1 % of the displacements
    assert found.settings["forces.stiffness_uncertainty"] == pytest.approx(
        [500 * np.sqrt(2) * 1e-3, 10000 * np.sqrt(2) * 1e-3]
    )


def test_a_certificate_is_evaluated_again_with_its_own_options_or_those_given(tmp_path):
    """Weights alone, with the sensitivity of one sensor by hand."""
    rows = [("normal", load, "", 0.5 * load, 0.0) for load in UP_AND_DOWN]
    path, certificate = tmp_path / "weights.csv", tmp_path / "forces.zip"
    path.write_text(table(rows), encoding="utf-8")
    given = WeightOptions(sensitivity_normal=45e-6, load_uncertainty=0.005)
    found = evaluated(ForceCalibration(), [path], given)
    found.write(certificate, overwrite=False)
    again = evaluated(ForceCalibration(), [certificate], WeightOptions())
    assert again.certificate.options == found.certificate.options
    assert again.certificate.settings == found.certificate.settings
    other = evaluated(ForceCalibration(), [certificate], WeightOptions(sensitivity_normal=90e-6))
    stiffness = [one.certificate.settings["forces.stiffness_normal"] for one in (found, other)]
    assert stiffness[1] == pytest.approx(stiffness[0] / 2)
    assert other.certificate.options["load_uncertainty"] == 0.5
    # by name, also where they are as by default
    words = ("calibrate", "forces", str(certificate), "-o", str(tmp_path / "again.zip"), "--json")
    asked = call(*words, "--load-uncertainty", "0.1")
    assert WeightOptions().load_uncertainty == pytest.approx(0.001)
    kept = json.loads(asked.stdout)["options"]
    assert (kept["load_uncertainty"], kept["sensitivity_normal"]) == (0.1, pytest.approx(45))


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ([("normal", F, "", 5 * F, 0) for F in UP_AND_DOWN], "--sensitivity-normal"),
        ([("normal", F, "", 5 * F + F * F, 0) for F in UP_AND_DOWN], "normal sensor: .*bend"),
        ([("normal", "", 100 * x, 5 * x, 0) for x in UP_AND_DOWN], "no load"),
        ([("normal", F, "", 5 * F, 0) for F in UP_AND_DOWN[:5]], "8 or more"),
    ],
)
def test_a_table_that_tells_no_stiffness_is_refused(tmp_path, rows, word):
    path = tmp_path / "weights.csv"
    path.write_text(table(rows))
    with pytest.raises(CalibrationRefused, match=word):
        evaluated(ForceCalibration(), [path], WeightOptions())


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (TABLE + "vertical,1,,2,3\n", "normal or shear, found 'vertical'"),
        (TABLE + "normal,1,1,2,3\n", "either a load or a displacement"),
        ("load_N,normal_V\n1,2\n", "no normal_V, shear_V or axis"),
    ],
)
def test_a_table_without_what_is_needed_is_refused(tmp_path, text, word):
    path = tmp_path / "weights.csv"
    path.write_text(text)
    with pytest.raises(UserError, match=word):
        evaluated(ForceCalibration(), [path], WeightOptions())


def one_axis(axis, slope):
    """Readings of weights on one axis, and what the settings of their session say."""
    load = np.array(UP_AND_DOWN, float)
    volts = np.zeros((len(load), 2))
    volts[:, axis] = slope * load
    rng = np.random.default_rng(axis)
    normal, shear = (volts + rng.normal(0, 1e-4, volts.shape)).T
    return {
        "load": load, "displacement": load * np.nan, "axis": np.full(load.shape, float(axis)),
        "normal_v": normal, "shear_v": shear, "time": np.arange(float(len(load))),
    }  # fmt: skip


TOLD = {
    "range": (10.0, 10.0), "sign": (1, -1), "sensitivity": (3e-4, 2.2e-5),
    "stiffness": (689.0, 9579.0), "stiffness_sd": (5.0, 25.0), "sensitivity_sd": 0.003,
}  # fmt: skip


@pytest.mark.parametrize(("axis", "slope"), [(0, 4.8), (1, -4.7)])
def test_one_loaded_sensor_has_its_uncertainty_and_the_other_what_the_session_says(axis, slope):
    told = {name: np.array(value) for name, value in TOLD.items()}
    found = ForceCalibration().fit(one_axis(axis, slope) | told, WeightOptions())
    settings, k = found.settings, 1 / abs(slope) / TOLD["sensitivity"][axis]
    assert settings["forces.sign"] == [1, -1]
    assert settings["uncertainty.sensitivity"] == 0
    sds = settings["forces.stiffness_uncertainty"]
    assert sds[axis] == pytest.approx(1e-3 * k, rel=0.05)  # 0.1 % of the weights
    # that of the sensitivity, which is 0 now, is in that of the other stiffness
    other = np.hypot(TOLD["stiffness_sd"][1 - axis], 0.003 * TOLD["stiffness"][1 - axis])
    assert sds[1 - axis] == pytest.approx(other)
    assert f"forces.stiffness_{('normal', 'shear')[1 - axis]}" not in settings
    assert "forces.coupling" not in settings


def test_a_table_of_one_sensor_says_what_it_does_not_set_and_refuses_an_inverted_one():
    given = WeightOptions(sensitivity_normal=3e-4)
    found = ForceCalibration().fit(one_axis(0, 4.8), given)
    assert set(found.settings) == {"forces.stiffness_normal", "forces.sensitivity_normal"}
    assert any("forces.stiffness_uncertainty and" in one for one in found.remarks)
    with pytest.raises(ValueError, match=r"normal sensor: its voltage falls.*load that one too"):
        ForceCalibration().fit(one_axis(0, -4.8), given)


def test_a_step_says_which_weight_it_asks_for():
    assert asked_weight(asking_for(0.049, "normal")) == ("normal", 0.049)
    assert asked_weight(asking_for(0.0, "shear")) == ("shear", 0.0)
    assert asked_weight(Ask(question="is the lamp on?")) is None
    assert asked_weight(Hold(time=1.0)) is None
    with pytest.raises(UserError, match="growing weights"):
        WeightOptions(normal="2 1").weights("normal")


def test_a_simulated_operator_hangs_each_weight_half_way_through_its_question():
    steps = [
        replace(asking_for(0.5, "normal"), timeout=2.0), Hold(time=0.51),
        replace(asking_for(0.2, "shear"), timeout=1.0), Approach(),
        asking_for(0.1, "shear"),
    ]  # fmt: skip
    assert hung_weights(steps, 1000, 50) == ((1000, 0.5, 0.0), (3050, 0.5, 0.2))


def test_a_real_bench_waits_for_its_operator_and_a_run_without_weights_is_refused():
    (config,) = ForceCalibration().plan(load(None, [*SMALL, "forces.source=nidaqmx"]), SHORT)
    asked = [step for step in config.run.steps if isinstance(step, Ask)]
    assert {step.unanswered for step in asked} == {"fail"}
    assert config.camera.divisor == 5000  # hours of pictures that nobody needs
    assert [asked_weight(step)[1] for step in asked[:9]] == [0, 0.3, 0.6, 0.3, 0, 0.3, 0.6, 0.3, 0]
    with pytest.raises(UserError, match="--normal"):
        ForceCalibration().plan(load(None, SMALL), WeightOptions(normal="", shear=""))


def test_another_session_than_one_of_weights_is_refused(session, tmp_path):
    path = ran(calibration_run(load(None, SMALL), [Hold(time=0.5)]), tmp_path / "hold.h5")
    with pytest.raises(UserError, match="none of its steps asks for a weight"):
        evaluated(ForceCalibration(), [path], SHORT)
    with pytest.raises(UserError, match="others than those"):
        evaluated(ForceCalibration(), [session, *other_bench(tmp_path)], SHORT)


def other_bench(folder):
    options = WeightOptions(normal="0.5", shear="", cycles=1, hold=0.5)
    (config,) = ForceCalibration().plan(
        load(None, [*SMALL, "forces.sensitivity_normal=250"]), options
    )
    return [ran(config, folder / "other.h5")]
