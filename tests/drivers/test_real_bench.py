"""A run of real drivers alone, each with a far end of its own: NI's package and a server, a serial
line and a controller with a free stage, a folder of images.
"""

import time

import cv2
import numpy as np
import pytest
from free_stage import FreeStage
from short_run import BLIND, SMALL

from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from drivers.emulators.newport import Controller
from drivers.emulators.ni_server import NiServer
from drivers.emulators.serial_line import SerialLine
from drivers.sim.world import World
from drivers.stages import newport_line


class RealBench:
    """The far ends, and the settings that name them."""

    def __init__(self, folder, *overrides, start=12.5, **line):
        self.stage = FreeStage(start=start)
        self.controller = Controller(self.stage)
        self.line = SerialLine(self.controller, "tcp", **line)
        self.server = NiServer(World(live.scenario(config.load(None, SMALL)), 1.0))
        grey = np.random.default_rng(1).normal(128, 40, (96, 96)).clip(0, 255).astype(np.uint8)
        picture = cv2.imencode(".png", grey)[1].tobytes()  # once: the others have the same bytes
        for n in range(80):
            (folder / f"{n}.png").write_bytes(picture)
        self.settings = config.load(
            None,
            [
                *SMALL,
                *BLIND,
                "forces.source=nidaqmx",
                f"forces.server={self.server.address}",
                "camera.source=folder",
                f"camera.folder={folder}",
                "actuator.source=smc100",
                f"actuator.port={self.line.start()}",
                "limits.lost_frames=1",
                *overrides,
            ],
        )
        self.sent = lambda name: [c for _, c in list(self.line.arrivals) if c[1:3] == name]

    def run(self, path):
        """Outcome of a run, and positions (m) and events of its session."""
        run = live.make_run(self.settings, path, pace=1.0)
        run.start()
        outcome = run.wait(100)
        assert outcome is not None
        return outcome

    def end(self):
        self.line.cut()
        self.server.close()


@pytest.fixture
def real(tmp_path):
    made = []

    def make(*overrides, **options):
        made.append(RealBench(tmp_path, *overrides, **options))
        return made[-1]

    yield make
    for bench in made:
        bench.end()


@pytest.mark.slow
@pytest.mark.parametrize("travel", [8, -8])
@pytest.mark.parametrize("deaf_s", [0.0, 0.004])
def test_a_drive_goes_by_what_was_asked_either_way_also_with_a_strict_controller(
    real, tmp_path, monkeypatch, travel, deaf_s
):
    # a busy computer may answer late, which is no reason to send a command again
    monkeypatch.setattr(newport_line, "ANSWER_S", 1.0)
    monkeypatch.setattr(newport_line, "PATIENCE_S", 3.0)
    bench = real(f"run.travel={travel}", deaf_s=deaf_s)
    outcome = bench.run(tmp_path / "x.h5")
    assert (outcome.state, outcome.reason) == ("done", f"the drive of {travel} um is complete")
    sent = bench.sent(b"PA")
    assert set(sent) == {f"1PA{12.5 + travel * 1e-3:g}".encode()}
    assert len(sent) == 1 or b"TE" in bench.line.ignored  # then its acceptance was never asked for
    assert bench.stage.position() == pytest.approx(12.5 + travel * 1e-3, abs=1e-6)
    with SessionReader(tmp_path / "x.h5") as session:
        last = list(session.snapshots())[-1].conditions
        assert session.positions()[1][-1] == pytest.approx((12.5 + travel * 1e-3) * 1e-3, abs=1e-8)
    assert last.travel_m == pytest.approx(8e-6, abs=0.5e-6)


@pytest.mark.parametrize(
    ("state", "start", "words"),
    [
        (0x0A, 12.5, "NOT REFERENCED from reset; home it"),
        (0x3C, 12.5, "DISABLE from READY; its motor is off"),
        (0x32, 24.999, "put it where it has room"),
        (0x28, 12.5, "the stage moves already"),
    ],
)
def test_what_the_drive_would_fail_at_is_told_before_anything_is_measured(
    real, tmp_path, state, start, words
):
    bench = real(start=start)
    bench.controller.state = state
    if state == 0x28:
        bench.stage.move(20.0, 0.01, 1.0)
    outcome = bench.run(tmp_path / "x.h5")
    assert outcome.state == "failed"
    assert words in outcome.reason
    assert outcome.counts.samples == 0
    assert not (tmp_path / "x.h5").exists()
    assert not bench.sent(b"PA")


@pytest.mark.slow
def test_forces_behind_a_slow_line_begin_no_drive(real, tmp_path):
    bench = real("limits.age=0.2", "run.background_time=0", "forces.buffer=60")
    check = bench.server.board.check

    def slow():
        check()
        time.sleep(0.1)

    bench.server.board.check = slow
    outcome = bench.run(tmp_path / "x.h5")
    assert outcome.state == "failed"
    assert "forces: the drive was not begun, the newest force that was read was" in outcome.reason
    assert not bench.sent(b"PA")
