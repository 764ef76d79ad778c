"""A recorded experiment behind the device protocols, alone and mixed with simulated devices."""

import time
from itertools import pairwise

import numpy as np
import pytest
import whole_runs
from contracts import ForceSourceContract
from driver_runs import ClockedCameraContract, pass_time, started
from short_run import SMALL

from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from drivers import recorded as stored
from drivers.bench import make_bench
from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, OutOfLimits
from drivers.protocols import Frame, LostFrame, LostSamples, TriggerTrain
from drivers.recorded import StoredActuator, StoredCamera, StoredForces
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings


class Tape:
    """A recording made up: 900 samples with a gap, nine frames of which one was lost, a stage that
    goes 1 mm and stands.
    """

    name = "tape"
    pace = None
    sample_rate_hz = 1000.0
    divisor = 100
    shape = (6, 8)
    dtype = np.dtype(np.uint8)
    position_samples = np.array([0, 200, 400, 900])
    positions_m = np.array([1e-3, 1e-3, 2e-3, 2e-3])

    def __init__(self, gap=(500, 530)):
        self.volts = np.arange(1800.0).reshape(900, 2)
        self.volts[gap[0] : gap[1]] = np.nan

    def image(self, index):
        return (
            None
            if index >= 9
            else "it was lost"
            if index == 5
            else np.full(self.shape, index, np.uint8)
        )


@pytest.fixture
def clock():
    return SampleClock(1000.0)


class TestStoredForces(ForceSourceContract):
    @pytest.fixture
    def forces(self, clock):
        return StoredForces(ForceSettings(), clock, Tape(gap=(0, 0)))


class TestStoredCamera(ClockedCameraContract):
    @pytest.fixture
    def camera(self, clock):
        return StoredCamera(CameraSettings(), clock, Tape())


def test_a_stored_stage_goes_where_it_went_once_it_is_told(clock):
    stage = StoredActuator(ActuatorSettings(), clock, Tape())
    with pytest.raises(DeviceFault, match="closed"):
        stage.position_m()
    stage.open()
    clock.start()
    assert (stage.position_m(), stage.is_moving()) == (1e-3, False)
    stage.move_to(2e-3)
    clock.advance(300)
    assert stage.is_moving()
    assert stage.position_m() == pytest.approx(1.5e-3)
    clock.advance(400)
    assert (stage.position_m(), stage.is_moving()) == (2e-3, False)
    with pytest.raises(DeviceFault, match="recording"):
        stage.home()
    with pytest.raises(OutOfLimits):
        stage.set_velocity(float("nan"))


def test_a_recorded_motion_that_goes_beyond_what_is_asked_is_refused_before_it_begins(clock):
    stage = StoredActuator(ActuatorSettings(), clock, Tape())
    stage.open()
    with pytest.raises(
        OutOfLimits,
        match=r"stage of tape: a move of 500\.0 um was requested, the .* goes 1000\.0 um; set run",
    ):
        stage.move_to(1.5e-3)
    assert not stage.is_moving()
    there_and_back = Tape()
    there_and_back.position_samples = np.arange(0, 900)
    there_and_back.positions_m = 1e-3 + 1e-6 * np.concatenate(
        [np.arange(300.0), np.arange(300.0, -300.0, -1.0)]
    )
    stage = StoredActuator(ActuatorSettings(), clock, there_and_back)
    stage.open()
    clock.start()
    stage.move_to(1.3e-3)
    clock.advance(300)
    with pytest.raises(OutOfLimits, match=r"a move of 200\.0 um was .*, the .* goes 599\.0 um"):
        stage.move_to(1.1e-3)
    stage.move_to(0.7e-3)


