"""A bench under stress: a disk that is too slow, or for a while, or full, and an analysis that
lags. Nothing measured is lost.

The stress follows the simulated clock, which waits for all that is not under stress: "0.43 of the
data rate" is exact, however busy the machine.
"""

import shutil
from collections import namedtuple

import numpy as np
import pytest
from short_run import SMALL

from app.records.record_types import Phase
from app.runs import live
from app.session.files import RESERVE_BYTES
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.settings import config
from drivers.errors import DeviceFault
from drivers.protocols import Frame

DIVISOR = 125
PACE = 1e6  # not None: the bench does not wait for the disk, nor for the analysis
TIMEOUT = 400


class Stressed:
    """A run under stress: what its board and its health said meanwhile, its outcome, and its file.

    `stress(run)` is called once the session is made.
    """

    def __init__(self, path, stress, *overrides):
        self.path, self.blocks, self.healths, self.is_held = path, [], [], False
        self.run = run = live.make_run(config.load(None, [*SMALL, *overrides]), path, pace=PACE)
        self.world = run._bench.world
        run._watchdog.is_direct = True  # the board waits for us, in `tapped`: no time counts
        read, create = run._bench.forces.read, run._create_sink

        def tapped(timeout):
            while not self.rest_keeps_up():
                self.world.wait_for(self.rest_keeps_up, 0.002)
            self.healths.append(run.health())
            self.blocks.append(read(timeout))
            return self.blocks[-1]

        def stressed(*args):
            self.sink = create(*args)
            stress(self)
            return self.sink

        run._bench.forces.read, run._create_sink = tapped, stressed
        run.start()
        self.outcome = run.wait(TIMEOUT)
        assert self.outcome is not None, "the run did not end"
        self.counts = self.outcome.counts

    @property
    def fills(self):
        return np.array([health.queue_fill for health in self.healths])

    def is_driving(self):
        return self.run._history.phase_start(Phase.DRIVE) is not None

    def rest_keeps_up(self):
        """Whether the camera has answered, and disk and analysis, where they are not held up, have
        nothing to do.
        """
        run, workers = self.run, self.run._workers
        due = run._train.count_before(self.world.now - run.config.exposure_samples + 1)
        is_analysed = self.is_driving() or not run._to_analysis._items
        in_step = (
            workers.receiver.answered >= due
            and is_analysed
            and (self.is_held or not workers.recorder.fill)
        )
        return in_step or run._ending.is_called.is_set()

    def until(self, sample):
        """Wait until the bench is at that sample, or the run is called to its end: then nobody may
        read, and the clock stands.
        """
        while self.world.now < sample and not self.run._ending.is_called.is_set():
            self.world.wait_for(lambda: self.world.now >= sample, 0.05)

    def before_images(self, wait):
        """Have the sink call `wait()` before each image is written."""
        append = self.sink.append

        def slowly(record):
            if isinstance(record, Frame):
                self.is_held = True
                wait()
                self.is_held = False
            append(record)

        self.sink.append = slowly

    def stage_stands_since(self):
        """Sample of the last command to the stage, which left it standing."""
        assert self.world._moves[-1].speed == 0
        drive = self.run._history.phase_start(Phase.DRIVE)
        return next(
            move.sample for move in self.world._moves if move.sample > drive and not move.speed
        )

    def file_holds(self, frames):
        """Whether that many frames, and every sample that the board gave, are in the file, bit for
        bit, and the receipt says so.
        """
        volts = np.concatenate([block.volts for block in self.blocks])
        camera, half = self.run._bench.camera, self.run.config.exposure_samples // 2
        with SessionReader(self.path) as session:
            assert (session.outcome.state, session.outcome.reason) == (
                self.outcome.state,
                self.outcome.reason,
            )
            assert [index for index, _, _ in session.frames()] == list(range(frames))
            for index, sample, image in session.frames():
                assert sample == DIVISOR * index
                assert np.array_equal(
                    image, camera._renderer.image(self.world.state(sample + half), index)
                )
            assert np.array_equal(session.forces().volts, volts[: len(session.forces().volts)])
            samples = len(session.forces().volts)
        assert self.outcome.resources["receipt"].startswith(f"{frames:,} frames")
        assert not journal_of(self.path).exists()
        return samples

    def nothing_is_lost(self):
        """Whether each trigger has its frame, and each sample up to the last that the board gave is
        there, in the account and the file.
        """
        counts = self.counts
        assert (
            counts.triggers
            == counts.frames_received
            == counts.frames_recorded
            == counts.frames_analysed + counts.frames_skipped
        )
        assert (counts.frames_lost, counts.samples_lost, counts.samples) == (
            0,
            0,
            self.blocks[-1].end,
        )
        return self.file_holds(counts.triggers) == counts.samples


def test_a_disk_slower_than_the_data_ends_the_run_by_name_and_loses_nothing(tmp_path):
    """20 MB/s against 46: the queue fills, the operator can see it, and what was measured until
    everything stood is in the file.
    """
    writes = []

    def throttle(s):
        def wait():
            if s.is_driving():
                s.until((writes[-1] if writes else s.world.now) + DIVISOR / 0.43)
                writes.append(s.world.now)

        s.before_images(wait)

    s = Stressed(tmp_path / "slow.h5", throttle, "recording.queue=2")
    assert s.outcome.state == "failed"
    assert s.outcome.reason.startswith(
        "recorder: the disk is slower than the data, 2 s of it wait and the queue holds no more;"
        " record to "
    )
    assert s.nothing_is_lost()
    running = np.array([health.state == "running" for health in s.healths])
    assert {round(10 * fill) for fill in s.fills[running]} >= {3, 5, 7, 9}  # it is seen to fill
    drive = s.run._history.phase_start(Phase.DRIVE)
    filled_s = (s.stage_stands_since() - drive) / 1000
    assert 2 / 0.57 - 1 < filled_s < 2 / 0.57 + 2  # and the stage stands at once when it has
    assert s.counts.samples < s.stage_stands_since() + 2 * DIVISOR


