"""The ranges of the colours of a picture: they follow what is shown unless they are locked."""

from types import SimpleNamespace

import numpy as np
from picture_hands import (  # noqa: F401 (fixtures)
    choose,
    picture_of_run,
    run_of_script,
    script_of_frames,
)
from PySide6.QtCore import QPoint, Qt
from pytestqt.qtbot import QtBot
from scripted_run import REFERENCE, ScriptedRun
from set_up_hands import write
from window_hands import look

from app.gui.frame_results import KINDS, FieldImage
from app.gui.image_view import InterfaceView
from app.gui.source import setup_of


def test_a_locked_range_stays(qtbot: QtBot, picture: InterfaceView, run: ScriptedRun) -> None:
    view = look(run.at(100))
    picture.show_view(view)
    ends = picture.canvas.colour_scale[1]
    qtbot.mouseClick(picture.locked, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    view = look(run.at(330), view)
    picture.show_view(view)
    assert picture.canvas.colour_scale[1] == ends
    qtbot.mouseClick(picture.locked, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    assert picture.canvas.colour_scale[1][1] > ends[1]


def test_a_locked_range_has_zero_in_the_middle_of_a_field_of_both_signs(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(330)))
    picture.canvas.range_chosen.emit(0.0, 5.0)
    assert picture.canvas.colour_scale[:2] == (False, (0.0, 5.0))
    picture._frame = SimpleNamespace(keys=("ux_um",), field=of_both_signs)
    picture._show_field()
    assert picture.canvas.colour_scale[:2] == (True, (-5.0, 5.0))
    assert picture.locked.isChecked()


def test_colours_that_end_at_zero_are_of_one_sign(picture: InterfaceView, run: ScriptedRun) -> None:
    picture.show_view(look(run.at(330)))
    picture.canvas.range_chosen.emit(0.0, 50.0)
    picture._frame = SimpleNamespace(keys=("ux_um",), field=of_both_signs)  # but next to nothing
    picture._show_field()
    assert picture.field.is_diverging
    assert picture.canvas.colour_scale[:2] == (False, (0.0, 50.0))


def of_both_signs(key: str) -> FieldImage:
    return FieldImage(KINDS[key], np.linspace(-2, 3, 713, dtype=np.float32).reshape(23, -1), "")


def test_a_range_of_the_difference_is_kept_while_a_field_about_its_median_is_shown(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    before = look(run.at(REFERENCE - 1))
    picture.show_view(look(run.at(100), before))
    choose(picture, "difference")
    picture.canvas.range_chosen.emit(-50.0, 50.0)
    picture.median.setChecked(True)
    choose(picture, "ux_um")
    assert picture.field.offset
    choose(picture, "difference")
    assert picture.canvas.colour_scale[1] == (-50.0, 50.0)


def test_a_locked_range_holds_in_the_next_run(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(330)))
    ends = picture.canvas.colour_scale[1]
    qtbot.mouseClick(picture.locked, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    early = look(run.at(REFERENCE + 2))
    for is_locked in (True, False):
        picture.locked.setChecked(is_locked)
        picture.show_setup(setup_of(run))
        picture.show_view(early)  # of nearly no displacement
        assert (picture.canvas.colour_scale[1] == ends) is is_locked


def test_a_range_that_is_typed_stays_and_a_field_that_is_left_changes_nothing(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    view = look(run.at(100))
    low, high = picture.ends
    assert not low.isVisible()  # there are no colours yet
    picture.show_view(view)
    ends = picture.canvas.colour_scale[1]
    high.setFocus()
    low.setFocus()
    assert not picture.locked.isChecked()
    assert picture.canvas.colour_scale[1] == ends
    for field, text in ((low, "1,5"), (high, "7")):
        write(qtbot, field, text, Qt.Key.Key_Return)
    assert picture.canvas.colour_scale[1] == (1.5, 7.0)
    assert picture.locked.isChecked()
    picture.show_view(look(run.at(330), view))
    assert picture.canvas.colour_scale[1] == (1.5, 7.0)
    low.setFocus()
    qtbot.keyClick(low, Qt.Key.Key_Tab)
    assert high.hasFocus()
    for text in ("x", "9", "inf"):  # no number, not below the upper end, no end
        write(qtbot, low, text, Qt.Key.Key_Return)
        assert picture.canvas.colour_scale[1] == (1.5, 7.0)
    qtbot.mouseClick(picture.locked, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    high.setFocus()
    assert not picture.locked.isChecked()
    picture.show_setup(setup_of(run))
    assert not high.isVisible()  # nor are there for the next run
