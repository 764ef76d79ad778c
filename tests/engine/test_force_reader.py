"""What is read of the board and of the stage goes block by block to the disk, to the history and to
the decisions; nothing is lost on the way, whatever fails beside it.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from app.acquisition.ending import Ending
from app.acquisition.force_reader import READ_TIMEOUT_S, ForceReader
from app.acquisition.watchdog import PATIENCE_S, Watchdog
from app.evaluation.history import History
from app.records.record_types import Gap, Position, Samples
from app.settings import config
from drivers.bench import ClockedForces
from drivers.clock import SampleClock
from drivers.errors import DeviceFault
from drivers.protocols import LostSamples, SampleBlock, TriggerTrain

BLOCK = 10


class Stage:
    """At 12 mm, where its travel began; after `good` looks it is unplugged."""

    name, start_m, has_failed = "stage X", 12e-3, False

    def __init__(self, good):
        self.good = good

    def look(self):
        self.good -= 1
        if self.good < 0:
            raise DeviceFault("stage X: the line is dead")
        return 11.9e-3, True


class Bench:
    """A board that gives these blocks, with as many samples waiting as `backlog`, and a stage."""

    def __init__(self, *blocks, backlog=0, good=99, overrides=(), is_direct=True):
        self.blocks, self.records = list(blocks), []
        board = SimpleNamespace(
            name="board", read=lambda timeout_s: self.blocks.pop(0), backlog=lambda: backlog
        )
        board.counts_exposures = False
        settings = config.load(None, list(overrides))
        self.history = History(1000.0, exposure_samples=4)
        ending = Ending(lambda: None)
        self.watchdog = Watchdog(ending, settings.limits.age, is_direct=is_direct)
        devices = SimpleNamespace(forces=ClockedForces(board, SampleClock(1000.0)))
        self.stage = Stage(good)
        self.reader = ForceReader(
            settings, devices, self.stage, self.history, self.watchdog, pace=1.0
        )
        self.reader.record = self.records.append

    def recorded(self, kind):
        return [record for record in self.records if isinstance(record, kind)]


def block(number, volts=(0.0, 0.0)):
    return SampleBlock(number * BLOCK, np.tile(volts, (BLOCK, 1)).astype(float))


def lost(number, count=3 * BLOCK):
    return LostSamples(number * BLOCK, count, "samples were overwritten")


@pytest.mark.parametrize("sign", [1, -1])
def test_a_block_tells_its_forces_the_way_of_the_stage_and_the_range_that_is_used(sign):
    bench = Bench(block(0, (sign * 2.0, -sign * 9.5)))
    measured = bench.reader.take()
    assert measured.end_sample == BLOCK
    assert measured.travel_m == pytest.approx(-100e-6)
    assert measured.is_moving
    assert measured.range_used == pytest.approx((0.2, 0.95))
    assert np.array_equal(measured.volts, bench.recorded(Samples)[0].volts)
    assert np.sign(measured.largest[0]) == -np.sign(measured.largest[1])


def test_a_position_lies_where_the_stage_was_read_and_not_at_the_end_of_the_block():
    bench = Bench(block(0), block(1), backlog=35)
    assert [bench.reader.take().asked_sample for _ in range(2)] == [45, 55]
    assert bench.recorded(Position) == [Position(45, 11.9e-3), Position(55, 11.9e-3)]


def test_forces_that_wait_to_be_read_are_as_old_as_what_waits():
    bench = Bench(block(0), backlog=350, is_direct=False)
    assert bench.reader.take().age_s == pytest.approx(0.35, abs=0.05)
    bench.watchdog.close()


def test_a_block_lasts_as_long_as_its_samples():
    bench = Bench(overrides=("forces.sample_rate=2000", "forces.block=500"))
    assert bench.reader.block_s == 0.25


def test_a_block_of_seconds_has_the_time_that_it_takes():
    bench = Bench(overrides=("forces.block=4000", "limits.age=10"))
    asked, read = [], bench.reader._bench.forces.device
    read.read = lambda timeout_s: asked.append(timeout_s) or block(0)
    bench.watchdog.ask = lambda who, step, patience_s: asked.append(patience_s) or step()
    bench.reader.take()
    assert asked == [4.0 + PATIENCE_S, 4.0 + READ_TIMEOUT_S]


def test_the_forces_that_were_read_last_grow_older_until_the_next_come():
    bench = Bench(block(0), block(1), backlog=350, is_direct=False)
    bench.reader.take()
    bench.reader._bench.forces.backlog = lambda: 0
    assert bench.reader.take().age_s == pytest.approx(0.35, abs=0.05)  # what was known before
    bench.watchdog.close()


def test_an_actuator_that_fails_costs_no_sample():
    bench = Bench(block(0), good=0)
    with pytest.raises(DeviceFault, match="the line is dead"):
        bench.reader.take()
    assert len(bench.recorded(Samples)) == 1
    assert bench.history.end == BLOCK


def test_a_gap_is_counted_sample_by_sample_and_ends_a_run_only_if_it_is_to():
    bench = Bench(block(0), lost(1), block(4), overrides=["forces.on_overflow=continue"])
    bench.reader.take()
    assert bench.reader.take() is None
    assert bench.reader.take().end_sample == 5 * BLOCK
    assert bench.reader.samples_lost == 3 * BLOCK
    assert str(bench.reader.losses) == f"{3 * BLOCK} × samples were overwritten"
    assert bench.recorded(Gap) == [Gap(BLOCK, 3 * BLOCK, "samples were overwritten")]
    ends = Bench(lost(0), overrides=["forces.on_overflow=end"])
    with pytest.raises(DeviceFault, match="30 samples from 0 on are lost"):
        ends.reader.take()
    assert len(ends.recorded(Gap)) == 1  # it is known to the file all the same


def test_gaps_that_follow_each_other_last_no_longer_than_a_board_may_be_silent():
    """One gap is as long as the computer was suspended; nobody watches the forces in the next."""
    bench = Bench(
        *(block(0), lost(1, 5000), lost(501, 800), lost(581, 1)),
        overrides=["forces.on_overflow=continue", "limits.age=0.8"],
    )
    reader = bench.reader
    for _ in range(3):
        reader._watchdog.drives = True
        reader.take()
        reader.check_gaps()
    reader.take()
    reader._watchdog.drives = False
    reader.check_gaps()
    reader._watchdog.drives = True
    with pytest.raises(
        DeviceFault, match=r"board: nothing but gaps came for 0\.8 s \(5801 × samples"
    ):
        reader.check_gaps()
    reader._timeout_s, reader._watchdog.drives = 0.8, False
    with pytest.raises(DeviceFault, match=r"nothing but gaps came for 0\.8 s"):
        reader.check_gaps()


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), SystemExit(3)])
@pytest.mark.parametrize("who", ["board", "stage X"])
def test_what_no_driver_may_raise_is_a_fault_of_that_device_and_costs_no_sample(error, who):
    """It was that of "control", the stage was asked on, and SystemExit left the session open."""
    bench = Bench(block(0), block(1), block(2), is_direct=False)
    reader, board = bench.reader, bench.reader._bench.forces.device
    reader.take()

    def fail(*_):
        raise error

    if who == "board":
        board.read = fail
    else:
        bench.stage.look = fail
    with pytest.raises(DeviceFault, match=rf"^{who}: {type(error).__name__}: .*; check the device"):
        reader.take()
    assert bench.history.end == (BLOCK if who == "board" else 2 * BLOCK)
    bench.watchdog.close()


def test_what_the_board_holds_is_read_although_the_stage_has_failed():
    bench = Bench(*map(block, range(5)), good=1)
    with pytest.raises(DeviceFault, match="the line is dead"):
        bench.reader.read_on(35, TriggerTrain(0, BLOCK))
    assert bench.history.end == 40


@pytest.mark.parametrize(("first", "further"), [(6, 0), (7, 1), (9, 1), (0, 0)])
def test_the_last_exposure_is_read_to_its_end(first, further):
    """An exposure takes 4 samples: one that began 3 samples before the end is still open."""
    bench = Bench(*map(block, range(3)), overrides=["camera.exposure=4"])
    bench.reader.read_on(BLOCK, TriggerTrain(first, 25))
    assert bench.history.end == BLOCK * (1 + further)


def test_samples_that_come_twice_end_the_run():
    bench = Bench(block(0), block(1), block(1))
    for _ in range(2):
        bench.reader.take()
    with pytest.raises(
        DeviceFault, match=f"sample {2 * BLOCK} was due, .* samples from {BLOCK} on"
    ):
        bench.reader.take()
    assert len(bench.recorded(Samples)) == 2
