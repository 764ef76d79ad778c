"""What the account of a run and the line below the window show of it."""

from dataclasses import replace

from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun

from app.gui.health_panel import HealthPanel, HealthStrip
from app.gui.source import setup_of
from app.gui.view_state import DisplayStatistics, read, resolve


def test_health_names_losses_exposures_and_the_age_of_what_is_seen(
    qtbot: QtBot, run: ScriptedRun
) -> None:
    reading = read(run.at(50), 0, display=DisplayStatistics(shown=12, delay_s=0.030))
    told = {"exposures": 49, "losses": "2 × no image came in 40 ms", "image_age_s": 0.052}
    counts = replace(reading.health.counts, frames_lost=2)
    reading = replace(reading, health=replace(reading.health, counts=counts, **told))
    view = resolve(setup_of(run), reading, None)
    panel, strip = HealthPanel(), HealthStrip()
    for part in (panel, strip):
        qtbot.addWidget(part)
        part.show_view(view)
    cells = {cell.name.text(): cell for cell in panel.cells.views}
    assert cells["triggers"].detail.text() == "49 exposed"
    assert cells["shown"].value.text() == "12"
    assert (view.screen.value, view.screen.unit) == ("82", "ms")
    assert told["losses"] in cells["frames lost"].toolTip()
    assert told["losses"] in strip.sentence.text()