@pytest.mark.slow
def test_a_disk_that_pauses_for_less_than_the_queue_holds_costs_nothing(tmp_path):
    pauses = []

    def pause(s):
        def wait():
            if s.is_driving() and not pauses:
                pauses.append(s.world.now)
                s.until(s.world.now + 5000)

        s.before_images(wait)

    s = Stressed(tmp_path / "pause.h5", pause, "recording.queue=10")
    assert (s.outcome.state, s.outcome.reason) == ("done", "the drive of 60 um is complete")
    assert s.nothing_is_lost()
    assert 0.4 < s.fills.max() < 1
    assert s.fills[-1] < 0.1


@pytest.mark.slow
def test_an_analysis_ten_times_too_slow_costs_nothing_but_its_own_frames(tmp_path):
    def slow_down(s):
        step = s.run._analysis.pipeline.step

        def slowly(index, sample, image, now, *rest):
            if now.phase is Phase.DRIVE:
                s.until(s.world.now + 10 * DIVISOR)
            return step(index, sample, image, now, *rest)

        s.run._analysis.pipeline.step = slowly

    s = Stressed(tmp_path / "lag.h5", slow_down)
    assert (s.outcome.state, s.outcome.reason) == ("done", "the drive of 60 um is complete")
    assert s.nothing_is_lost()
    # nine of ten, but for what waits at the end: it is analysed, at its leisure, and so is one more
    assert s.counts.frames_skipped > 0.88 * 12.2 * 8 - s.run._to_analysis.depth - 1
    seen = [health.counts.frames_skipped for health in s.healths if health.state == "running"]
    assert seen == sorted(seen)
    assert seen[-1] > 0.6 * 12.2 * 8
    assert s.fills.max() < 0.9


@pytest.mark.slow
def test_a_reference_that_takes_long_is_waited_for_with_the_forces_read_on(tmp_path):
    """Else the drive would begin with seconds of forces not looked at, and the limits with them."""
    began = []

    def slow_down(s):
        take, is_driving = s.run._analysis.pipeline._take_reference, s.is_driving

        def slowly(*frame):
            s.is_driving = lambda: True  # the analysis is behind: nobody waits for it
            s.run._bench.forces.backlog = lambda: 1  # and time passes
            began.append(s.world.now)
            s.until(s.world.now + 8000)
            s.is_driving, s.run._bench.forces.backlog = is_driving, lambda: 0
            return take(*frame)

        s.run._analysis.pipeline._take_reference = slowly

    s = Stressed(tmp_path / "slow-reference.h5", slow_down)
    assert (s.outcome.state, s.outcome.reason) == ("done", "the drive of 60 um is complete")
    assert s.nothing_is_lost()
    with SessionReader(s.path) as session:
        (drive,) = [event.sample for event in session.events() if event.text == "drive"]
    assert 8000 <= drive - began[0] < 8000 + 2 * DIVISOR


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["by itself", "by a fault of the stage"])
def test_what_the_board_holds_when_the_run_ends_is_read(tmp_path, ending):
    """A program that is seconds behind its board knows where the stage is now, and reads what was
    sampled until it stood.
    """
    ends = []

    def fall_behind(s):
        forces = s.run._bench.forces
        read, held = forces.read, []

        def late(timeout):
            while s.is_driving() and len(held) < 60 and not s.run._ending.is_called.is_set():
                held.append(read(timeout))
            if s.run._ending.is_called.is_set() and not ends:
                ends.append(s.world.now)
            return held.pop(0) if held else read(timeout)

        forces.read, forces.backlog = late, lambda: sum(len(block.volts) for block in held)
        if ending != "by itself":
            position = s.run._bench.actuator.position_m

            def fails():
                if s.is_driving() and s.world.now > s.run._history.phase_start(Phase.DRIVE) + 5000:
                    raise DeviceFault("stage: it does not answer; switch it on")
                return position()

            s.run._bench.actuator.position_m = fails

    s = Stressed(tmp_path / "late.h5", fall_behind)
    assert s.outcome.state == ("done" if ending == "by itself" else "failed"), s.outcome.reason
    assert s.counts.samples >= ends[0]
    assert s.nothing_is_lost()
    with SessionReader(s.path) as session:
        phases = {event.text: event.sample for event in session.events() if event.kind == "phase"}
        assert ends[0] - DIVISOR <= phases["end"] <= s.counts.samples


def test_a_full_disk_ends_the_run_by_name_with_all_that_was_before(tmp_path, monkeypatch):
    usage, free = namedtuple("usage", "total used free"), [1 << 40]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1 << 40, 0, free[0]))
    full_at = []

    def fill_up(s):
        def wait():
            free[0] = 1 << 40  # and again, for what comes later
            if s.is_driving() and len(full_at) < 20:
                full_at.append(s.run._workers.recorder.frames_recorded)
                free[0] = 1 << 40 if len(full_at) < 20 else RESERVE_BYTES

        s.before_images(wait)

    s = Stressed(tmp_path / "full.h5", fill_up)
    assert s.outcome.state == "failed"
    assert "the disk is full, 34 MB are left; make room" in s.outcome.reason
    assert s.stage_stands_since() < s.blocks[-1].end + 2 * DIVISOR
    assert s.counts.frames_recorded == full_at[-1] == s.counts.triggers - s.counts.frames_lost
    assert s.file_holds(full_at[-1]) > DIVISOR * (full_at[-1] - 1)
