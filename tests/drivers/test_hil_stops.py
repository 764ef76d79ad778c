"""The stage of the emulated bench stops short of its target, whichever device falls silent or does
not return from a call, and never goes further than it was asked to.
"""

import re
import threading
import time

import pytest
from hil_run import HilRun
from short_run import BLIND

from app.records.record_types import Phase

GATE_S = 60.0
TRAVEL_M = 60e-6
# older than the forces of a busy machine ever are, and long before the drive of 12 s ends
AGE = ("run.travel=60", "limits.age=2", *BLIND)


class Silence:
    """Lets one part of a running bench fall silent; `since` is when."""

    def __init__(self, part, phase=Phase.DRIVE):
        self.part, self.phase, self.since = part, phase, None
        self.gate = threading.Event()

    def __call__(self, hil):
        until = time.monotonic() + GATE_S
        while hil.run._experiment.phase is not self.phase or hil.bench.world.stage_m() < (
            3e-6 if self.phase is Phase.DRIVE else 0.0
        ):
            assert time.monotonic() < until, "the phase never came"
            time.sleep(0.005)
        self.since = time.monotonic()
        getattr(self, self.part)(hil.bench)
        # read now: `close` ends the emulated line
        self.line = hil.bench.actuator._far_end

    def stuck(self, *_, **__):
        self.gate.wait(GATE_S)

    def server(self, bench):
        bench.forces.device.server.board.check = self.stuck

    def force_driver(self, bench):
        bench.forces.device.read = self.stuck

    def controller(self, bench):
        bench.actuator._far_end.is_mute = True

    def actuator_driver(self, bench):
        bench.actuator.position_m = self.stuck

    def camera(self, bench):
        bench.camera._follows = False

    def camera_driver(self, bench):
        bench.camera.read = self.stuck


class WaitingTime:
    """Lets the time of a bench pass, tick by tick and no quicker than real time, only while the
    program waits for an answer of its board or its stage: a busy computer costs no sample.
    """

    def __init__(self, bench):
        self._rate, self._asked, self._ticked = bench.world.scenario.forces.sample_rate, 0, 0.0
        bench.world._wait_s = self._wait_s
        for device, names in (
            (bench.forces, ("read",)),
            (bench.actuator, ("position_m", "is_moving", "move_to", "stop")),
        ):
            for name in names:
                setattr(device, name, self._noted(getattr(device, name)))

    def _noted(self, method):
        def call(*args):
            self._asked += 1
            try:
                return method(*args)
            finally:
                self._asked -= 1

        return call

    def _wait_s(self, n):
        now = time.monotonic()
        if not self._asked:
            self._ticked = now
        wait_s = self._ticked + n / self._rate - now
        if wait_s <= 0:
            self._ticked = now
        return wait_s


@pytest.fixture
def ended(tmp_path):
    silences = []

    def end(part, phase=Phase.DRIVE, *overrides, **how):
        silences.append(Silence(part, phase))
        hil = HilRun(
            tmp_path / "x.h5", *AGE, *overrides, pace=1.0, while_running=silences[-1], **how
        )
        return hil, silences[-1]

    yield end
    for silence in silences:
        silence.gate.set()


def stopped_s(silence):
    """Time from the silence to the first stop on the wire."""
    return next(t for t, c in silence.line.arrivals if c == b"1ST" and t > silence.since) - (
        silence.since
    )


@pytest.mark.parametrize(
    ("part", "named"),
    [
        ("server", "NI board 'Dev1': (it was asked and no force came|.* does not answer)"),
        ("force_driver", "NI board 'Dev1': it was asked and no force came for 2 s"),
        ("controller", "emulated SMC100: .* gave no answer to 'T[PS]' within 0.6 s"),
        ("actuator_driver", "emulated SMC100: it was asked and no force came for 2 s"),
        ("camera", "emulated pylon camera: no image came for .* has had no answer"),
        ("camera_driver", "emulated pylon camera: no image came for .* has had no answer"),
    ],
)
def test_whatever_falls_silent_in_the_drive_is_named_and_the_stage_stops(ended, part, named):
    hil, silence = ended(part)
    assert hil.outcome.state == "failed"
    assert re.match(named, hil.outcome.reason), hil.outcome.reason
    assert stopped_s(silence) < 8.0  # the drive had 11 s to go
    assert hil.stands()
    assert 0 < hil.world.stage_m() < 0.9 * TRAVEL_M
    assert hil.is_accounted_for()


def test_a_mute_actuator_costs_no_sample_and_no_frame(ended):
    """Its driver waits for it for less than the board's buffer lasts."""
    hil, _ = ended("controller", Phase.DRIVE, "forces.buffer=1", before=WaitingTime)
    assert hil.gaps == []
    assert hil.counts.frames_lost == hil.counts.samples_lost == 0


@pytest.mark.parametrize("part", ["force_driver", "actuator_driver", "server"])
def test_what_hangs_before_the_drive_ends_the_run_too(ended, part):
    hil, _ = ended(part, Phase.CONTACT)
    assert hil.outcome.state == "failed"
    assert hil.outcome.reason.startswith(
        "emulated SMC100: " if part == "actuator_driver" else "NI board 'Dev1': "
    ), hil.outcome.reason
    assert hil.world.stage_m() == 0
    assert hil.is_accounted_for()


def test_a_stop_by_hand_ends_a_run_whose_board_hangs(tmp_path):
    silence = Silence("force_driver")

    def hang_and_stop(hil):
        silence(hil)
        hil.run.request_stop("Ctrl-C was pressed")

    try:
        hil = HilRun(tmp_path / "x.h5", *AGE, pace=1.0, while_running=hang_and_stop)
    finally:
        silence.gate.set()
    assert "Ctrl-C was pressed" in hil.outcome.reason
    assert "was given up" in hil.outcome.reason
    assert hil.world.stage_m() < 0.9 * TRAVEL_M
    assert hil.is_accounted_for()
