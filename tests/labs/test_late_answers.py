"""A sound driver whose device answers late, as `slipscope check-driver` tries it."""

import time

import pytest
from labs.zaber_emulator import ZaberEmulator

from app.cli.check_driver import check
from app.settings import config
from drivers.emulators.serial_line import SerialLine


@pytest.mark.parametrize(
    "name",
    ["what is out of limits changes nothing", "close stops and may come at any time and twice"],
)
def test_a_stage_that_answers_late_keeps_its_contracts(name):
    passed = []
    line = SerialLine(ZaberEmulator(lambda: time.monotonic() + sum(passed)), think_s=0.12)
    over = ["actuator.source=labs.zaber:ZaberStage", f"actuator.port={line.start()}"]
    how = {"move": True, "pass_time": passed.append, "only": [name]}
    try:
        (finding,) = check("actuator", config.load(None, over), **how)
    finally:
        line.cut()
    assert finding.is_fine, finding.found
