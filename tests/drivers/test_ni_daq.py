"""Runs of the NI driver through NI's own package, against the emulated board behind NI's network
protocol.
"""

import grpc
import numpy as np
import pytest
from contracts import TRAIN, ForceSourceContract
from driver_runs import started
from ni_bench import QUICK, NiBench, check_samples, pieces, reference
from nidaqmx import GrpcSessionOptions, Task
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.errors import DaqError
from nidaqmx.stream_readers import AnalogMultiChannelReader
from worlds import scenario

from drivers.emulators.ni_server import _Calls
from drivers.errors import OutOfLimits
from drivers.protocols import LostSamples, SampleBlock, TriggerTrain
from drivers.sim.devices import SimForces
from drivers.sim.world import World


@pytest.fixture
def ni():
    with NiBench() as bench:
        yield bench


# ------------------------------------------------------------------ what every force source does


class TestEmulatedNiForces(ForceSourceContract):
    @pytest.fixture(params=["counter", "digital", "counted"])
    def forces(self, request, ni):
        if request.param == "counted":
            return ni.emulated(exposure_counter="ctr1")
        return ni.emulated(trigger=request.param)

    def test_it_says_what_it_is(self, forces):
        forces.open()
        assert "PCI-6251, simulated on 127.0.0.1" in forces.describe()
        assert "ai0 and ai1, differential, at 1000 Hz" in forces.describe()

    def test_it_opens_again_after_close(self, forces):
        for _ in range(2):
            forces.open()
            forces.close()
        started(forces)
        assert forces.read(5.0).first == 0


@pytest.mark.parametrize("block", [50, 73])
def test_its_volts_are_those_of_the_simulated_board_to_the_bit(ni, block):
    forces = ni.emulated(block=block)
    simulated = SimForces(World(scenario(QUICK, block=block), None))
    for source in (forces, simulated):
        started(source)
    for _ in range(10):
        ours, theirs = forces.read(5.0), simulated.read(5.0)
        np.testing.assert_array_equal(ours.volts, theirs.volts)
    assert ours.volts[-1, 0] > 1  # pressed on by then
    assert ours.exposures is None
    assert ours.volts.flags.c_contiguous


def test_a_second_run_begins_at_sample_0_again(ni):
    forces = ni.connect(ni.serve().address, exposure_counter="ctr1")
    forces.open()
    for _ in range(2):
        forces.start(TRAIN)
        read = pieces(forces, 200)
        check_samples(read)
        assert read[-1].exposures[-1] == 2
        forces.stop()


def test_a_digital_line_that_was_left_high_loses_no_trigger_of_the_next_run(ni):
    forces = ni.connect(ni.serve().address, trigger="digital", exposure_counter="ctr1")
    forces.open()
    for _ in range(2):
        forces.start(TRAIN)
        assert pieces(forces, 250)[-1].exposures[-1] == 3
        forces.stop()


def test_the_inputs_are_those_of_the_settings_and_end_at_their_ranges(ni, monkeypatch):
    wirings, create = [], _Calls.CreateAIVoltageChan

    def note(self, r):
        wirings.append(r.terminal_config or r.terminal_config_raw)
        create(self, r)

    monkeypatch.setattr(_Calls, "CreateAIVoltageChan", note)
    forces = started(ni.emulated(channels=("ai7", "ai2"), wiring="nrse", range=(1.0, 0.005)))
    volts = np.concatenate([forces.read(5.0).volts for _ in range(5)])
    np.testing.assert_array_equal(
        volts, np.clip(reference(250, range=(1.0, 0.005)), (-1, -0.005), (1, 0.005))
    )
    assert wirings == [TerminalConfiguration.NRSE.value] * 2


def test_the_triggers_end_before_the_samples(ni, monkeypatch):
    forces = started(ni.emulated(exposure_counter="ctr1"))
    board, ended = forces.server.board, []
    stop = board.stop
    monkeypatch.setattr(board, "stop", lambda task: [ended.append(task.kind), stop(task)])
    forces.stop()
    assert ended[:3] == ["co", "ai", "ci"]


# ------------------------------------------------------------------ triggers and exposures


@pytest.mark.parametrize(
    ("trigger", "train"),
    [
        ("counter", (0, 42)),
        ("counter", (30, 125)),
        ("counter", (250, 42)),
        ("digital", (0, 42)),
        ("digital", (30, 125)),
        ("digital", (1, 2)),
    ],
)
@pytest.mark.parametrize("rate", [1000, 2500])
def test_the_board_sends_the_pulses_that_were_asked(ni, trigger, train, rate):
    forces = started(ni.emulated(trigger=trigger, sample_rate=rate), TriggerTrain(*train))
    assert forces.world.pulses == TriggerTrain(*train)


@pytest.mark.parametrize(
    ("trigger", "train"),
    [
        ("digital", (42, 42)),
        ("digital", (0, 1)),
        ("counter", (0, 1)),
        ("counter", (-1, 9)),
        ("counter", (0, 220_000)),
        ("counter", (0, 450_000)),
    ],
)
def test_a_train_that_can_not_be_made_is_refused(ni, trigger, train):
    forces = ni.emulated(trigger=trigger)
    forces.open()
    with pytest.raises(OutOfLimits, match=f"every {train[1]} samples from {train[0]} on"):
        forces.start(TriggerTrain(*train))
    forces.start(TRAIN)
    assert forces.read(5.0).first == 0


