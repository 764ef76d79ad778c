"""The simulated devices: the contracts, one world seen by all three, the pace, and the bench that
holds them.
"""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from contracts import TRAIN, ActuatorContract, CameraContract, ForceSourceContract
from driver_runs import end_of_a_waiting_read
from worlds import TINY, scenario

import drivers.bench
from drivers.bench import Bench, FollowedActuator, make_bench
from drivers.contract import BrokenContract
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import TriggerTrain
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sim.devices import SimActuator, SimCamera, SimForces
from drivers.sim.world import World
from drivers.sources import DRIVERS, UnknownDevice

FREE = scenario(**TINY, press_time=3600.0)
QUICK = scenario(**TINY, press_time=0.1, press_samples=100)


class Numbered:
    """Draws the frame's number and the contact's state instead of an interface."""

    def __init__(self):
        self.states = []

    def image(self, state, frame_index):
        self.states.append(state)
        return np.full((64, 64), frame_index, np.uint8)


@pytest.fixture
def world():
    return World(FREE, pace=None)


class TestSimForces(ForceSourceContract):
    @pytest.fixture
    def forces(self, world):
        return SimForces(world)


@pytest.mark.parametrize("waiting", [7.0, -1, None])
def test_a_backlog_that_ends_a_run_breaks_the_contract(world, monkeypatch, waiting):
    """One that is no whole number passed `slipscope check-driver`."""
    monkeypatch.setattr(SimForces, "backlog", lambda forces: waiting)
    with pytest.raises(BrokenContract, match=f"the backlog is {waiting}$"):
        TestSimForces().test_blocks_follow_each_other_from_sample_0_without_gap(SimForces(world))


class TestSimCamera(CameraContract):
    @pytest.fixture
    def camera(self, world):
        return SimCamera(world, Numbered())

    @pytest.fixture
    def run_until(self, world):
        def run(sample):
            if world.phase == "idle":
                world.start(TRAIN)
            world.advance(sample - world.now)

        return run

    @pytest.fixture
    def end_clock(self, world):
        return world.stop


class TestSimActuator(ActuatorContract):
    @pytest.fixture
    def actuator(self, world):
        return SimActuator(world)

    @pytest.fixture
    def pass_time(self, world):
        return lambda seconds: world.advance(round(seconds * 1000))


def fake_bench(scenario, pace):
    world = World(scenario, pace)
    return Bench(SimForces(world), SimCamera(world, Numbered()), SimActuator(world), world)


def drive(scenario, pace, blocks=60, divisor=100):
    """A short run with two threads, as the program has them: all volts, all frames, all states that
    were drawn.
    """
    bench = fake_bench(scenario, pace)
    frames, volts = [], []
    train = TriggerTrain(0, divisor)

    def receive():
        while True:
            try:
                frames.append(bench.camera.read(10.0))
            except DeviceTimeout:
                return

    with bench:
        bench.camera.start(train)
        bench.forces.start(train)
        camera = threading.Thread(target=receive)
        camera.start()
        for number in range(blocks):
            if number == 10:
                bench.actuator.set_velocity(100e-6)
                bench.actuator.move_to(bench.actuator.position_m() + 150e-6)
            volts.append(bench.forces.read(10.0).volts)
        bench.forces.stop()
        camera.join()
    return np.concatenate(volts), frames, bench.camera._renderer.states


def test_the_pace_changes_no_bit():
    paced, free = drive(QUICK, 50.0), drive(QUICK, None)
    np.testing.assert_array_equal(paced[0], free[0])
    assert (
        [(f.index, f.sample) for f in paced[1]]
        == [(f.index, f.sample) for f in free[1]]
        == [(i, 100 * i) for i in range(30)]
    )
    assert paced[2] == free[2]
    assert paced[2][-1].shear_force_n > 0.4


