"""Devices of other labs, each a driver of less than a hundred lines outside the package: it keeps
the contracts, by the command that its author would use, and takes part in a whole run.
"""

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import short_run
from free_stage import FreeStage
from labs import fake_ljm
from labs.zaber_emulator import ZaberEmulator

from app.bench_checks import bench_check
from app.cli import run_and_replay as experiment
from app.cli.check_driver import _dying_move, check, check_driver
from app.processes import prepared
from app.processes.dying_move import MOVES
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from app.settings.toml_text import parse_toml
from app.system.errors import UserError
from drivers.bench import make_bench
from drivers.contracts import CONTRACTS
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.protocols import LostSamples, TriggerTrain
from drivers.sources import UnknownDevice

LABS = Path(__file__).parent
TIMEOUT = 300
CONTRACT_NAMES = list(map(str, CONTRACTS["actuator"]))
LOCK = "stop returns soon from any thread also during a query"
OWN_END = "a move ends at its target although the program dies"
SUPERVISOR = "another process can stop it"
CUT = "a dead line is a device error"
QUICK = (*short_run.SHORT, "run.travel=4", "run.background_time=0.2", "run.reference_time=0.4")


@pytest.mark.parametrize("name", ["webcam", "zaber", "labjack"])
def test_a_driver_is_short(name):
    assert len((LABS / f"{name}.py").read_text(encoding="utf-8").splitlines()) < 100


def checked(capsys, source, *overrides, **how):
    """Exit code of `slipscope check-driver`, and what it says of each contract."""
    code = check_driver(source, overrides, as_json=True, **({"move": True} | how))
    said = json.loads(capsys.readouterr().out)
    return code, {one["name"]: one["found"] for one in said["contracts"] if not one["is_fine"]}


# ---------------------------------------------------------------------- a webcam


@pytest.fixture
def film(tmp_path):
    """A film of 200 images, as OpenCV reads a camera."""
    rng, pattern = np.random.default_rng(1), str(tmp_path / "image_%03d.png")
    image = cv2.GaussianBlur(rng.integers(0, 256, (300, 400), np.uint8), (0, 0), 1.5)
    image = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    for n in range(200):
        cv2.imwrite(pattern % n, image)
    settings = ("width=400", "height=300", f"device={pattern}", "options.stale=0")
    return ["camera.source=labs.webcam:Webcam", *(f"camera.{setting}" for setting in settings)]


def test_the_webcam_keeps_every_contract(capsys, film):
    assert checked(capsys, "labs.webcam:Webcam", *film) == (0, {})


def test_the_webcam_says_between_which_triggers_an_image_was_taken(film):
    settings = config.load(None, [*film, "camera.options.latency=120"])
    bench = make_bench(settings.forces, settings.camera, settings.actuator)
    train = TriggerTrain(0, 100)
    with bench:
        assert "uncertain by 120 ms" in bench.camera.describe()
        bench.camera.start(train)
        bench.forces.start(train)
        while bench.forces.read(5.0).end < 1000:
            pass
        frames = [bench.camera.read(5.0) for _ in range(9)]
    assert [frame.index for frame in frames] == list(range(9))
    spans = [(f.first, f.last) for f in frames if f.__class__.__name__ == "Frame"]
    assert spans, "no image was taken in time"
    assert all(first < last for first, last in spans)


# ---------------------------------------------------------------------- a stage


@pytest.fixture
def seconds():
    return [0.0]


@pytest.fixture
def zaber(seconds):
    line = SerialLine(ZaberEmulator(lambda: seconds[0]))
    line.start()
    yield line
    line.cut()


def zaber_settings(line):
    return ["actuator.source=labs.zaber:ZaberStage", f"actuator.port={line.url}"]