@pytest.mark.parametrize(
    "turns_um", [(0, 10, 20), (0, 20, 24), (0, 10, 5), (0, 10, 9, 12), (0, -10, -20, 0)]
)
@pytest.mark.parametrize("rest", [0, 20, 40])
def test_a_recorded_stage_arrives_at_the_end_of_each_leg(clock, turns_um, rest):
    """It moved until the end of its last leg, or was refused a move that another one followed."""
    tape, places, rests = Tape(), 1e-3 + 1e-6 * np.array(turns_um), rest / 20  # in s, at 1 um/s
    at_s, um = [0.0], [0.0]
    for a, b in pairwise(turns_um):
        at_s += [at_s[-1] + rests, at_s[-1] + rests + abs(b - a)]
        um += [a, b]
    tape.position_samples = np.arange(0, int(at_s[-1] * 1000) + 2000, 50)
    tape.positions_m = 1e-3 + 1e-6 * np.interp(tape.position_samples / 1000, at_s, um)
    stage = StoredActuator(ActuatorSettings(), clock, tape)
    stage.open()
    clock.start()
    turns = np.sign(np.diff(turns_um))
    for leg, place in enumerate(places[1:]):
        begins, ends = round(1000 * at_s[2 * leg + 1]), round(1000 * at_s[2 * leg + 2])
        clock.advance(begins)
        if rest == 0 and any(turns[leg + 1 : leg + 2] == turns[leg]):
            with pytest.raises(OutOfLimits, match="the recorded stage goes"):
                stage.move_to(place)
            return
        stage.move_to(place)
        clock.advance(ends - 200)
        assert stage.is_moving()
        clock.advance(ends)
        assert not stage.is_moving()
        assert stage.position_m() == pytest.approx(place, abs=0.1e-6)


def test_a_gap_stays_a_gap_and_the_end_is_told(clock):
    forces = started(StoredForces(ForceSettings(), clock, Tape(gap=(510, 530))))
    blocks = []
    while not blocks or blocks[-1].end < 900:
        blocks.append(forces.read(1.0))
    with pytest.raises(DeviceFault, match="the recording ends before"):
        forces.read(1.0)
    ends = [block.end for block in blocks]
    assert [block.first for block in blocks[1:]] == ends[:-1]
    assert [(b.first, b.count) for b in blocks if isinstance(b, LostSamples)] == [(510, 20)]
    assert ends[-1] == 900


def test_a_lost_image_stays_lost_and_beyond_the_last_there_is_none(clock):
    camera = started(StoredCamera(CameraSettings(), clock, Tape()))
    pass_time(clock, 2000)
    answers = [camera.read(1.0) for _ in range(11)]
    assert [isinstance(a, Frame) for a in answers] == [True] * 5 + [False] + [True] * 3 + [
        False
    ] * 2
    assert isinstance(answers[5], LostFrame)
    assert "it was lost" in answers[5].reason
    with pytest.raises(OutOfLimits, match=r"set camera\.divisor"):
        camera.start(TriggerTrain(0, 99))


def test_recorded_forces_refuse_further_channels_before_they_start(clock):
    """The run began, and ended at its first block, which was lost."""
    forces = StoredForces(ForceSettings(auxiliary=("lvdt ai2 mm",)), clock, Tape())
    with pytest.raises(OutOfLimits, match=r"1 further channels; set forces\.auxiliary = \[\]"):
        forces.open()


def test_without_a_recording_they_say_what_is_missing():
    with pytest.raises(DeviceNotFound, match=r"set replay\.session"):
        make_bench(ForceSettings(source="replay"), CameraSettings(), ActuatorSettings())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "first.h5"
    return path, whole_runs.recorded(path, *SMALL)


def again(path, recorded, *sources, sabotage=lambda run: None):
    """The run of a bench that plays the recorded session in the sources named, as fast as it is
    analysed.
    """
    overrides = [
        *SMALL,
        f"replay.session={recorded[0]}",
        *(f"{source}.source=replay" for source in sources),
    ]
    run = live.make_run(config.load(None, overrides), path, pace=None)
    sabotage(run)
    run.start()
    outcome = run.wait(400)
    assert outcome.counts.frames_skipped == 0
    return outcome


@pytest.mark.slow
def test_a_bench_of_recordings_repeats_the_experiment(recorded, tmp_path):
    outcome = again(tmp_path / "all.h5", recorded, "forces", "camera", "actuator")
    assert outcome.state == "done", outcome.reason
    with SessionReader(recorded[0]) as first, SessionReader(tmp_path / "all.h5") as second:
        a, b = first.forces().volts, second.forces().volts
        n = min(len(a), len(b))
        assert n > 0.98 * len(a)
        np.testing.assert_array_equal(a[:n], b[:n])
        assert {i: image.tobytes() for i, _, image in second.frames()}.items() <= {
            i: image.tobytes() for i, _, image in first.frames()
        }.items()
    assert outcome.summary.mu_s == pytest.approx(recorded[1].summary.mu_s, rel=0.01)


