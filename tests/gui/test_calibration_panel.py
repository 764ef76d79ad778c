"""Calibrations in the window: from Measure, run by run, to a certificate that the bench uses."""

from __future__ import annotations

import threading
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest
from calibration.stage_speed import Speed
from PySide6.QtCore import QLocale, Qt
from PySide6.QtWidgets import QFileDialog, QLineEdit
from pytestqt.qtbot import QtBot
from set_up_hands import write
from short_run import RIGID
from window_hands import click, shown, wait_for_words

from analysis.options import Section
from app.calibrations.certifying import Evaluated, evaluated
from app.calibrations.synchronisation import SynchronisationOptions
from app.gui import calibration_panel
from app.gui.calibration_panel import AGE, CERTIFICATE, DUE, CalibrationPanel
from app.gui.run_factory import RunFactory
from app.gui.setting_row import SettingRow
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.quantities import Measurement
from app.settings.certificates import read_certificate
from app.settings.config import load

SMALL = (
    *RIGID,
    *("camera.width=64", "camera.height=64", "dic.box=20", "dic.threads=1", "stress.method=none"),
    "about.operator=Ana",
)


class TwoSpeeds(Speed):
    """Measures in two runs; a table gives what it always gives."""

    def gather(self, sources, options):
        if sources[0].suffix == ".csv":
            return {"time_s": np.arange(9.0), "position_m": np.arange(9.0) * 5e-6}
        return super().gather(sources, options)

    def fit(self, data, options):
        found = super().fit(data, options)
        more = Measurement("a value without uncertainty", "", 2e-6, unit="um")
        return replace(found, values=(*found.values, more))

    def plan(self, config, options):
        return 2 * super().plan(config, options)


class Still(Speed):
    """Whose data cannot be trusted."""

    name = "still"
    files = "SESSION.h5"

    def gather(self, sources, options):
        return {"time_s": np.arange(9.0), "position_m": np.zeros(9)}