def test_the_stage_keeps_every_contract(capsys, zaber, seconds):
    def pass_time(wanted):
        time.sleep(0.02)  # until the last command has arrived
        seconds[0] += wanted

    settings = zaber_settings(zaber)
    code, left = checked(capsys, "labs.zaber:ZaberStage", *settings, pass_time=pass_time)
    assert (code, list(left)) == (0, [SUPERVISOR])
    assert "it has no stopper(), so that no supervisor stops the stage" in left[SUPERVISOR]


def test_nothing_moves_unless_it_is_allowed(capsys, zaber):
    code, left = checked(capsys, "labs.zaber:ZaberStage", *zaber_settings(zaber), move=False)
    assert code == 0
    assert "a move ends by itself at its target" in left
    assert not [arrived for _, arrived in zaber.arrivals if b"move" in arrived]


def test_a_stage_that_is_cut_off_is_a_device_error(zaber):
    settings = config.load(None, zaber_settings(zaber))
    stage = make_bench(settings.forces, settings.camera, settings.actuator).actuator
    stage.open()
    zaber.is_mute = True
    with pytest.raises(DeviceTimeout, match="no answer to 'stop'"):
        stage.stop()
    zaber.cut()
    with pytest.raises((DeviceFault, DeviceTimeout)):
        stage.stop()


# ---------------------------------------------------------------------- a board

LABJACK = (
    "forces.source=labs.labjack:LabJackForces",
    'forces.device="440010"',
    'forces.channels=["AIN0","AIN1"]',
)


def pressed(t):
    """Volts that are 0.03 N of normal force after the first second, with noise."""
    force = 0.03 * min(1.0, max(0.0, t - 1.0) / 0.5)
    return force / (689.0 * 300e-6) + 1e-4 * np.sin(1e5 * t), 0.008 * force / (9579.0 * 22e-6)


def test_the_board_keeps_every_contract(capsys, monkeypatch):
    fake_ljm.install(monkeypatch, fake_ljm.Device(pressed, paced=False))
    assert checked(capsys, "labs.labjack:LabJackForces", *LABJACK) == (0, {})


def test_skipped_scans_are_a_gap_at_their_place_and_waiting_ones_the_backlog(monkeypatch):
    device = fake_ljm.Device(pressed, paced=True)
    device.skipped = range(70, 120)
    fake_ljm.install(monkeypatch, device)
    settings = config.load(None, LABJACK)
    board = make_bench(settings.forces, settings.camera, settings.actuator).forces.device
    board.open()
    board.start(TriggerTrain(0, 125))
    device.stream.began -= 1.0
    read = [board.read(5.0) for _ in range(5)]
    assert [(r.first, r.end, isinstance(r, LostSamples)) for r in read] == [
        (0, 50, False),
        (50, 70, False),
        (70, 100, True),
        (100, 120, True),
        (120, 150, False),
    ]
    assert board.backlog() >= 850
    assert device.triggers() == [0]
    assert len(device.registers["STREAM_OUT0_BUFFER_U16"]) == 125


# ---------------------------------------------------------------------- whole runs


def whole_run(path, *overrides):
    run = live.make_run(config.load(None, [*QUICK, *overrides]), path, pace=1.0)
    run.start()
    outcome = run.wait(TIMEOUT)
    assert outcome is not None
    return outcome


@pytest.mark.slow
def test_a_run_with_webcam_and_stage_of_a_lab(tmp_path, film, monkeypatch):
    line = SerialLine(ZaberEmulator(time.monotonic))
    line.start()
    try:
        outcome = whole_run(tmp_path / "run.h5", *film, *zaber_settings(line))
    finally:
        line.cut()
    assert outcome.state == "done", outcome.reason
    counts = outcome.counts
    assert counts.frames_received + counts.frames_lost == counts.triggers
    assert counts.frames_received > 10
    moved = [arrived for _, arrived in line.arrivals if b"move abs" in arrived]
    assert len(moved) == 1
    with SessionReader(tmp_path / "run.h5") as session:
        actuator = parse_toml(session.header.config_toml)["actuator"]
        told = [event for event in session.events() if event.kind == "supervisor"]
        positions = session.positions()[1]
    assert [event.sample for event in told] == [0]
    assert "no supervisor can stop the stage of 'labs.zaber:ZaberStage'" in told[0].text
    assert actuator["source"] == "labs.zaber:ZaberStage"
    assert actuator["options"] == {"microstep": 0.047625}
    assert np.nanmax(positions) - np.nanmin(positions) == pytest.approx(4e-6, abs=0.1e-6)
    replays_without_its_drivers(tmp_path / "run.h5")


