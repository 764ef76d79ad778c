"""Both palettes can be read, also by those who see fewer colours."""

import itertools
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import (
    QApplication,
    QCheckBox,
    QLabel,
    QStyle,
    QStyleOptionSpinBox,
)
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import look

from app.campaigns.state import RunState
from app.gui import theme
from app.gui.bench_cells import gauges
from app.gui.bench_draw import ForceBand
from app.gui.cells import STATES, Tone, tone_of
from app.gui.number_boxes import NumberBox
from app.gui.panels import LiveStrip
from app.gui.run_charts import TITLES
from app.gui.run_steps import StepStatus
from app.gui.theme import DARK, LIGHT, Palette
from app.gui.widgets import Choice, RowList, button, tool_button
from app.records.bench_view import DeviceState
from app.records.record_types import End
from app.report.side_by_side import BEING_RECORDED
from app.settings.sections import Config
from app.system.stopping import Stop

SPIN = QStyle.ComplexControl.CC_SpinBox
UP, DOWN = QStyle.SubControl.SC_SpinBoxUp, QStyle.SubControl.SC_SpinBoxDown

QUANTITIES = ("normal", "shear", "friction", "travel", "displacement", "stick")
CURVES = (*QUANTITIES, "model", "apparent")
# Machado, Oliveira, Fernandes (2009), severity 1, on linear light
DEUTAN = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
PROTAN = np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]])

PLAIN = {  # states without a tone of their own
    DeviceState.CLOSED,
    RunState.WAITING,
    StepStatus.TO_COME,
    End.UNFINISHED,
    Stop.NOT_CONNECTED,
}


def test_each_state_has_its_tone_by_the_word_that_it_has_now() -> None:
    """One whose word was changed elsewhere would lose its colour without a sign."""
    states = {*DeviceState, *RunState, *StepStatus, *End, *Stop}
    assert {state for state in states if tone_of(state) is Tone.NEUTRAL} == PLAIN
    of_runs = {"armed", "running", "stopping", BEING_RECORDED}
    assert {word for words in STATES.values() for word in words} == (states - PLAIN) | of_runs
    assert tone_of(Stop.FAILED) is tone_of(DeviceState.FAILED) is Tone.BAD
    assert tone_of(RunState.CUT) is tone_of(DeviceState.LOOK) is tone_of(Stop.SENT) is Tone.WARN
    assert tone_of(RunState.RUNNING) is tone_of(BEING_RECORDED) is Tone.BUSY


def linear(colour: str) -> np.ndarray:
    share = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)]) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    """By WCAG 2.1."""
    light, dark = sorted(
        (float(linear(c) @ (0.2126, 0.7152, 0.0722)) for c in (one, other)), reverse=True
    )
    return (light + 0.05) / (dark + 0.05)


def lab(light: np.ndarray) -> np.ndarray:
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(cv2.cvtColor(share.astype(np.float32)[None, None], cv2.COLOR_RGB2Lab)[0, 0])


@pytest.fixture(autouse=True, scope="module")
def as_before(qapp: QApplication) -> object:
    name, sheet = theme.now().name, qapp.styleSheet()
    yield
    theme.apply(qapp, name)
    qapp.setStyleSheet(sheet)


def test_the_measure_of_contrast_is_right() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("palette", [DARK, LIGHT], ids=lambda p: p.name)
def test_all_text_can_be_read(palette: Palette) -> None:
    for ground in (palette.panel, palette.window):
        for colour in (palette.text, palette.muted, *palette.tones.values()):
            assert contrast(colour, ground) >= 4.5, (colour, ground)
    for name in CURVES:  # their names stand beside them
        assert contrast(palette.role(name), palette.panel) >= 4.5, name
    assert contrast(palette.text, palette.button) >= 4.5
    assert contrast("#ffffff", "#c8202b") >= 4.5  # STOP MOTION


@pytest.mark.parametrize("palette", [DARK, LIGHT], ids=lambda p: p.name)
@pytest.mark.parametrize("sight", [np.eye(3), DEUTAN, PROTAN], ids=["all", "deutan", "protan"])
def test_curves_can_be_told_apart(palette: Palette, sight: np.ndarray) -> None:
    seen = {name: lab(np.clip(sight @ linear(palette.role(name)), 0, 1)) for name in CURVES}
    for one, other in itertools.combinations(CURVES, 2):
        assert np.linalg.norm(seen[one] - seen[other]) > 15, (one, other)


def test_sizes_follow_the_systems_font(qapp: QApplication) -> None:
    small, large = (
        [line for line in theme.style(DARK, size).splitlines() if "font-size" in line]
        for size in (9, 18)
    )
    assert small
    for one, other in zip(small, large, strict=True):
        sizes = [float(line.split("font-size: ")[1].split("pt")[0]) for line in (one, other)]
        assert sizes[1] == pytest.approx(2 * sizes[0], rel=0.02)


