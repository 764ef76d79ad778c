"""Drivers that `slipscope check-driver` can hardly try."""

import json
import os
import threading
import time
from types import SimpleNamespace

import pytest
from labs.zaber_emulator import ZaberEmulator

from app.cli.check_driver import check, check_driver
from app.settings import config
from drivers.emulators.serial_line import SerialLine


def checked(capsys, source):
    """Exit code of `slipscope check-driver`, and what it says of each contract."""
    code = check_driver(source, (), move=False, as_json=True)
    said = json.loads(capsys.readouterr().out)
    return code, {one["name"]: one["found"] for one in said["contracts"] if not one["is_fine"]}


@pytest.mark.skipif(os.name != "posix", reason="the line is cut as an open file")
def test_a_stage_that_keeps_its_dead_port_is_named():
    line = SerialLine(ZaberEmulator(time.monotonic))
    over = ["actuator.source=labs.mutants:KeptPort", f"actuator.port={line.start()}"]
    how = {"move": False, "pass_time": time.sleep, "only": ["a dead line is a device error"]}
    try:
        (finding,) = check("actuator", config.load(None, over), **how)
    finally:
        line.cut()
    assert "the first lets go of the port, even if stop() fails" in finding.found


class Unmade(SimpleNamespace):
    """A stage that searches its device as it is made, which no driver may."""

    def __init__(self, settings, clock):
        threading.Event().wait(20)

    move_to = open = close = None


class Nameless(SimpleNamespace):
    """A stage that says what it is in numbers."""

    name, travel_limits_m, velocity_limit_m_s = b"stage 5", (0.0, 0.01), 1e-3

    def __init__(self, settings, clock):
        methods = ("stop", "home", "set_velocity", "position_m", "is_moving")
        super().__init__(describe=lambda: 5, **dict.fromkeys(methods, lambda *_: None))

    def open(self): ...

    def close(self): ...

    def move_to(self, position_m): ...


def test_a_driver_that_is_never_made_holds_up_no_check(capsys, monkeypatch):
    monkeypatch.setattr("app.cli.check_driver.STEP_PATIENCE_S", 0.2)
    code, found = checked(capsys, "labs.test_unfit_drivers:Unmade")
    assert code == 1
    told = "labs.test_unfit_drivers:Unmade: it did not return from a call within 0.2 s; "
    assert found["it is an actuator"].startswith(told)
    assert found["it says what it is"].startswith("not tried, the driver does not return")


def test_what_a_driver_says_of_itself_is_text(capsys):
    code, found = checked(capsys, "labs.test_unfit_drivers:Nameless")
    assert code == 1
    assert found["it is an actuator"] == "its name is b'stage 5', not a text"
    assert found["it says what it is"] == "describe() is 5, not a text"