def replays_without_its_drivers(session):
    """A program that can import none of the drivers opens it, and finds every bit again."""
    session.with_suffix(".png").write_bytes(b"mine")  # which it would take its time to draw
    code = "import importlib.util as i; assert not i.find_spec('labs'); from app.cli import main; "
    for command in (["info", "--verify"], ["replay", "--headless"]):
        done = subprocess.run(
            [sys.executable, "-c", code + "main()", *command, str(session)],
            cwd=LABS.parents[1],
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
            encoding="utf-8",
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("source", "is_told"),
    [
        ("labs.zaber:ZaberStage", True),
        ("labs.mutants:Supervised", False),
        ("smc100", False),
        ("conex-cc-emulated", False),
        ("sim", False),
    ],
)
def test_a_stage_without_a_supervisor_is_told_before_the_run_begins(
    tmp_path, monkeypatch, capsys, source, is_told
):
    settings = config.load(None, [f"actuator.source={source}", "actuator.port=COM3", *QUICK])

    class NoRun:
        stays = True  # nobody asks it for more than to begin

        def start(self):
            raise UserError("enough")

    monkeypatch.setattr(prepared, "launched_or_made", lambda *_: NoRun())

    def make():
        return prepared.prepared_run(settings, tmp_path / "x.h5", 1.0)

    with pytest.raises(UserError, match="enough"):
        experiment.run_to_end(make, "", autostart=True, as_json=True)
    told = " ".join(capsys.readouterr().err.split())
    assert (f"no supervisor can stop the stage of '{source}'" in told) == is_told
    make = partial(make_bench, settings.forces, settings.camera, settings.actuator)
    if "emulated" not in source and source != "sim":
        findings = [*bench_check.check(settings, make, home=False, move_um=0)]
        assert ("supervisor" in [one.label for one in findings]) == is_told


def test_a_run_with_the_board_of_a_lab(tmp_path, monkeypatch):
    fake_ljm.install(monkeypatch, fake_ljm.Device(pressed, paced=True))
    outcome = whole_run(tmp_path / "run.h5", *LABJACK)
    assert outcome.state == "done", outcome.reason
    assert outcome.counts.samples_lost == 0
    assert outcome.counts.frames_lost == 0


# ---------------------------------------------------------------------- what the command finds


BROKEN = """
from labs.zaber import ZaberStage

class Late(ZaberStage):
    def set_velocity(self, velocity_m_s):
        self._ask(f"set maxspeed {round(velocity_m_s / self._step_m)}")
"""


def test_a_broken_contract_is_named(capsys, zaber, seconds, tmp_path, monkeypatch):
    (tmp_path / "late_stage.py").write_text(BROKEN, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))

    def pass_time(wanted):
        time.sleep(0.02)
        seconds[0] += wanted

    settings = [f"actuator.port={zaber.url}"]
    code, found = checked(capsys, "late_stage:Late", *settings, pass_time=pass_time)
    assert code == 1
    assert "um off where it should be" in found["it moves at about the velocity asked"]
    assert "was refused (BADCOMMAND)" in found["what is out of limits changes nothing"]