def colour_of(text: QLabel) -> str:
    return text.palette().windowText().color().name()


def test_a_quantity_has_its_colour_in_live_numbers_and_curves(qapp: QApplication) -> None:
    strip, gauge = LiveStrip(), ForceBand()
    gauge.show_gauge(gauges(None, Config())[0])
    strip.show()
    gauge.show()
    run = ScriptedRun(320, 240, frames=330).at(200)
    run.start()
    charts = look(run).charts
    lines = {key: [(line.columns[1], line.role) for line in charts[key].lines] for key in TITLES}
    for name, palette in (("light", LIGHT), ("dark", DARK)):
        theme.apply(qapp, name)
        p, q, ratio, travel, c = (colour_of(view.name) for view in strip.views)
        assert {colour_of(gauge.name), p} == {palette.normal}
        assert (q, ratio, travel, c) == (
            palette.shear,
            palette.friction,
            palette.travel,
            palette.stick,
        )
    assert lines["forces"] == [("P_N", "normal"), ("Q_N", "shear")]
    assert lines["loading"] == [("Q_N", "shear")]
    assert {role for _, role in lines["sticking"]} == {"stick", "model"}
    assert lines["displacement"][0] == ("ux_um", "displacement")
    radii = {guide.text: guide.role for guide in charts["traction"].guides}
    assert radii["c"] == radii["c fitted"] == "stick"
    strip.deleteLater()
    gauge.deleteLater()


def test_signs_are_drawn_wherever_the_program_is_installed(
    qtbot: QtBot, qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    box = QCheckBox("cut")
    qtbot.addWidget(box)
    box.setChecked(True)
    theme.apply(qapp, "light")
    usual = box.grab().toImage()
    icons = shutil.copytree(theme.ICONS, tmp_path / "O'Neil (x86)" / "icons")
    monkeypatch.setattr(theme, "ICONS", icons.as_posix())
    theme.apply(qapp, "light")
    assert box.grab().toImage() == usual


@pytest.mark.parametrize("look", ["dark", "light"])
def test_numbers_have_arrows_that_are_seen_and_work(
    qtbot: QtBot, qapp: QApplication, look: str
) -> None:
    theme.apply(qapp, look)
    box = NumberBox("Gain", "dB", (0.0, 60.0), 1)
    qtbot.addWidget(box)
    box.show()
    for part, wanted in ((UP, 2.0), (DOWN, 1.0)):
        option = QStyleOptionSpinBox()
        box.initStyleOption(option)
        if part is UP:
            box.setValue(1.0)
        rect = box.style().subControlRect(SPIN, option, part, box)
        image = box.grab(rect).toImage()
        greys = {
            image.pixelColor(x, y).name()
            for x in range(2, image.width() - 2)
            for y in range(2, image.height() - 2)
        }
        assert max(contrast(one, other) for one in greys for other in greys) > 3
        qtbot.mouseClick(box, Qt.MouseButton.LeftButton, pos=rect.center())
        assert box.value() == wanted


def test_the_window_changes_its_palette_while_it_is_open(qapp: QApplication) -> None:
    text = QLabel("P")
    text.show()
    for name, palette in (("light", LIGHT), ("dark", DARK)):
        theme.apply(qapp, name)
        assert theme.now() is palette
        assert palette.text == theme.now().text
        assert text.palette().windowText().color().name() == palette.text
    text.deleteLater()


def test_the_states_in_a_list_have_the_colours_of_the_look(
    qtbot: QtBot, qapp: QApplication
) -> None:
    listed = RowList(("run", "state"), "Runs", "None yet")
    qtbot.addWidget(listed)
    listed.put_row(0, ("a", "failed"), {}, {1: Tone.BAD})
    listed.show()
    for name, palette in (("light", LIGHT), ("dark", DARK)):
        theme.apply(qapp, name)
        assert listed.topLevelItem(0).foreground(1).color().name() == palette.tones[Tone.BAD]


@pytest.mark.parametrize("palette", [DARK, LIGHT], ids=lambda p: p.name)
def test_what_cannot_be_used_is_seen_to_be_off(
    qtbot: QtBot, qapp: QApplication, palette: Palette
) -> None:
    theme.apply(qapp, palette.name)
    number = NumberBox("Gain", "dB", (0.0, 60.0), 1)
    framed, bare = tool_button("Undo"), tool_button("Undo", style="")
    for one in (button("Undo"), framed, bare, Choice(["Undo"]), QCheckBox("Undo"), number):
        qtbot.addWidget(one)
        one.ensurePolished()
        of = QPalette.ColorGroup
        off, on = (one.palette().color(g, one.foregroundRole()) for g in (of.Disabled, of.Active))
        assert off.name() == palette.grid, one
        assert on.name() in (palette.text, palette.muted), one
