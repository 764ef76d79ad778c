"""The time line draws times, states and the frame that is shown where they were, and the scale of a
force its trace.
"""

from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtGui import QColor
from pytestqt.qtbot import QtBot

from app.evaluation.timeline import ContactState, Stretch, Timeline
from app.gui import theme
from app.gui.bench_cells import Gauge
from app.gui.bench_draw import BAR_PX, TRACE_PX, ForceScale
from app.gui.time_strip import BAND_PX, EDGE_PX, TimeStrip

RATE, START, END, EXPOSURE = 100.0, 370, 1000, 40


@pytest.fixture
def strip(qtbot: QtBot) -> TimeStrip:
    """Ten frames of ten seconds, of which the drive begins after 3.7 s; 0.4 px for a sample."""
    made = TimeStrip()
    qtbot.addWidget(made)
    made.resize(400 + 2 * EDGE_PX, made.height())
    states = (Stretch(ContactState.STICK, START, 600), Stretch(ContactState.SLIDE, 600, END))
    frames = np.arange(10)
    is_analysed = np.ones(10, np.bool_)
    line = Timeline(frames, 100 * frames, is_analysed, RATE, EXPOSURE, START, END, states, ())
    made.show_timeline(line)
    made.show_frame(5)
    return made


def rows(strip: TimeStrip, y: int) -> list[QColor]:
    image = strip.grab().toImage()
    return [image.pixelColor(x, y) for x in range(image.width())]


def test_times_count_from_the_start_of_the_drive(strip: TimeStrip) -> None:
    colours = rows(strip, EDGE_PX + BAND_PX + 1)
    ground = colours[2]
    ticks = [x for x, colour in enumerate(colours) if colour != ground]
    cursor = EDGE_PX + 0.4 * (500 + EXPOSURE / 2)
    at = {EDGE_PX + 0.4 * (START + k * RATE) for k in (-2, 0, 2, 4, 6)}
    for x in at:
        assert min(abs(x - tick) for tick in ticks) <= 1, x
    assert all(min(abs(x - tick) for x in (*at, cursor)) <= 4 for tick in ticks)


def test_the_frame_that_is_shown_is_at_the_middle_of_its_exposure(strip: TimeStrip) -> None:
    white = [x for x, c in enumerate(rows(strip, 4)) if c.lightness() > 250]
    assert white
    assert np.mean(white) == pytest.approx(EDGE_PX + 0.4 * (500 + EXPOSURE / 2) - 0.5, abs=1)


def test_what_is_pointed_at_is_told_in_the_time_of_the_drive(strip: TimeStrip) -> None:
    text = strip.describe(EDGE_PX + 0.4 * 490)
    assert text == "t = 1.20 s, frame 5: stick"
    assert strip.describe(EDGE_PX + 0.4 * 610).endswith("slide")


def test_the_trace_of_a_force_that_grows_rises_to_its_end(qtbot: QtBot) -> None:
    scale, times = ForceScale(), np.linspace(-10.0, 0.0, 100)
    qtbot.addWidget(scale)
    gauge = Gauge("P", "normal", 0.0, 2.0, (0.9, 1.1), (1.9,))
    scale.show_gauge(replace(gauge, time_s=times, history=times))
    scale.resize(200, scale.height())
    image, own = scale.grab().toImage(), QColor(theme.now().role("normal"))
    began, middle, ended = (
        min(y for y in range(BAR_PX, scale.height()) if image.pixelColor(x, y) == own)
        for x in (1, 100, 198)
    )
    assert began > middle > ended
    assert began - ended == pytest.approx(0.9 * (TRACE_PX - 4), abs=2)