def test_a_frame_shows_the_middle_of_its_exposure():
    _, frames, states = drive(QUICK, None)
    assert [s.sample for s in states] == [f.sample + QUICK.exposure_samples // 2 for f in frames]


def test_a_paced_read_waits_for_the_wall_clock_and_takes_nothing_when_it_gives_up():
    bench = fake_bench(FREE, 1e-4)
    with bench:
        bench.forces.start(TRAIN)
        with pytest.raises(DeviceTimeout, match="pace"):
            bench.forces.read(0.01)
        assert bench.world.now == 0


def test_a_free_world_waits_for_its_camera_with_four_unread_frames():
    bench = fake_bench(FREE, None)
    with bench:
        bench.camera.start(TRAIN)
        bench.forces.start(TRAIN)
        while bench.world.now + FREE.forces.block < TRAIN.sample(4) + FREE.exposure_samples:
            bench.forces.read(1.0)
        with pytest.raises(DeviceTimeout, match="unread"):
            bench.forces.read(0.01)
        bench.camera.read(1.0)
        for _ in range(TRAIN.divisor // FREE.forces.block):
            bench.forces.read(1.0)
        with pytest.raises(DeviceTimeout):
            bench.forces.read(0.01)
        bench.camera.stop()
        bench.forces.read(1.0)


def test_blocks_with_more_frames_than_may_wait_still_pass():
    volts, frames, _ = drive(scenario(FREE, block=1000), None, blocks=3)
    assert len(volts) == 3000
    assert [f.index for f in frames] == list(range(30))


@pytest.mark.parametrize("end", ["camera", "forces"])
def test_a_waiting_read_ends_when_its_device_is_stopped(end):
    bench = fake_bench(FREE, None)
    with bench:
        bench.camera.start(TRAIN)
        bench.forces.start(TRAIN)
        device = getattr(bench, end)
        error = end_of_a_waiting_read(device, device.stop, bench.world._changed, "wait")
    assert isinstance(error, DeviceTimeout if end == "camera" else DeviceFault)


def test_an_exposure_cut_by_the_end_gives_no_frame():
    bench = fake_bench(FREE, None)
    with bench:
        bench.camera.start(TRAIN)
        bench.forces.start(TRAIN)
        bench.world.advance(TRAIN.sample(1) + FREE.exposure_samples - 1)
        bench.forces.stop()
        assert bench.camera.read(1.0).index == 0
        with pytest.raises(DeviceTimeout, match="end of the samples"):
            bench.camera.read(60.0)


def test_triggers_faster_than_the_exposure_are_refused():
    bench = fake_bench(FREE, None)
    with bench, pytest.raises(OutOfLimits, match="9 samples was requested, the exposure takes 10"):
        bench.camera.start(TriggerTrain(0, 9))


def test_a_world_runs_once():
    bench = fake_bench(FREE, None)
    with bench:
        bench.forces.start(TRAIN)
        bench.forces.stop()
        with pytest.raises(DeviceFault, match="new bench"):
            bench.forces.start(TRAIN)


def test_the_encoder_reads_whole_counts_and_the_stage_comes_to_the_target():
    bench = fake_bench(FREE, None)
    with bench:
        actuator = bench.actuator
        start = actuator.position_m()
        assert start == pytest.approx(12.5e-3, abs=0.035e-6)
        actuator.set_velocity(5e-6)
        actuator.move_to(start + 10e-6)
        seen = set()
        while actuator.is_moving():
            bench.world.advance(10)
            seen.add(actuator.position_m())
        counts = (np.array(sorted(seen)) / 0.035e-6) % 1
        assert np.minimum(counts, 1 - counts).max() < 1e-6
        assert len(seen) > 200
        assert bench.world.stage_m() == pytest.approx(10e-6, abs=1e-15)


def test_home_goes_to_the_origin():
    bench = fake_bench(FREE, None)
    with bench:
        bench.actuator.home()
        bench.world.advance(30_000)
        assert not bench.actuator.is_moving()
        assert bench.actuator.position_m() == 0


def test_to_hold_the_position_that_the_encoder_reads_is_no_move_back():
    bench = fake_bench(QUICK, None)
    with bench:
        bench.world.advance(300)
        bench.actuator.set_velocity(10e-6)
        bench.actuator.move_to(bench.actuator.position_m() + 50e-6)
        for _ in range(20):
            bench.world.advance(1)
            bench.actuator.move_to(bench.actuator.position_m())
            assert not bench.actuator.is_moving()
            bench.actuator.move_to(bench.actuator.position_m() + 1e-6)


# ------------------------------------------------------------------ the bench


class Recorded:
    """A device that writes down what happens to it, and fails where it is told to."""

    def __init__(self, name, log, fails=""):
        self.name, self.log, self.fails = name, log, fails

    def _do(self, what):
        self.log.append(f"{what} {self.name}")
        if what in self.fails:
            raise DeviceFault(f"{self.name} does not {what}")

    def open(self):
        self._do("open")

    def close(self):
        self._do("close")

    def describe(self):
        return "a device"


def recorded(log, **fails):
    return Bench(
        *(Recorded(name, log, fails.get(name, "")) for name in ("forces", "camera", "actuator"))
    )


def test_a_bench_opens_in_order_and_closes_in_reverse():
    log = []
    with recorded(log):
        assert log == ["open actuator", "open camera", "open forces"]
    assert log[3:] == ["close forces", "close camera", "close actuator"]


def test_a_bench_that_does_not_open_leaves_nothing_open():
    log = []
    with pytest.raises(DeviceFault, match="camera does not open") as caught:
        recorded(log, camera="open", actuator="close").open()
    assert log == ["open actuator", "open camera", "close camera", "close actuator"]
    assert caught.value.__notes__ == ["actuator does not close"]


def test_every_device_is_closed_even_if_others_fail():
    log = []
    bench = recorded(log, forces="close", camera="close")
    bench.open()
    with pytest.raises(DeviceError, match="forces does not close; camera does not close"):
        bench.close()
    assert log[-1] == "close actuator"


def test_every_device_is_closed_even_if_one_does_not_return_from_that(monkeypatch):
    monkeypatch.setattr(drivers.bench, "CLOSE_S", 0.1)
    log, release = [], threading.Event()
    bench = recorded(log, forces="close")
    bench.open()
    bench.camera.close = lambda: release.wait(20)
    expected = "bench: forces does not close; camera: it did not close within 0.1 s and was given"
    with pytest.raises(DeviceError, match=expected):
        bench.close()
    release.set()
    assert log[-1] == "close actuator"


def test_a_simulated_contact_follows_a_stage_from_where_that_began(world):
    """A stage whose scale begins elsewhere has not pushed the block by that much."""
    positions = iter([3.0e-3, 3.02e-3])
    stage = SimpleNamespace(position_m=lambda: next(positions))
    followed = FollowedActuator(stage, world)
    ways = [(followed.position_m(), world.stage_m()) for _ in range(2)]
    assert ways == [(3.0e-3, 0.0), (3.02e-3, pytest.approx(0.02e-3))]


def test_an_unknown_device_names_the_known_ones_and_the_nearest(monkeypatch):
    few = {name: DRIVERS["camera"][name] for name in ("sim", "pylon")}
    monkeypatch.setitem(DRIVERS, "camera", few)
    with pytest.raises(
        UnknownDevice,
        match=r"camera: no driver is called 'pilon'; known: pylon, sim \(the nearest is 'pylon'\)",
    ):
        make_bench(ForceSettings(), CameraSettings(source="pilon"), ActuatorSettings())
    assert issubclass(UnknownDevice, DeviceNotFound)


def test_simulated_devices_of_one_bench_share_one_world():
    here = scenario(**TINY, press_time=0.0, press_samples=10, slow_actuator=False, force_noise=0.0)
    bench = make_bench(here.forces, here.camera, ActuatorSettings(), scenario=here, pace=None)
    with Bench(bench.forces, SimCamera(bench.world, Numbered()), bench.actuator):
        bench.forces.start(TRAIN)
        at_rest = bench.forces.read(1.0).volts[-1, 1]
        bench.actuator.set_velocity(1e-3)
        bench.actuator.move_to(bench.actuator.position_m() + 30e-6)
        assert bench.forces.read(1.0).volts[-1, 1] > at_rest + 0.5