@pytest.fixture
def window(qtbot: QtBot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MainWindow:
    monkeypatch.chdir(tmp_path)
    kinds = {"speed": TwoSpeeds(), "still": Still()}
    monkeypatch.setattr(calibration_panel, "KINDS", kinds)
    model = WindowModel(RunFactory(lambda _: None, pace=None), load(None, SMALL))
    made = shown(qtbot, MainWindow(model=model))
    made.go_to("calibration")
    return made


def panel_of(window: MainWindow) -> CalibrationPanel:
    assert window.calibration is not None
    return window.calibration


def choose(panel: CalibrationPanel, name: str) -> None:
    item = panel.list.findItems(name, Qt.MatchFlag.MatchExactly)[0]
    panel.list.setCurrentItem(item)


def chosen(window: MainWindow, name: str) -> CalibrationPanel:
    """The panel once a calibration is chosen."""
    panel = panel_of(window)
    choose(panel, name)
    return panel


def test_two_runs_make_a_certificate_and_use_gives_it_to_the_bench(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    panel = panel_of(window)
    own = window.model.config
    choose(panel, "speed")
    click(qtbot, panel.measure_button)
    qtbot.waitUntil(lambda: panel.found is not None)
    sessions = sorted(tmp_path.glob("calibration-speed-*.h5"))
    assert [path.name[-4] for path in sessions] == ["1", "2"]
    (path,) = tmp_path.glob("speed-*.zip")
    held = read_certificate(path)
    assert sorted(held.sources) == [one.name for one in sessions]
    assert held.operator == "Ana"
    velocity = held.settings["camera.pixel"]
    assert f"velocity v: {velocity:.2f}" in panel.values.text()
    assert f"camera.pixel = {velocity} µm\n" in f"{panel.values.text()}\n"
    assert not panel.picture.pixmap().isNull()
    assert window.model.config == own  # the runs had settings of their own
    click(qtbot, panel.use_button)
    item = panel.list.findItems("speed", Qt.MatchFlag.MatchExactly)[0]
    qtbot.waitUntil(lambda: item.text(CERTIFICATE) == path.name)
    assert window.model.config.camera.pixel == pytest.approx(velocity * 1e-6)
    assert window.model.config.calibration.certificates == (str(path),)
    assert (item.text(AGE), item.text(DUE)) == ("0 d", held.due)
    # a later one of the same calibration takes its place
    again = datetime.now(UTC) - timedelta(days=7)
    later = tmp_path / "later.zip"
    found = evaluated(Speed(), [path], Section())
    settings = {"camera.pixel": 4.0}
    certificate = msgspec.structs.replace(
        found.certificate, made=again.isoformat(), settings=settings
    )
    Evaluated(certificate, found.result, found.data, found.figure).write(later, overwrite=False)
    panel._show_found(calibration_panel.shown_certificate(later))
    panel.use()
    qtbot.waitUntil(lambda: item.text(CERTIFICATE) == "later.zip")
    assert window.model.config.camera.pixel == pytest.approx(4e-6)
    assert item.text(AGE) == "7 d"
    # nothing is shown beside the name of another
    choose(panel, "still")
    assert (panel.values.text(), panel.state.text()) == ("", "")
    assert panel.picture.pixmap().isNull()
    assert not panel.use_button.isEnabled()
    choose(panel, "speed")
    qtbot.waitUntil(lambda: "velocity v: " in panel.values.text())


def test_stop_ends_a_calibration_and_nothing_is_evaluated(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    panel = chosen(window, "speed")
    panel.measure()
    qtbot.waitUntil(lambda: bool(panel._measured))
    window.stop_motion()
    qtbot.waitUntil(lambda: not window._is_running() and not window._pending)
    qtbot.wait(200)
    assert not list(tmp_path.glob("*.zip"))
    assert panel.found is None


def test_stop_between_two_runs_calls_off_the_second(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    panel = chosen(window, "speed")
    window.model.ended.connect(lambda _: window.model.stop_pressed.emit())
    panel.measure()
    qtbot.waitUntil(lambda: bool(panel._measured))
    qtbot.wait(300)
    assert not window._is_running()
    assert not window._pending
    assert len(list(tmp_path.glob("*.h5"))) == 1


def test_nothing_is_measured_while_a_run_goes_on(qtbot: QtBot, window: MainWindow) -> None:
    panel = chosen(window, "speed")
    assert panel.measure_button.isEnabled()
    window.model.set_busy(True, is_live=True)
    assert not panel.measure_button.isEnabled()
    panel.measure()
    qtbot.wait(300)
    assert not panel._plan
    assert not window.model.is_lent
    window.model.set_busy(False)
    assert panel.measure_button.isEnabled()


def test_a_run_that_does_not_begin_arms_nothing_for_the_next_start(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unable(*_: object) -> None:
        raise OSError("the bench is switched off")

    panel, own = panel_of(window), window.model.config
    monkeypatch.setattr(window.model.factory, "run", unable)
    choose(panel, "speed")
    panel.measure()
    wait_for_words(qtbot, window, "the bench is switched off")
    assert not panel._plan
    assert window.model.config == own
    # nor one that is refused for what stands in the form
    monkeypatch.setattr(window, "go_to_refused", lambda: "P is no number")
    with qtbot.waitSignal(window.model.not_begun):
        panel.measure()
    assert not panel._plan
    assert (window.model.config, window.model.is_lent) == (own, False)


def test_stop_while_the_runs_are_planned_calls_them_off(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, may_go_on = panel_of(window), threading.Event()
    plan = TwoSpeeds.plan

    def slow(self, config, options):
        may_go_on.wait(60)
        return plan(self, config, options)

    monkeypatch.setattr(TwoSpeeds, "plan", slow)
    choose(panel, "speed")
    panel.measure()
    window.stop_motion()
    may_go_on.set()
    qtbot.wait(500)
    assert not panel._plan
    assert not window._pending
    assert not list(tmp_path.glob("*.h5*"))


def test_what_was_evaluated_is_shown_beside_its_own_name(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    panel = chosen(window, "speed")
    panel.take_files([_table(tmp_path)])
    choose(panel, "still")
    qtbot.waitUntil(lambda: panel.found is not None)
    assert panel.list.currentItem().text(0) == "speed"
    assert "velocity v: 5.00 ± 0.05" in panel.values.text()
    assert "a value without uncertainty: 2.00 µm\n" in panel.values.text()


def test_data_that_cannot_be_trusted_are_told_in_the_window(
    qtbot: QtBot, window: MainWindow, tmp_path: Path
) -> None:
    panel = chosen(window, "still")
    panel.take_files([])
    words = "the stage was to move, it stood still; let it move"
    wait_for_words(qtbot, window, words)
    assert not list(tmp_path.glob("*.zip"))


def test_several_files_are_evaluated_together(
    qtbot: QtBot, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, taken = panel_of(window), []
    monkeypatch.setattr(panel, "take_files", taken.append)
    for name in ("a.h5", "b.h5"):
        (tmp_path / name).touch()
    choose(panel, "speed")
    panel._ask_files()
    (dialog,) = panel.findChildren(QFileDialog)
    assert dialog.windowTitle() == "speed: SESSION.h5..."
    dialog.findChild(QLineEdit, "fileNameEdit").setText('"a.h5" "b.h5"')
    dialog.accept()
    assert taken == [[tmp_path / "a.h5", tmp_path / "b.h5"]]


def test_one_file_is_asked_for_where_one_is_evaluated_and_for_the_chosen_one_only(
    qtbot: QtBot, window: MainWindow
) -> None:
    panel = chosen(window, "still")
    click(qtbot, panel.files_button)
    (dialog,) = panel.findChildren(QFileDialog)
    assert dialog.fileMode() == QFileDialog.FileMode.ExistingFile
    choose(panel, "speed")
    assert not dialog.isVisible()


def test_what_is_no_certificate_or_no_option_is_told(qtbot: QtBot, window: MainWindow) -> None:
    panel = chosen(window, "speed")
    panel.take_files([Path("gone.h5")])
    wait_for_words(qtbot, window, "Calibration: gone.h5")


def test_an_option_typed_as_by_default_wins_over_that_of_a_certificate(
    qtbot: QtBot, window: MainWindow, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(Speed, "Options", SynchronisationOptions)
    found = evaluated(
        TwoSpeeds(), [_table(tmp_path)], SynchronisationOptions(time=30.0, common_signal=True)
    )
    found.write(tmp_path / "before.zip", overwrite=False)
    panel = panel_of(window)
    for name in ("still", "speed"):
        choose(panel, name)
    rows = {one.field.option.name: one for one in panel._rows}
    assert rows["time"].editor.placeholderText() == "20"
    for typed, expected in ((False, (30.0, True)), (True, (20.0, False))):
        if typed:
            write(qtbot, rows["time"].editor, "20")
            for _ in range(2):  # to the other state, and back
                rows["common_signal"].editor.click()
        panel.found = None
        panel.take_files([tmp_path / "before.zip"])
        qtbot.waitUntil(lambda: panel.found is not None)
        kept = panel.found.certificate.options
        assert (kept["time"], kept["common_signal"]) == expected


def _table(folder: Path) -> Path:
    table = folder / "table.csv"
    table.write_text("1")
    return table


def test_options_are_typed_and_chosen_and_what_cannot_be_used_is_said(
    qtbot: QtBot, model: WindowModel, said: list[str]
) -> None:
    panel = CalibrationPanel(model)
    qtbot.addWidget(panel)
    panel.show()
    choose(panel, "timing")
    kind = calibration_panel.KINDS["timing"]
    assert panel.options_of(kind) == kind.Options()
    rows = {one.field.option.name: one for one in panel.findChildren(SettingRow)}
    write(qtbot, rows["time"].editor, "30")
    rows["common_signal"].editor.click()
    before = kind.Options()
    asked = panel.options_of(kind)
    assert (before.time, asked.time) == (20.0, 30.0)
    assert asked.common_signal is not before.common_signal
    write(qtbot, rows["time"].editor, "long")
    panel.measure()
    assert "time must be a number" in said[-1]
    choose(panel, "forces")  # which has others
    qtbot.waitUntil(lambda: rows["time"] not in panel.findChildren(SettingRow))
    panel.setLocale(QLocale(QLocale.Language.German, QLocale.Country.Germany))
    choose(panel, "timing")
    (row,) = (one for one in panel._rows if one.field.option.name == "time")
    write(qtbot, row.editor, "0,5")
    assert panel.options_of(kind).time == 0.5
    assert row.field.text(0.5) == "0,5"  # as a default is shown in an empty field
