"""The settings of an evening, as an operator types them: by keyboard and mouse."""

from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QFileDialog,
    QLineEdit,
    QMainWindow,
    QMessageBox,
)
from pytestqt.qtbot import QtBot
from set_up_hands import open_table, steps_of, visible, write
from window_hands import click

from app.gui.bench_panel import BenchPanel
from app.gui.form import AS_SET, OWN_STEPS, STEPS_KEY
from app.gui.setup_panel import FREQUENT, SetupPanel
from app.gui.widgets import widget
from app.gui.window_model import WindowModel
from app.settings.config import load
from app.settings.sections import Config, RunSettings


def test_what_is_typed_is_for_the_next_run_and_a_wrong_value_is_corrected(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    load_row, travel = panel.row("run.normal_force"), panel.row("run.travel")
    write(qtbot, load_row.editor, "0.3")
    write(qtbot, travel.editor, "150", Qt.Key.Key_Return)
    assert model.config.run.normal_force == 0.3
    assert model.config.run.travel == pytest.approx(150e-6)
    assert load_row.name.text() == "● Load P"
    assert load_row.reset.isVisible()

    write(qtbot, load_row.editor, "12")
    assert model.config.run.normal_force == 0.3
    assert "at most 10 N; found 12" in load_row.sentence.text()
    qtbot.waitUntil(load_row.sentence.isVisible)
    assert load_row.editor.text() == "12"
    assert "One setting cannot be used as typed" in panel.refused.text()

    write(qtbot, load_row.editor, "0.4")
    assert model.config.run.normal_force == 0.4
    assert not load_row.sentence.isVisible()
    assert not panel.refused.isVisible()


def test_a_key_of_the_window_takes_what_was_typed_first(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    window = QMainWindow()
    qtbot.addWidget(window)
    window.setCentralWidget(panel)
    begun: list[float] = []
    QShortcut(QKeySequence(Qt.Key.Key_F5), window).activated.connect(
        lambda: begun.append(model.config.run.normal_force)
    )
    with qtbot.waitActive(window):
        window.show()
    write(qtbot, panel.row("run.normal_force").editor, "0.25", end=Qt.Key.Key_F5)
    assert begun == [0.25]
    window.takeCentralWidget()


def test_a_field_is_reset_by_its_button_and_by_a_key(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    row = panel.row("run.normal_force")
    for by_key in (False, True):
        write(qtbot, row.editor, "0.3", end=Qt.Key.Key_Return)
        if by_key:
            qtbot.keyClick(row.editor, Qt.Key.Key_R, Qt.KeyboardModifier.ControlModifier)
        else:
            click(qtbot, row.reset)
        assert model.config.run.normal_force == 0.5
        assert row.editor.text() == "0.5"
        assert not row.reset.isVisible()


def test_a_search_leaves_open_what_was_open(qtbot: QtBot, panel: SetupPanel) -> None:
    open_table(panel, "camera")
    panel.search.setText("exposure")
    open_table(panel, "camera")  # a click that closes it
    assert "camera.exposure" not in visible(panel)
    panel.search.clear()
    assert "camera.exposure" in visible(panel)


def test_a_click_on_a_name_puts_the_keys_into_its_row(qtbot: QtBot, panel: SetupPanel) -> None:
    row = panel.row("run.travel")
    assert not row.editor.hasFocus()
    click(qtbot, row.name)
    assert row.editor.hasFocus()
    assert panel.help.text().startswith("run.travel: ")


def test_search_and_only_changed(qtbot: QtBot, panel: SetupPanel) -> None:
    assert not visible(panel)  # the tables are closed
    qtbot.keyClicks(panel.search, "exposure ms")
    assert "camera.exposure" in visible(panel)
    assert not {key for key in visible(panel) if key.startswith("run.")}
    found = panel.settings.rows("camera.exposure")[-1].editor
    qtbot.waitUntil(lambda: panel.rect().contains(found.mapTo(panel, found.rect().center())))
    panel.search.clear()
    write(qtbot, panel.row("run.velocity").editor, "7")
    panel.only_changed.click()
    assert visible(panel) == {"run.velocity"}
    panel.only_changed.click()
    assert not visible(panel)
    open_table(panel, "run")
    assert "run.velocity" in visible(panel)


def test_both_rows_of_a_setting_show_it(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    open_table(panel, "run")
    rows = panel.settings.rows("run.velocity")
    assert len(rows) == 2
    write(qtbot, rows[1].editor, "8")
    assert rows[0].editor.text() == "8"
    assert model.config.run.velocity == pytest.approx(8e-6)


def test_choices_and_checks(qtbot: QtBot, panel: SetupPanel, model: WindowModel) -> None:
    preset = panel.row("dic.preset").editor
    preset.setFocus()
    qtbot.keyClicks(preset, "finest")
    assert model.config.dic.box == 38
    assert panel.row("dic.box").editor.text() == "38"
    preset.setFocus()
    qtbot.keyClicks(preset, "custom")  # which is none: the settings stay, and so does their name
    assert preset.currentText() == "finest"
    write(qtbot, panel.row("dic.box").editor, "38.0")
    assert panel.row("dic.box").editor.text() == "38"
    open_table(panel, "stress")
    panel.row("stress.field").editor.click()
    assert model.config.stress.field


def test_the_protocol_is_chosen_and_then_of_its_own(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    choice = panel.row(STEPS_KEY).editor
    assert choice.currentText() == AS_SET
    assert steps_of(panel)[-1] == "4  drive 190 µm at 5 µm/s · 38 s"
    choice.setFocus()
    qtbot.keyClicks(choice, "slide")
    chosen = load(Path("slide-hold-slide")).run.steps
    assert model.config.run.steps == chosen
    click(qtbot, panel.protocol.remove)
    assert model.config.run.steps == chosen[:-1]
    assert choice.currentText() == OWN_STEPS


def test_what_the_operator_says_of_the_run_is_in_its_settings(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    write(qtbot, panel.row("about.sample").editor, "PDMS 7")
    write(qtbot, panel.row("about.operator").editor, "Ada")
    write(qtbot, panel.row("about.note").editor, "new lens\rdry")
    about = model.config.about
    assert (about.sample, about.operator, about.note) == ("PDMS 7", "Ada", "new lens\ndry")


def test_the_session_is_named_and_its_full_path_shown(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel, tmp_path: Path
) -> None:
    def says(words: str) -> None:
        qtbot.waitUntil(lambda: words in panel.place.text())

    says("named by date and time")
    write(qtbot, panel.session, "P0.5N")
    assert model.session == Path("P0.5N.h5")
    says(f"{tmp_path / 'P0.5N.h5'} is free")
    (tmp_path / "P0.5N.h5").touch()
    model.set_busy(True)
    says(f"{tmp_path / 'P0.5N-2.h5'} is the next free name")
    write(qtbot, panel.session, "nowhere/x")
    says("the folder nowhere does not exist")
    write(qtbot, panel.row("run.velocity").editor, "6")
    assert "the folder nowhere does not exist" in panel.place.text()
    assert panel.session.text() == "nowhere/x"
    assert model.session == Path("P0.5N.h5")
    write(qtbot, panel.session, "")
    assert model.session is None


def test_save_and_load_by_the_dialogs(
    qtbot: QtBot,
    panel: SetupPanel,
    model: WindowModel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    said: list[str],
) -> None:

    def choose() -> None:
        dialog = panel.findChildren(QFileDialog)[-1]
        assert not dialog.isModal()  # STOP MOTION stays within reach
        dialog.fileSelected.emit(str(tmp_path / "mine.toml"))
        dialog.close()
        panel.activateWindow()
        qtbot.waitUntil(panel.isActiveWindow)

    write(qtbot, panel.row("run.normal_force").editor, "0.3")
    click(qtbot, panel.save_button)
    choose()
    qtbot.waitUntil(lambda: "all as in mine.toml" in panel.compared.text())
    assert load(tmp_path / "mine.toml") == model.config
    write(qtbot, panel.row("run.normal_force").editor, "0.7")
    assert "1 not as in mine.toml" in panel.compared.text()
    panel.load_menu.menu().actions()[0].trigger()
    choose()
    qtbot.waitUntil(lambda: model.config.run.normal_force == 0.3)
    (tmp_path / "mine.toml").write_text("[run]\nvelocity = 'fast'")
    panel.load_menu.menu().actions()[0].trigger()
    choose()
    qtbot.waitUntil(lambda: "The settings stay as they are" in said[-1])
    assert model.config.run.normal_force == 0.3
    assert "run.velocity must be a number" in said[-1]


def test_a_settings_file_is_not_replaced_without_a_question(
    qtbot: QtBot, panel: SetupPanel, tmp_path: Path
) -> None:
    (there := tmp_path / "bench.toml").write_text("precious")
    click(qtbot, panel.save_button)
    (dialog,) = panel.findChildren(QFileDialog)
    asked: list[str] = []

    def refuse() -> None:
        if isinstance(box := QApplication.activeModalWidget(), QMessageBox):
            asked.append(box.text())
            box.reject()

    timer = widget(QTimer, dialog, interval=5, timeout=refuse)
    timer.start()
    line = dialog.findChild(QLineEdit)
    line.setText("bench")
    qtbot.keyClick(line, Qt.Key.Key_Return)
    assert len(asked) == 1
    assert "bench.toml already exists" in asked[0]
    assert dialog.isVisible()
    dialog.close()
    qtbot.wait(20)
    assert there.read_text() == "precious"


def test_what_differs_from_a_recorded_run_is_marked_and_can_be_taken(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel, said: list[str]
) -> None:
    panel.compare(Path("old.h5"))
    qtbot.waitUntil(lambda: "1 not as in old.h5" in panel.compared.text())
    assert visible(panel) == {"run.normal_force"}
    row = panel.row("run.normal_force")
    assert "old.h5: 0.2 N" in row.reset.toolTip()
    click(qtbot, row.reset)
    assert model.config.run.normal_force == 0.2
    panel.compare(Path("new.h5"))
    qtbot.waitUntil(lambda: bool(said))
    assert said == ["The settings were not compared: new.h5: not a session"]


def test_settings_from_elsewhere_are_shown_and_what_was_refused_is_forgotten(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    row = panel.row("run.normal_force")
    write(qtbot, row.editor, "12")
    model.set_config(replace(model.config, run=RunSettings(normal_force=0.9)))
    assert row.editor.text() == "0.9"
    assert not row.sentence.isVisible()
    assert not panel.busy.isVisible()
    model.set_busy(True)
    assert panel.busy.isVisible()


def test_another_driver_brings_options_of_its_own(panel: SetupPanel, model: WindowModel) -> None:
    panel.search.setText("camera latency")
    assert not visible(panel)
    model.set_config(load(None, ("camera.source=labs.webcam:Webcam",)))
    assert visible(panel) == {"camera.options.latency"}
    model.set_config(Config())
    assert not visible(panel)


def test_it_fits_a_narrow_dock(panel: SetupPanel) -> None:
    open_table(panel, "run")
    shown = [row for row in panel.settings.rows() if row.editor.isVisible()]
    assert len(shown) > 15
    for row in shown:
        right = row.reset.mapTo(panel, row.reset.rect().bottomRight()).x()
        assert right < 340, row.field.key


# ------------------------------------------------------------------ languages, keys and the wheel


def test_numbers_are_as_the_language_has_them(
    german: None, qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    load, box = panel.row("run.normal_force").editor, BenchPanel(model).exposure
    assert load.text() == "0,5"
    assert box.text().startswith("10,00")
    for typed, is_now in (("0,7", 0.7), ("0.25", 0.25), ("6,9813e-1 N", 0.69813)):
        write(qtbot, load, typed)
        assert model.config.run.normal_force == is_now
        assert not panel.refusal()
    assert load.text() == "0,69813"
    write(qtbot, load, "1.000,5")
    assert 'found "1.000.5"' in panel.refusal() or "found" in panel.refusal()
    assert load.text() == "1.000,5"
    write(qtbot, load, "0,5")
    open_table(panel, "forces")
    write(qtbot, panel.row("forces.zero").editor, "0,125, -1")
    assert model.config.forces.zero == (0.125, -1.0)
    assert panel.row("forces.zero").editor.text() == "0,125, -1"


def test_a_number_keeps_its_last_digit(qtbot: QtBot, panel: SetupPanel, model: WindowModel) -> None:
    open_table(panel, "camera")
    pixel = panel.row("camera.pixel").editor
    write(qtbot, pixel, "6.98131234567")
    assert pixel.text() == "6.98131234567"
    assert model.config.camera.pixel == pytest.approx(6.98131234567e-6, rel=1e-15)


def test_the_wheel_scrolls_the_rows_and_changes_none(
    qtbot: QtBot, panel: SetupPanel, model: WindowModel
) -> None:
    open_table(panel, "run")
    before, choice = model.config, panel.row("dic.preset").editor
    bar = panel.settings.verticalScrollBar()
    place = choice.mapTo(panel, choice.rect().center())
    QTest.wheelEvent(panel.windowHandle(), QPointF(place), QPoint(0, -120))
    qtbot.waitUntil(lambda: bar.value() > 0)
    assert model.config == before


def test_tab_goes_from_row_to_row_and_out_of_the_list(qtbot: QtBot, panel: SetupPanel) -> None:
    open_table(panel, "about")
    qtbot.waitUntil(lambda: not panel.settings._tab_order.isActive())
    panel.row("run.normal_force").editor.setFocus()
    seen = []
    for _ in range(60):
        seen.append(QApplication.focusWidget())
        qtbot.keyClick(QApplication.focusWidget(), Qt.Key.Key_Tab)
    first, last = map(seen.index, (panel.row(STEPS_KEY).editor, panel.protocol.remove))
    assert last == first + 4 + 5  # the steps, and the buttons below that act on them
    below = [one.mapTo(panel, QPoint()).y() for one in seen[first : last + 1]]
    assert below == sorted(below)
    rows = {row.editor: row for row in panel.settings.rows()}
    keys = [rows[one].field.key for one in seen if one in rows]
    assert keys[:6] == [*FREQUENT, STEPS_KEY]
    at = keys.index("about.note")
    assert keys[at : at + 4] == ["about.note", "about.sample", "about.operator", "about.note"]
    assert panel.search in seen
