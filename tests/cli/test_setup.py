"""`slipscope setup`: from what is connected and what its owner says to the settings of a bench."""

from pathlib import Path

import pytest

from app.bench_checks import bench_setup
from app.bench_checks.bench_setup import choices
from app.bench_checks.doctor import Checked, problem
from app.settings.config import load

HELD = {
    "drivers.daq.ni_daq": [Checked("Dev3", "NI PCI-6251, serial number 1A2B")],
    "drivers.cameras.pylon_camera": [problem("none", "the package pypylon is not installed")],
    "drivers.stages.newport_stage": [Checked("COM4", "USB serial port"), Checked("COM7", "n/a")],
}


def test_what_is_connected_is_offered_before_the_simulated_device():
    found = choices(HELD.__getitem__)
    assert [one.about for one in found["forces"]] == [
        "Dev3: NI PCI-6251, serial number 1A2B (nidaqmx)",
        "simulated",
    ]
    assert [one.about for one in found["camera"]] == ["simulated"]
    assert [one.about for one in found["actuator"]] == [
        "COM4: USB serial port (smc100)",
        "COM4: USB serial port (conex-cc)",
        "COM7: n/a (smc100)",
        "COM7: n/a (conex-cc)",
        "simulated",
    ]
    config = load(None, [*found["forces"][0].settings, *found["actuator"][3].settings])
    assert config.sources == ("nidaqmx", "sim", "conex-cc")
    assert (config.forces.device, config.actuator.port) == ("Dev3", "COM7")


@pytest.fixture
def connected(monkeypatch):
    def hold(held):
        monkeypatch.setattr(bench_setup, "choices", lambda: choices(held.__getitem__))

    return hold


NOTHING = {finder: [Checked("none", "no device was found")] for finder in HELD}


def test_without_devices_and_questions_the_bench_is_simulated_and_works(slipscope, connected):
    connected(NOTHING)
    done = slipscope("setup", "-o", "bench.toml", "--yes")
    assert done.exit_code == 0, done.output
    assert load_here() == load()
    assert "ok     picture" in done.stdout
    again = slipscope("setup", "-o", "bench.toml", "--yes")
    assert again.exit_code == 2
    assert "a settings file of that name exists" in again.output


def load_here():
    return load(Path("bench.toml"))


def test_answers_go_to_the_file_and_what_cannot_be_is_asked_again(slipscope, connected, tmp_path):
    connected(HELD)
    forces = ["", "rse", "", "", "", "", "", "", "", "[-1, 1]"]
    sample = ["soft", "-3", "2.9", "", "", "", "15", "block 7", "Ana", "0.4", "1.2", "0.9"]
    answers = ["7", "1", "1", "", *forces, *sample]
    done = slipscope("setup", "-o", "bench.toml", input="\n".join([*answers, ""]))
    assert done.exit_code == 1, done.output  # there is no board
    assert "'7' is none of them; give a number from 1 to 2" in done.output
    assert done.output.count("sample.young_modulus must be a number more than 0") == 2
    assert "run.normal_force = 0.5 N is not below limits.normal_force = 0.4 N" in done.output
    config = load_here()
    assert config.sources == ("nidaqmx", "sim", "sim")  # a port is never taken unasked
    assert (config.forces.wiring, config.forces.sign) == ("rse", (-1, 1))
    assert (config.sample.young_modulus, config.sample.thickness) == (2.9e6, 0.015)
    assert (config.about.sample, config.about.operator) == ("block 7", "Ana")
    assert (config.limits.normal_force, config.limits.shear_force) == (1.2, 0.9)
    text = (tmp_path / "bench.toml").read_text(encoding="utf-8")
    assert "# Young's modulus E of the block [MPa] (more than 0" in text
    assert "FAILS  forces" in done.stdout


def test_without_answers_nothing_is_written(slipscope, connected, tmp_path):
    connected(NOTHING)
    done = slipscope("setup", "-o", "bench.toml", input="1\n1\n")
    assert done.exit_code == 2
    assert "no answer to 'Which actuator', so that bench.toml was not written" in done.output
    assert not list(tmp_path.iterdir())