def test_exposures_are_counted_beside_the_samples(ni):
    forces = ni.emulated(
        "lost-trigger 2", "late-trigger 4 7", exposure_counter="ctr1", exposure_terminal="PFI8"
    )
    forces.open()
    assert forces.counts_exposures
    forces.start(TriggerTrain(10, 50))
    counts = np.concatenate([forces.read(5.0).exposures for _ in range(8)])
    assert counts.dtype == np.int64
    assert np.flatnonzero(np.diff(counts, prepend=0)).tolist() == [10, 60, 160, 217, 260, 310, 360]
    assert counts[-1] == 7


def test_a_counter_that_overflows_counts_on(ni, monkeypatch):
    forces = ni.emulated(exposure_counter="ctr1")
    forces.open()
    begin = 2**32 - 3
    monkeypatch.setattr(
        World, "exposure_counts", lambda self, first, n: begin + np.arange(first, first + n) // 10
    )
    forces.start(TRAIN)
    counts = np.concatenate([forces.read(5.0).exposures for _ in range(3)])
    np.testing.assert_array_equal(counts, begin + np.arange(150) // 10)


# ------------------------------------------------------------------ overflow


def test_the_backlog_reaches_to_the_newest_sample(ni):
    forces = ni.emulated("daq-overflow 50 300", pace=10.0)
    assert forces.backlog() == 0
    started(forces)
    world = forces.world
    assert world.wait_for(lambda: world.now >= 600, 20.0)
    end, size = 0, 50
    for kind in (SampleBlock, LostSamples, SampleBlock, SampleBlock):
        block = forces.read(5.0)
        assert isinstance(block, kind)
        assert block.end == (350 if kind is LostSamples else end + size)
        end = block.end
        assert world.wait_for(lambda end=end: world.now >= end + 200, 20.0)
        before = world.now - 100  # one tick of this pace
        waiting = forces.backlog()
        assert before <= end + waiting <= world.now
        size = max(50, min(waiting, 1000))  # what waits is read at once, a second of it at most
    assert size > 50
    forces.stop()
    assert forces.backlog() == 0


def test_a_second_of_many_channels_is_read_at_once(ni):
    auxiliary = tuple(f"input{n} ai{n} V" for n in range(2, 6))
    forces = started(ni.emulated(sample_rate=100_000, auxiliary=auxiliary), TriggerTrain(0, 12_500))
    forces._waiting = 100_000  # as `backlog` has found them
    assert forces.read(20.0).auxiliary.shape == (100_000, 4)


@pytest.mark.parametrize(("at", "gap"), [(500, (500, 300)), (520, (500, 320)), (0, (0, 300))])
@pytest.mark.parametrize("pace", [None, 10.0])
def test_overwritten_samples_are_a_gap_of_their_true_length(ni, at, gap, pace):
    forces = started(
        ni.emulated(f"daq-overflow {at} 300", pace=pace, exposure_counter="ctr1"),
        TriggerTrain(0, 42),
    )
    read = pieces(forces, 1500)
    lost = [piece for piece in read if isinstance(piece, LostSamples)]
    assert [(piece.first, piece.count) for piece in lost] == [gap]
    assert "overwritten" in lost[0].reason
    check_samples(read)
    world = World(QUICK, None)
    world.start(TriggerTrain(0, 42))
    for block in read:
        if isinstance(block, SampleBlock):
            np.testing.assert_array_equal(
                block.exposures, world.exposure_counts(block.first, len(block.volts))
            )


def test_a_second_gap_is_of_its_true_length_as_well(ni):
    forces = started(ni.emulated("daq-overflow 500 300", "daq-overflow 1000 200"))
    lost = [piece for piece in pieces(forces, 1500) if isinstance(piece, LostSamples)]
    assert [(piece.first, piece.count) for piece in lost] == [(500, 300), (1000, 200)]


def test_what_nobody_reads_is_overwritten_and_what_follows_keeps_its_number(ni):
    forces = started(ni.emulated(pace=20.0, buffer=1.0, exposure_counter="ctr1"))
    world = forces.world
    assert world.wait_for(lambda: world.now > 3000, 20.0)
    read = pieces(forces, 1)
    assert isinstance(read[0], LostSamples)
    assert read[0].count > 1500
    while sum(isinstance(piece, SampleBlock) for piece in read) < 5:
        read += pieces(forces, read[-1].end + 1, now=read[-1].end)
    check_samples(read)


def test_a_program_that_does_not_allow_to_overwrite_is_stopped_as_by_ni(ni):
    server = ni.serve(pace=20.0)
    world = server.world
    with (
        grpc.insecure_channel(server.address) as channel,
        Task(grpc_options=GrpcSessionOptions(channel, "")) as task,
    ):
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(
            1000, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=100
        )
        task.start()
        assert world.wait_for(lambda: world.now > 500, 20.0)
        reader = AnalogMultiChannelReader(task.in_stream)
        reader.verify_array_shape = False
        with pytest.raises(DaqError) as caught:
            reader.read_many_sample(np.empty((1, 10)), 10)
        assert caught.value.error_code == -200222