MISTAKES = {
    "NoLock": (LOCK, "it needs a lock around"),
    "Mixed": (LOCK, "a position of 0 mm came; it needs a lock around"),
    "Jog": (OWN_END, "its program was killed in a move of 2 s, and 4 s later it moves"),
    "SlowStop": (LOCK, "stop() took 3.0 s, 1 s is the most"),
    "OpenError": (CUT, "SerialException"),
    "SilentStop": (CUT, "stop() with its line cut was not refused with DeviceError"),
    "DeafStopper": (SUPERVISOR, "it moves 1 s after the stop() of its stopper()"),
    "UnsentStopper": (SUPERVISOR, "cannot pickle"),
}


@pytest.mark.parametrize("over", ["pty", "tcp"] if os.name == "posix" else ["tcp"])
def test_a_driver_of_the_program_keeps_the_contracts_of_its_process(over):
    line = SerialLine(Controller(FreeStage()), over, byte_s=10 / 57600)
    source = "drivers.stages.newport_stage:Smc100"
    settings = config.load(None, [f"actuator.source={source}", f"actuator.port={line.start()}"])
    names = [LOCK, OWN_END, SUPERVISOR, CUT]
    try:
        how = {"move": True, "pass_time": time.sleep, "only": names}
        found = {one.label: one for one in check("actuator", settings, **how)}
    finally:
        line.cut()
    assert list(found) == names
    wrong = {name: one.found for name, one in found.items() if not one.is_fine}
    assert list(wrong) == [CUT] * (os.name != "posix"), wrong


@pytest.mark.skipif(os.name != "posix", reason="another process reaches the line by its name")
@pytest.mark.parametrize("mistake", [*MISTAKES, "Supervised", "Example"])
def test_each_mistake_of_a_driver_is_found_by_the_contract_that_it_breaks(mistake):
    """On the clock of the wall, so that a thread of the driver's own has its time."""
    line = SerialLine(ZaberEmulator(time.monotonic), byte_s=10 / 115200)
    line.start()
    names, found = [LOCK, OWN_END, SUPERVISOR, CUT], {}
    broken, sentence = MISTAKES.get(mistake, (None, ""))
    source = f"labs.mutants:{mistake}"
    if mistake == "Example":
        source = "labs.zaber:ZaberStage"
    settings = config.load(None, [f"actuator.source={source}", f"actuator.port={line.url}"])
    try:
        for finding in check("actuator", settings, move=True, pass_time=time.sleep, only=names):
            found[finding.label] = finding
    finally:
        line.cut()
    assert list(found) == [name for name in CONTRACT_NAMES if name in names]
    wrong = {name: one.found for name, one in found.items() if one.needed and not one.is_fine}
    assert list(wrong) == [broken] * bool(broken), wrong
    assert sentence in wrong.get(broken, ""), wrong
    left = [name for name, one in found.items() if not one.needed]
    assert left == [SUPERVISOR] * ("topper" not in mistake and mistake != "Supervised")


@pytest.mark.parametrize(
    ("mistake", "name", "sentence"),
    [
        ("Millimetres", "its position lies within its travel", "its position is 12.5 m and its"),
        ("Nanometres", "it moves at about the velocity asked", "times what was asked; check the"),
        ("Fast", "it moves at about the velocity asked", "9.99 times what was asked; check the"),
    ],
)
def test_a_mistake_of_scale_is_told_once_and_as_such(
    capsys, zaber, seconds, mistake, name, sentence
):
    def pass_time(wanted):
        time.sleep(0.02)
        seconds[0] += wanted

    code = check_driver(
        f"labs.mutants:{mistake}",
        [f"actuator.port={zaber.url}"],
        move=True,
        as_json=True,
        pass_time=pass_time,
    )
    assert code == 1
    said = {one["name"]: one for one in json.loads(capsys.readouterr().out)["contracts"]}
    broken = {
        key: one["found"] for key, one in said.items() if one["needed"] and not one["is_fine"]
    }
    assert list(broken) == [name]
    assert sentence in broken[name]
    left = said["stop ends the motion now"]["found"]
    assert left == f"not tried, {name} is broken; mend that first"