@pytest.mark.slow
def test_a_recording_does_not_run_ahead_of_an_analysis_however_slow(
    recorded, tmp_path, monkeypatch
):
    monkeypatch.setattr("app.acquisition.receiver.PATIENCE_S", 0.5)
    ahead = []

    def slow_down(run):
        step = run._analysis.pipeline.step

        def slowly(index, sample, *rest):
            time.sleep(1.0 if index in (60, 61) else 0)
            ahead.append(run._history.end - sample)
            return step(index, sample, *rest)

        run._analysis.pipeline.step = slowly

    outcome = again(
        tmp_path / "slow.h5", recorded, "forces", "camera", "actuator", sabotage=slow_down
    )
    assert (outcome.state, outcome.counts.frames_lost) == ("done", 0), outcome.reason
    assert max(ahead) < 20 * 125


def test_recorded_pictures_and_forces_with_a_simulated_stage(recorded, tmp_path):
    outcome = again(tmp_path / "mixed.h5", recorded, "forces", "camera")
    assert outcome.state == "done", outcome.reason
    assert outcome.counts.frames_lost == outcome.counts.samples_lost == 0
    assert outcome.summary.mu_s == pytest.approx(recorded[1].summary.mu_s, rel=0.01)


@pytest.mark.slow
def test_recorded_forces_lead_the_simulated_world(recorded, tmp_path):
    """The stage and the camera are simulated, the clock is the recording's: the world shows its
    contact at the samples that are played.
    """
    outcome = again(tmp_path / "led.h5", recorded, "forces")
    assert outcome.state == "done", outcome.reason
    assert outcome.counts.frames_lost == 0
    assert outcome.summary.onset_time_s == pytest.approx(recorded[1].summary.onset_time_s, abs=0.3)


def test_a_recorded_stage_moves_the_simulated_contact(recorded, tmp_path):
    outcome = again(tmp_path / "followed.h5", recorded, "actuator")
    assert outcome.state == "done", outcome.reason
    assert outcome.summary.mu_s == pytest.approx(recorded[1].summary.mu_s, rel=0.02)


def test_a_session_that_is_not_there_is_one_sentence(tmp_path):
    from app.system.errors import UserError

    with pytest.raises((UserError, DeviceError), match="nothing"):
        live.make_run(
            config.load(
                None, [f"replay.session={tmp_path / 'nothing.h5'}", "camera.source=replay"]
            ),
            tmp_path / "x.h5",
            pace=1.0,
        )


def test_what_a_block_costs_does_not_grow_with_what_is_left(clock, monkeypatch):
    """An hour at full speed: gaps are looked for once, not in all that is left at each block."""
    looked, isnan = [], np.isnan

    def noted(values):
        looked.append(values.size)
        return isnan(values)

    monkeypatch.setattr(stored.np, "isnan", noted)
    tape = Tape(gap=(0, 0))
    tape.volts = np.ones((200_000, 2))
    tape.volts[1000:1020] = tape.volts[150_010:160_000] = np.nan
    forces = started(StoredForces(ForceSettings(), clock, tape))
    blocks, end = [], 0
    while end < 200_000:
        block = forces.read(1.0)
        assert block.first == end
        end = block.end
        blocks.append(block)
    assert sum(looked) <= 3 * tape.volts.size
    lost = [(b.first, b.count) for b in blocks if isinstance(b, LostSamples)]
    assert lost == [(1000, 20), (150_010, 9990)]
    assert all(len(b.volts) <= 50 for b in blocks if not isinstance(b, LostSamples))
    assert (
        sum(len(b.volts) for b in blocks if not isinstance(b, LostSamples)) == 200_000 - 20 - 9990
    )
    with pytest.raises(DeviceFault, match="ends before sample 200000"):
        forces.read(1.0)
