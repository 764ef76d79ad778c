"""Further analog channels: sampled with the forces, recorded with name and unit, read back."""

import csv
import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
import short_run
from short_run import SMALL
from whole_runs import done, ended, recorded

from app.cli.inspect import info
from app.files.exporting import export
from app.records.analog_channels import Channels
from app.records.record_types import Gap, Samples
from app.replay.reanalysis import Reanalysis
from app.runs import live
from app.session.recorder import SessionRecorder
from app.session.repair import repair
from app.settings import config
from app.settings.config import ConfigError, load
from drivers.clock import SampleClock
from drivers.emulators.ni import EmulatedNiForces
from drivers.protocols import TriggerTrain
from drivers.sim.devices import SimForces
from drivers.sim.world import World
from slipscope import Session

TWO = ("temperature ai2 degC 100 -50 5", "lvdt ai5 mm")
SETTING = f"forces.auxiliary={json.dumps(TWO)}"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("auxiliary") / "run.h5"
    recorded(path, *short_run.SHORT, "run.travel=4", SETTING)
    return path


def expected_volts(n, rate=1000):
    """What the simulated channels are made of."""
    wander = 0.1 * np.sin(2 * np.pi * np.arange(n) / rate / 60)
    return np.column_stack([1 + wander, 1.5 + wander])


def test_the_values_are_recorded_in_their_units(session):
    with Session(session) as s:
        assert {name: channel.unit for name, channel in s.auxiliary.items()} == {
            "temperature": "degC",
            "lvdt": "mm",
        }
        n = len(s.forces.time_s)
        volts = expected_volts(n)
        np.testing.assert_allclose(s.auxiliary["temperature"].values, 100 * volts[:, 0] - 50)
        np.testing.assert_allclose(s.auxiliary["lvdt"].values, volts[:, 1])
    with h5py.File(session) as file:
        assert file["/entry/auxiliary/value"].shape == (n, 2)
        assert file.attrs["slipscope_format"] == 9


def test_they_are_exported_and_shown(session, tmp_path, capsys):
    export(session, tmp_path / "forces.csv", what="forces")
    lines = (tmp_path / "forces.csv").read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(lines))
    assert float(rows[0]["temperature_degC"]) == 50
    assert float(rows[0]["lvdt_mm"]) == 1.5
    export(session, tmp_path / "arrays.npz")
    with np.load(tmp_path / "arrays.npz") as arrays:
        assert arrays["forces_temperature_degC"].shape == (len(rows),)
    info(session, as_json=False, verify=True)
    said = capsys.readouterr().out
    assert "temperature (degC), lvdt (mm)" in said
    assert "read back as they were written" in said
    info(session, as_json=True, verify=False)
    assert json.loads(capsys.readouterr().out)["auxiliary"] == {
        "temperature": "degC",
        "lvdt": "mm",
    }


def test_a_further_analysis_leaves_them_where_they_are(session):
    done(Reanalysis(session, session.with_name("again.h5"), pace=None, overrides=["dic.box=24"]))
    with Session(session.with_name("again.h5")) as s:
        assert s.auxiliary == {}


def test_a_cut_short_session_has_them_back(tmp_path):
    header = live.header_of(load(None, [*SMALL, SETTING]), {})
    writer = SessionRecorder.create(tmp_path / "cut.h5", header)
    values = np.arange(40.0).reshape(20, 2)
    plain = np.zeros((20, 2))
    writer.append(Samples(0, plain, plain, values))
    writer.append(Gap(20, 5, "lost"))
    writer.append(Samples(25, plain, plain, -values))
    for file in writer._files:
        file.close()  # as a kill leaves it
    repaired = repair(tmp_path / "cut.h5", tmp_path / "whole.h5")
    assert repaired.source == "journal"
    with Session(tmp_path / "whole.h5") as s:
        held = s.auxiliary["lvdt"].values
    np.testing.assert_array_equal(held, [*values[:, 1], *[np.nan] * 5, *-values[:, 1]])


def test_what_was_altered_is_found(session, tmp_path):
    copy = tmp_path / "copy.h5"
    copy.write_bytes(session.read_bytes())
    with h5py.File(copy, "r+") as file:
        place = file["/entry/auxiliary/value"].id.get_chunk_info(0).byte_offset
    content = bytearray(copy.read_bytes())
    content[place + 100] ^= 1
    copy.write_bytes(content)
    assert info(copy, as_json=True, verify=True) == 1


def test_the_emulated_board_samples_them_like_the_simulated_one():
    settings = load(None, [*SMALL, SETTING])
    here = live.scenario(settings)
    world = World(here, None)
    real = EmulatedNiForces(here.forces, SampleClock(1000.0), world)
    simulated = SimForces(World(here, None))
    for source in (real, simulated):
        source.open()
        source.start(TriggerTrain(0, 125))
    try:
        assert "temperature on ai2, lvdt on ai5" in real.describe()
        for _ in range(5):
            ours, theirs = real.read(5.0), simulated.read(5.0)
            np.testing.assert_array_equal(ours.volts, theirs.volts)
            np.testing.assert_array_equal(ours.auxiliary, theirs.auxiliary)
            assert ours.auxiliary.shape == (50, 2)
    finally:
        real.close()


def test_a_source_that_has_none_is_refused_at_the_first_block(tmp_path, monkeypatch):
    read = SimForces.read
    monkeypatch.setattr(SimForces, "read", lambda *asked: replace(read(*asked), auxiliary=None))
    settings = load(None, [*short_run.SHORT, SETTING])
    outcome = ended(live.make_run(settings, tmp_path / "run.h5", pace=None))
    assert outcome.state == "failed"
    assert "asks for 2 further channels, it delivers 0" in outcome.reason


def test_a_recording_is_refused_before_the_first_block(session, tmp_path):
    played = ("forces.source=replay", f"replay.session={session.as_posix()}")
    settings = load(None, [*short_run.SHORT, SETTING, *played])
    outcome = ended(live.make_run(settings, tmp_path / "run.h5", pace=None))
    assert (outcome.state, outcome.counts.samples) == ("failed", 0)
    assert "asks for 2 further channels; set forces.auxiliary = []" in outcome.reason


@pytest.mark.parametrize(
    "text",
    [
        "temperature",
        "temperature ai2",
        "temp-erature ai2 degC",
        "temperature ai2 degC x",
        "temperature ai2 degC 0",
        "temperature ai2 degC 1 0 0",
        "temperature ai2 degC nan",
        "temperature ai2 degC 1 0 5 6",
        "temperature ai0 degC",
        "lvdt ai3 mm",
    ],
)
def test_a_channel_that_can_not_be_read_is_refused(text):
    with pytest.raises(ConfigError, match=r"forces\.auxiliary: '"):
        config.load(None, [f"forces.auxiliary={json.dumps(['lvdt ai2 mm', text])}"])


def test_labels_are_safe_names():
    assert Channels(("a/../b", "T"), ("degC", "um/s")).labels == ["a____b_degC", "T_um_s"]