@pytest.mark.parametrize(
    ("mistake", "sentence"),
    [("ListedPlace", "for its position"), ("NumberedMoves", "gave 0 for whether it moves")],
)
def test_an_answer_that_a_run_would_refuse_is_told_before_anything_moves(zaber, mistake, sentence):
    over = [f"actuator.source=labs.mutants:{mistake}", f"actuator.port={zaber.url}"]
    only = ["its position lies within its travel"]
    how = {"move": False, "pass_time": time.sleep, "only": only}
    (finding,) = check("actuator", config.load(None, over), **how)
    assert finding.needed
    assert not finding.is_fine
    assert sentence in finding.found


def test_what_is_no_driver_can_not_be_checked():
    how = {"move": False, "as_json": False}
    with pytest.raises(UserError, match=r"give it as package\.module:Class"):
        check_driver("smc100", (), **how)
    with pytest.raises(UserError, match="has none of the methods move_to, backlog, read"):
        check_driver("pathlib:PurePath", (), **how)
    with pytest.raises(UnknownDevice, match="cannot be imported"):
        check_driver("nowhere:Stage", (), **how)


STUCK = """
import threading


class Stuck:
    name, travel_limits_m, velocity_limit_m_s = "stuck stage", (0.0, 0.01), 1e-3

    def __init__(self, settings, clock):
        self.position_m = self.describe = lambda: 0.005
        self.home = self.stop = lambda: None
        self.is_moving = lambda: False

    def open(self): ...

    def set_velocity(self, velocity_m_s): ...

    def move_to(self, position_m): ...

    def close(self):
        threading.Event().wait(30)
"""


def test_a_driver_that_does_not_return_from_a_call_holds_up_no_check(capsys, tmp_path, monkeypatch):
    (tmp_path / "stuck.py").write_text(STUCK)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("app.cli.check_driver.STEP_PATIENCE_S", 0.2)
    monkeypatch.setattr("app.acquisition.watchdog.PATIENCE_S", 0.2)
    assert check_driver("stuck:Stuck", (), move=False, as_json=True) == 1
    said = [one["found"] for one in json.loads(capsys.readouterr().out)["contracts"]]
    broken = [found for found in said if "did not return from a call within 0.2 s" in found]
    assert len(broken) == 1
    assert said.index(broken[0]) == 1  # the first that closes its device; none after it is tried
    left = said[2:]
    assert left == ["not tried, the driver does not return from a call; mend that first"] * len(
        left
    )


def test_a_driver_that_is_never_made_is_waited_for_once(capsys, tmp_path, monkeypatch):
    never = STUCK.replace("settings, clock):\n", "settings, clock):\n        self.close()\n")
    (tmp_path / "never.py").write_text(never)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("drivers.sources.MAKE_S", 0.2)
    assert check_driver("never:Stuck", (), move=False, as_json=True) == 1
    first, *left = (one["found"] for one in json.loads(capsys.readouterr().out)["contracts"])
    assert "'never:Stuck' did not return within 0.2 s as it was made" in first
    assert set(left) == {"not tried, the driver does not return from a call; mend that first"}


LEAVES_A_PROGRAM = """
import pickle, subprocess, sys
work = "import sys, time; time.sleep(60); open(sys.argv[1], 'w')"
subprocess.Popen([sys.executable, "-c", work, sys.argv[2]])
pickle.dump(sys.argv[1], sys.stdout.buffer)
sys.stdout.flush()
sys.stdin.read()
"""


def test_what_a_driver_has_started_holds_up_no_check(tmp_path, monkeypatch):
    """It outlives the process that is killed, and has its pipes."""
    command = [sys.executable, "-c", LEAVES_A_PROGRAM, MOVES, str(tmp_path / "ended")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    process = subprocess.Popen(command, start_new_session=True, **pipes)
    monkeypatch.setattr("app.cli.check_driver.start_process", lambda *_: process)
    _dying_move(config.Config(), 0.0, 0.0)
    assert not (tmp_path / "ended").exists()
    os.killpg(process.pid, signal.SIGKILL)
