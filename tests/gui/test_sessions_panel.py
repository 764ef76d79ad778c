"""An operator with recorded sessions: drops, opens, compares, analyses again and exports them."""

import math
import shutil
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import short_run
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent, QGuiApplication
from PySide6.QtWidgets import QLabel, QMenu
from session.session_material import SHAPE, copy_recording, make_writer
from set_up_hands import write
from whole_runs import done
from window_hands import click

from app.files.kinds import EXPORTS
from app.gui.comparison_view import ComparisonView
from app.gui.memory import WindowMemory
from app.gui.run_factory import RunFactory
from app.gui.session_forms import AnalysisForm
from app.gui.sessions_panel import SessionsPanel
from app.gui.window_model import WindowModel
from app.records.record_types import Samples
from app.replay import archive
from app.report.side_by_side import colours
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from app.settings.sections import Config
from drivers.protocols import Frame

LEFT = Qt.MouseButton.LeftButton
SHORT = (*short_run.SHORT, "stress.method=none", "dic.threads=1")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Two runs: 0.03 N to the end, and 0.02 N that the operator ended."""
    folder = tmp_path_factory.mktemp("evening")
    done(live.make_run(config.load(None, SHORT), folder / "load-30.h5", pace=None))
    settings = config.load(None, (*SHORT, "run.normal_force=0.02"))
    run = live.make_run(settings, folder / "load-20.h5", pace=None)
    run.start()
    while run.health().counts.frames_received < 40:
        time.sleep(0.01)
    run.request_stop("the operator ended the run")
    assert run.wait(400).state == "done"
    return folder


@pytest.fixture
def folder(recorded, tmp_path):
    for path in recorded.glob("*.h5"):
        shutil.copy(path, tmp_path / path.name)
    (tmp_path / "notes.h5").write_bytes(b"no session")
    (tmp_path / "readme.txt").write_text("no session either")
    return tmp_path


@pytest.fixture
def panel(qtbot):
    made = []
    model = WindowModel(RunFactory(made.append), Config())
    panel = SessionsPanel(model)
    panel.asked, panel.made = [], made
    model.session_asked.connect(panel.asked.append)
    panel.resize(620, 760)
    with qtbot.waitExposed(panel):
        panel.show()
    yield panel
    for view in panel.comparisons:
        view.close()
        view.deleteLater()
    panel.close()
    panel.deleteLater()


def drop(panel, *paths):
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(path)) for path in paths])
    action, no_keys = Qt.DropAction.CopyAction, Qt.KeyboardModifier.NoModifier
    panel.dropEvent(QDropEvent(QPointF(50, 50), action, data, LEFT, no_keys))


def rows(panel):
    items = [panel.list.topLevelItem(k) for k in range(panel.list.topLevelItemCount())]
    return {item.text(0): [item.text(k) for k in range(1, 5)] for item in items}


def listed(qtbot, panel, count):
    qtbot.waitUntil(
        lambda: len(rows(panel)) == count and all(row[0] != "…" for row in rows(panel).values())
    )
    return rows(panel)


def choose(qtbot, panel, *names):
    """Click on rows of the list, with Ctrl from the second on."""
    for k, name in enumerate(names):
        item = panel.list.findItems(name, Qt.MatchFlag.MatchExactly, 0)[0]
        place = panel.list.visualItemRect(item).center()
        key = Qt.KeyboardModifier.ControlModifier if k else Qt.KeyboardModifier.NoModifier
        qtbot.mouseClick(panel.list.viewport(), LEFT, key, place)


def listed_and_chosen(qtbot, panel, folder, *names):
    """List the three files of a folder, and choose some."""
    panel.list_folder(folder)
    listed(qtbot, panel, 3)
    choose(qtbot, panel, *names)


@pytest.mark.slow
def test_a_folder_that_is_dropped_is_listed_with_state_load_and_friction(qtbot, panel, folder):
    drop(panel, folder)
    found = listed(qtbot, panel, 3)
    assert found["load-30.h5"][:2] == ["complete", "0.030"]
    mu, sign, sd = found["load-30.h5"][2].split()
    assert abs(float(mu) - 0.93) < 0.03
    # the zeros of P and of Q, 1 mN of 30 mN each, make it uncertain by 5 %
    assert (sign, float(sd)) == ("±", pytest.approx(0.05, abs=0.006))
    assert found["load-20.h5"][0] == "stopped"
    assert found["notes.h5"] == ["not readable", "–", "–", ""]
    assert str(folder) in panel.where.text()


def test_an_empty_folder_is_said_to_be_empty_until_another_is_listed(
    qtbot, panel, folder, tmp_path_factory
):
    drop(panel, tmp_path_factory.mktemp("empty"))
    qtbot.waitUntil(lambda: "there are no sessions in this folder" in panel.where.text())
    drop(panel, folder)
    listed(qtbot, panel, 3)
    texts = [text.text() for text in panel.findChildren(QLabel) if text.isVisible()]
    assert not [text for text in texts if "no sessions" in text]


def test_a_form_for_a_session_of_a_long_name_fits_a_narrow_dock(qtbot, panel, folder):
    name = "calibration-force-noise-20261127-051938-1.h5"
    shutil.copy(folder / "load-20.h5", folder / name)
    drop(panel, folder)
    listed(qtbot, panel, 4)
    choose(qtbot, panel, name)
    for act, form in ((panel.analyse, panel.analysis_form), (panel.export, panel.export_form)):
        click(qtbot, act)
        qtbot.waitUntil(lambda form=form: form.isVisible() and name in form.heading.text())
        qtbot.wait(100)  # until all is laid out
        assert panel.minimumSizeHint().width() <= 318  # that of the docks of a window of 1366 px


def test_a_session_that_is_dropped_is_played_and_stands_among_the_recent(qtbot, panel, folder):
    drop(panel, folder / "load-30.h5")
    qtbot.waitUntil(lambda: panel.asked == [folder / "load-30.h5"])
    listed(qtbot, panel, 3)
    assert panel.list.chosen() == [folder / "load-30.h5"]
    assert WindowMemory().recent("session") == [folder / "load-30.h5"]
    menu = panel.recent.menu()
    assert isinstance(menu, QMenu)
    menu.aboutToShow.emit()
    menu.actions()[0].trigger()
    assert panel.asked == [folder / "load-30.h5"] * 2


def test_enter_and_double_click_play_the_chosen_session(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-20.h5")
    panel.list.setFocus()
    qtbot.keyClick(panel.list, Qt.Key.Key_Return)
    assert panel.asked == [folder / "load-20.h5"]
    click(qtbot, panel.play_button)
    assert panel.asked == [folder / "load-20.h5"] * 2


def test_two_sessions_are_compared(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-20.h5")
    assert not panel.compare_button.isEnabled()
    choose(qtbot, panel, "load-20.h5", "load-30.h5")
    click(qtbot, panel.compare_button)
    qtbot.waitUntil(lambda: len(panel.comparisons) == 1)
    view = panel.comparisons[0]
    table = view.table
    cells = {table.item(k, 0).text(): k for k in range(table.rowCount())}
    load = cells["normal force"]
    order = {one.name: 2 + k for k, one in enumerate(view.sessions)}
    assert table.item(load, order["load-20"]).text().startswith("0.020")
    assert table.item(load, order["load-30"]).text().startswith("0.030")
    first, last = (float(table.item(load, k).text()) for k in (2, 3))
    difference = float(table.item(load, 4).text().replace("−", "-"))
    assert difference == pytest.approx(last - first, abs=2e-4)
    # the same numbers, unrounded, as the session has them
    click(qtbot, view.copy)
    text = QGuiApplication.clipboard().text()
    with SessionReader(folder / "load-30.h5") as session:
        assert f"{session.outcome.summary.mu_s:.9g}" in text
    assert len(set(view.colours)) == 2
    # a stage that nothing read is said to be v t
    first, last = view.sessions
    for is_steady, label in (
        (False, "travel δ (µm)"),
        (True, f"travel δ (µm); v t in {last.name}"),
    ):
        shown = ComparisonView([first, replace(last, is_steady=is_steady)])
        qtbot.addWidget(shown)
        assert shown.loading.plot.chart.x_label == label
    long = [replace(first, path=Path(f"{n}_{20 * 'long_'}.h5")) for n in range(5)]
    shown = ComparisonView(long)
    qtbot.addWidget(shown)
    assert shown.minimumSizeHint().width() < 1000
    view.close()
    qtbot.waitUntil(lambda: not panel.findChildren(ComparisonView))  # nothing of it is kept
    assert not panel.comparisons


@pytest.mark.parametrize(
    ("loads_n", "count"),
    [
        ((0.5, 0.30002, 0.3), 3),  # measured ones of a load are never the same
        ((0.5, 0.3, 0.3), 3),
        ((0.5, 0.3, 0.1), 3),
        ((0.5, 0.50002), 2),
        ((0.5, math.nan, 0.3), 3),
        ((0.5,), 1),
        ((), 0),
    ],
)
def test_sessions_are_told_apart_by_their_colours(loads_n, count):
    assert len(set(colours(loads_n))) == len(colours(loads_n)) == count


def test_a_file_that_is_no_session_gives_a_sentence(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5", "notes.h5")
    click(qtbot, panel.compare_button)
    qtbot.waitUntil(lambda: "notes.h5" in panel.said.text() and "Reading" not in panel.said.text())
    assert not panel.comparisons


def test_another_analysis_is_saved_and_shown_beside_the_recorded_one(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5")
    click(qtbot, panel.analyse)
    form = panel.analysis_form
    assert form.isVisible()
    output = folder / "load-30-analysis.h5"
    assert form.where.text() == str(output)
    write(qtbot, form.box, "28")
    qtbot.keyClicks(form.others, "sample.young_modulus=3")
    click(qtbot, form.begin_button)
    assert not form.begin_button.isEnabled()
    qtbot.waitUntil(lambda: len(panel.comparisons) == 1)
    with SessionReader(output) as session:
        settings = session.header.config_toml
    assert "box = 28" in settings
    assert "young_modulus = 3" in settings
    assert [one.name for one in panel.comparisons[0].sessions] == ["load-30", "load-30-analysis"]
    assert str(output) in panel.said.text()
    assert listed(qtbot, panel, 4)["load-30-analysis.h5"][0] == "analysis of load-30.h5"
    assert len(panel.made) == 1  # so that the command reports and ends it
    assert len(set(panel.comparisons[0].colours)) == 2  # of one load, told apart
    assert form.heading.text() == "Analyse load-30.h5 again"
    qtbot.waitUntil(lambda: form.file.text() == "load-30-analysis-2.h5")


def test_another_session_that_is_chosen_meanwhile_begins_no_second_analysis(qtbot, folder):
    form = AnalysisForm()
    qtbot.addWidget(form)
    form.show_session(folder / "load-30.h5")
    form.begin("load-30.h5 is being analysed again")
    form.show_session(folder / "load-20.h5")
    assert form.heading.text() == "load-30.h5 is being analysed again …"  # which Stop ends
    assert not form.begin_button.isEnabled()
    form.end()
    assert form.begin_button.isEnabled()
    assert form.heading.text() == "Analyse load-20.h5 again"


def test_a_setting_that_no_analysis_may_change_is_refused_by_name(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5")
    click(qtbot, panel.analyse)
    qtbot.keyClicks(panel.analysis_form.others, "run.travel=99")
    qtbot.keyClick(panel.analysis_form.others, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: "run.travel is 22" in panel.said.text())
    assert panel.analysis_form.begin_button.isEnabled()
    assert sorted(path.name for path in folder.glob("*.h5")) == [
        "load-20.h5",
        "load-30.h5",
        "notes.h5",
    ]


@pytest.mark.parametrize(
    ("typed", "settings"),
    [
        ("", []),
        (" stress.method=none  dic.box=30 ", ["stress.method=none", "dic.box=30"]),
        (
            'dic.region=["inside 1 2 30 4 30 40"] about.note="two words',
            ['dic.region=["inside 1 2 30 4 30 40"]', 'about.note="two words'],
        ),
        (
            'calibration.certificates=["a.zip", "b.zip"] dic.step = 5',
            ['calibration.certificates=["a.zip", "b.zip"]', "dic.step = 5"],
        ),
    ],
)
def test_other_settings_of_an_analysis_may_have_spaces(qtbot, typed, settings):
    form = AnalysisForm()
    qtbot.addWidget(form)
    form.others.setText(typed)
    assert form.overrides() == settings


def test_the_form_of_an_export_stays_with_the_session_that_is_chosen(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5")
    click(qtbot, panel.export)
    form = panel.export_form
    click(qtbot, form.begin_button)
    assert not form.isEnabled()
    choose(qtbot, panel, "load-20.h5")
    qtbot.waitUntil(form.isEnabled, timeout=20_000)
    assert form.session == folder / "load-20.h5"


@pytest.mark.parametrize("what", ["summary", "tables"])
def test_an_export_says_where_it_went(qtbot, panel, folder, what):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5")
    click(qtbot, panel.export)
    form = panel.export_form
    kinds = [one.what for one in EXPORTS]
    form.kind.setCurrentIndex(kinds.index(what))
    destination = folder / ("load-30-summary.csv" if what == "summary" else "load-30-tables")
    assert form.file.text() == str(destination)
    click(qtbot, form.begin_button)
    qtbot.waitUntil(lambda: str(destination) in panel.said.text())
    assert destination.exists()
    # the next one goes elsewhere by itself, and the same place is refused
    qtbot.waitUntil(lambda: form.file.text() != str(destination))
    form.file.setText(str(destination))
    qtbot.keyClick(form.file, Qt.Key.Key_Return)
    refused = "exists" if what == "summary" else "is not empty"
    qtbot.waitUntil(lambda: refused in panel.said.text())


def test_an_export_by_keyboard_has_the_frames_that_are_named(qtbot, panel, folder):
    listed_and_chosen(qtbot, panel, folder, "load-30.h5")
    qtbot.keyClick(panel.export, Qt.Key.Key_Space)
    assert panel.export_form.isVisible()
    write(qtbot, panel.export_form.frames, "10:20", Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: "Written" in panel.said.text())
    images = sorted(path.name for path in (folder / "load-30-images").glob("*.tiff"))
    assert images == [f"{n:06d}.tiff" for n in range(10, 20)]


@pytest.mark.parametrize("name", ["a/b.h5", "/tmp/b.h5", "a\\b.h5", "..", "x/"])
def test_a_name_with_a_folder_in_it_is_none_of_a_further_analysis(qtbot, panel, folder, name):
    drop(panel, folder)
    listed(qtbot, panel, 3)
    panel.list.choose([folder / "load-30.h5"])
    panel.analyse.click()
    form, asked = panel.analysis_form, []
    form.asked.connect(lambda *given: asked.append(given))
    form.file.setFocus()
    form.file.clear()
    qtbot.keyClicks(form.file, name)
    assert not form.begin_button.isEnabled()
    assert "is no name of a file" in form.where.text()
    qtbot.keyClick(form.file, Qt.Key.Key_Return)
    assert asked == []
    form.file.clear()
    qtbot.keyClicks(form.file, "b.h5")
    assert form.begin_button.isEnabled()
    assert form.where.text() == str(folder / "b.h5")


def test_a_recording_that_was_cut_short_is_listed_and_brought_back(qtbot, panel, tmp_path):
    writer = make_writer(tmp_path / "open.h5")
    writer.append(Samples(0, np.zeros((200, 2)), np.zeros((200, 2))))
    for n in range(4):
        writer.append(Frame(n, 42 * n, np.full(SHAPE, n, np.uint8)))
    writer.flush()
    copy_recording(tmp_path / "open.h5", tmp_path / "full-disk.h5")
    panel.list_folder(tmp_path)
    found = listed(qtbot, panel, 2)
    assert found["full-disk.h5"][0] == "cut short"
    assert found["open.h5"][0] == "being recorded"
    choose(qtbot, panel, "open.h5")
    assert panel.play_button.text() == "Play"
    choose(qtbot, panel, "full-disk.h5")
    assert panel.play_button.text() == "Repair"
    assert "slipscope repair full-disk.h5 -o full-disk-repaired.h5" in panel.said.text()
    assert not panel.export.isEnabled()
    click(qtbot, panel.play_button)
    qtbot.waitUntil(lambda: "full-disk-repaired.h5" in rows(panel))
    assert panel.asked == []
    listed(qtbot, panel, 3)
    assert panel.list.chosen() == [tmp_path / "full-disk-repaired.h5"]
    assert panel.play_button.text() == "Play"
    with SessionReader(tmp_path / "full-disk-repaired.h5") as session:
        assert len(list(session.frames())) == 4
    writer.discard()


def test_a_session_that_is_recorded_by_another_program_is_looked_at_until_it_is_not(
    qtbot, panel, tmp_path, monkeypatch
):
    monkeypatch.setattr("app.gui.sessions_panel.AGAIN_MS", 10)
    looked, entry_of = [], archive.entry_of
    monkeypatch.setattr(archive, "entry_of", lambda path: looked.append(path) or entry_of(path))
    writer = make_writer(tmp_path / "open.h5")
    writer.append(Samples(0, np.zeros((200, 2)), np.zeros((200, 2))))
    writer.flush()
    panel.list_folder(tmp_path)
    assert listed(qtbot, panel, 1)["open.h5"][0] == "being recorded"
    panel.said.setText("it is written")
    qtbot.waitUntil(lambda: len(looked) > 3)
    assert panel.said.text() == "it is written"
    writer.discard()  # it was killed
    qtbot.waitUntil(lambda: rows(panel)["open.h5"][0] != "being recorded")
    listed_since = len(looked)
    qtbot.wait(100)
    assert len(looked) == listed_since


def test_the_folder_of_the_next_run_is_listed_before_another_is_chosen(qtbot, folder):
    model = WindowModel(RunFactory([].append), Config(), folder / "next.h5")
    panel = SessionsPanel(model)
    qtbot.addWidget(panel)
    panel.show()
    listed(qtbot, panel, 3)


def test_only_what_has_changed_is_read_again(qtbot, panel, folder, monkeypatch):
    panel.list_folder(folder)
    listed(qtbot, panel, 3)
    read, entry_of = [], archive.entry_of
    monkeypatch.setattr(archive, "entry_of", lambda path: read.append(path.name) or entry_of(path))
    shutil.copy(folder / "load-30.h5", folder / "load-31.h5")
    panel._model.ended.emit(SimpleNamespace(session=folder / "load-31.h5"))
    listed(qtbot, panel, 4)
    assert sorted(read) == ["load-31.h5", "notes.h5"]  # the one that is no session may become one
    assert rows(panel)["load-30.h5"][0] == "complete"
    assert WindowMemory().recent("session")[0] == folder / "load-31.h5"


def test_the_folder_of_a_run_that_has_ended_is_listed(qtbot, panel, folder):
    panel._model.ended.emit(SimpleNamespace(session=folder / "load-20.h5"))
    listed(qtbot, panel, 3)
    assert panel.list.chosen() == [folder / "load-20.h5"]
    panel._model.ended.emit(SimpleNamespace(session=folder.parent / "elsewhere.h5"))
    listed(qtbot, panel, 3)
    assert panel.where.text() == str(folder)
