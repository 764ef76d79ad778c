"""The picture of the interface and the charts, as an operator uses them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from picture_hands import (  # noqa: F401 (fixtures)
    choose,
    picture_of_run,
    run_of_script,
    script_of_frames,
)
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from pytestqt.qtbot import QtBot
from scripted_run import REFERENCE, ScriptedRun
from set_up_hands import write
from window_hands import click, look, make_run, shown

from app.gui.curves_view import CurvesView
from app.gui.frame_results import KINDS, FieldImage, shown_image
from app.gui.image_view import LIVE, PICTURES, POINT_HINT, InterfaceView
from app.gui.plots.picture import colour_table
from app.gui.source import setup_of
from app.gui.view_state import ViewState
from app.records.bench_view import PictureView

MM = 7.04e-3


def pixel(view: InterfaceView, x_px: float, y_px: float) -> QColor:
    image = view.canvas.grab().toImage()  # first: it may take its final size only now
    place = view.canvas.place(x_px * MM, y_px * MM)
    return image.pixelColor(int(place.x()), int(place.y()))  # in which that place is


def rgb(colour: QColor) -> tuple[int, int, int]:
    return colour.red(), colour.green(), colour.blue()


def test_each_picture_says_what_it_is_before_the_first_run(qtbot: QtBot) -> None:
    view = InterfaceView()
    qtbot.addWidget(view)
    items = {key: view.which.findData(key) for key in PICTURES}
    tips = {key: view.which.itemData(n, Qt.ItemDataRole.ToolTipRole) for key, n in items.items()}
    assert all(tips[key].startswith(PICTURES[key][1]) for key in PICTURES)


def test_the_field_is_opaque_in_the_colours_of_its_bar(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    state = look(run.at(200))
    picture.show_view(state)
    low, high = picture.canvas.colour_scale[1]
    field = state.frame.field("ux_um").values
    assert low == 0.0
    assert 1.0 <= high / np.nanpercentile(field, 99) < 1.3
    for row, col in ((2, 3), (20, 28)):
        share = (field[row, col] - low) / (high - low)
        wanted = colour_table(is_diverging=False)[1 + min(254, int(255 * share)), :3]
        x, y = run.grid_x_px[col] + 3, run.grid_y_px[row] + 3
        assert rgb(pixel(picture, x, y)) == tuple(wanted)


def test_the_slider_shows_the_image_below(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(200)))
    covered = rgb(pixel(picture, 43, 44))
    picture.opacity.setFocus()
    qtbot.keyClick(picture.opacity, Qt.Key.Key_Home)
    assert rgb(pixel(picture, 43, 44)) == (run.pressed[44, 43],) * 3
    assert covered != rgb(pixel(picture, 43, 44))


def test_the_median_is_subtracted_by_a_click(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(330)))
    assert not picture.canvas.colour_scale[0]  # they go one way
    qtbot.mouseClick(picture.median, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    low, high = picture.canvas.colour_scale[1]
    assert picture.canvas.colour_scale[0]
    assert low == -high
    assert "−" in picture.canvas.colour_scale[2]
    choose(picture, "zncc")
    assert not picture.median.isEnabled()


def test_every_picture_can_be_chosen_once_it_is_there(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    view = look(run.at(REFERENCE - 1))
    picture.show_view(view)
    model = picture.which.model()
    assert not model.item(picture.which.findData("difference")).isEnabled() or view.reference
    picture.show_view(look(run.at(200), view))
    names = {picture.which.itemData(n) for n in range(picture.which.count())}
    assert names == {
        "raw", "difference", "ux_um", "uy_um", "u_um", "sigma_kPa", "slip_um", "zncc", "ux_sd_um"
    }  # fmt: skip
    for key in names:
        assert model.item(picture.which.findData(key)).isEnabled()
        choose(picture, key)
        assert not picture.canvas.grab().isNull()


def test_the_difference_is_to_the_image_of_the_reference(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    before = look(run.at(REFERENCE - 1))
    brighter = np.clip(run.pressed.astype(int) + 40, 0, 255).astype(np.uint8)
    after = replace(look(run.at(60), before), image=shown_image(brighter))
    assert before.reference is not None
    assert before.reference.full is run.reference
    assert after.reference is before.reference
    picture.show_view(after)
    choose(picture, "difference")
    low, high = picture.canvas.colour_scale[1]
    assert low == -high == -40.0
    assert rgb(pixel(picture, 43, 44)) == tuple(colour_table(is_diverging=True)[255, :3])


def test_the_name_of_the_colours_stands_beside_them_in_each_run(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    bar = picture.canvas._bar
    for _ in range(3):
        picture.show_setup(setup_of(run))
        qtbot.wait(50)
        view = None
        for frame in (5, 100, 330):
            view = look(run.at(frame), view)
            picture.show_view(view)
            qtbot.wait(50)
        name = bar.getAxis("left").label.sceneBoundingRect()
        assert not name.intersects(bar.vb.sceneBoundingRect())


def test_zero_as_one_end_of_both_signs_leaves_the_other(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(330)))
    picture.which.setCurrentIndex(list(PICTURES).index("uy_um"))
    low, high = picture.canvas.colour_scale[1]
    assert low == -high < 0
    write(qtbot, picture.ends[0], "0", Qt.Key.Key_Return)
    assert picture.canvas.colour_scale[1] == (low, high)


def test_no_recorded_frame_takes_the_place_of_a_connected_bench(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    view = look(run.at(330))
    picture.show_view(view)
    rect, field = picture.canvas._grid, picture.field
    live = PictureView(1, np.zeros((12, 16, 3), np.uint8), np.zeros(64), 0.0, 0.0, 0.3, 90.0, 0)
    picture.show_live(live, run.config, "", True)
    for note in ("", "not live: 3 s old"):
        picture.show_live(live, run.config, note, True)
        picture.show_view(view)
        assert picture.field is None
        assert picture.panel.caption.text() == (note or LIVE)
    picture.show_live(live, run.config, "not live: 3 s old", False)
    picture.show_view(view)
    assert (picture.field, picture.canvas._grid) == (field, rect)


def test_grey_levels_are_those_of_the_camera_unless_stretched(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    picture.show_view(look(run.at(5)))
    grey = int(run.free[44, 43])
    assert rgb(pixel(picture, 43, 44)) == (grey,) * 3
    qtbot.mouseClick(picture.stretch, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    low, high = np.percentile(run.free[::4, ::4], (0.5, 99.8)).astype(int)
    wanted = min(255, max(0, int((grey - low) * 255 / (high - low))))
    assert rgb(pixel(picture, 43, 44)) == (wanted,) * 3


def test_the_grey_levels_of_cut_and_difference_are_those_of_the_camera(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    reference = shown_image(run.pressed.astype(np.uint16) * 16, 4095)
    full = np.repeat(np.repeat(run.pressed.astype(np.uint16) * 16 + 160, 4, 0), 4, 1)
    thin = shown_image(full, 4095)  # every second pixel of 1280
    np.testing.assert_array_equal(thin.levels, full[::2, ::2])
    image = shown_image(full[::4, ::4], 4095)
    picture.show_view(replace(look(run.at(60)), image=image, reference=reference))
    picture.show_cut.setChecked(True)
    row = round(picture.canvas.cut_px)
    for key, levels in (("raw", image.full[row]), ("difference", 160)):
        choose(picture, key)
        (line,) = picture.cut.chart.lines
        np.testing.assert_array_equal(line.y, levels)
        assert line.columns == ("x_mm", key)
    assert picture.canvas.colour_scale[1][1] >= 160


def test_saturated_pixels_are_red(picture: InterfaceView, run: ScriptedRun) -> None:
    image = run.free.copy()
    image[44, 43] = 255
    picture.show_view(replace(look(run.at(5)), image=shown_image(image)))
    red, green, blue = rgb(pixel(picture, 43, 44))
    assert red > 200
    assert max(green, blue) < 60
    assert "saturated" in picture.panel.caption.text()


@pytest.mark.parametrize(
    ("saturated", "percent"), [(240 * 320, "100"), (768, "1"), (77, "0.1"), (1, "< 0.01")]
)
def test_the_share_of_saturated_pixels_is_written_as_people_do(
    saturated: int, percent: str
) -> None:
    image = np.zeros(240 * 320, np.uint8)
    image[:saturated] = 255
    assert f", {percent} % saturated" in shown_image(image.reshape(240, 320)).caption


def test_a_small_median_is_not_written_as_zero() -> None:
    for value, label in ((0.04, "uₓ − 0.04 (µm)"), (-3.21, "uₓ + 3.2 (µm)")):
        field = FieldImage(KINDS["ux_um"], np.full((5, 5), value, np.float32), "")
        assert field.about_median().label == label


def test_the_probe_follows_the_frame(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    view = look(run.at(100))
    picture.show_view(view)
    assert picture.pointed.text() == POINT_HINT
    places: list[QPoint] = []

    def is_settled() -> bool:
        places.append(picture.canvas.place(203 * MM, 144 * MM).toPoint())
        return places[-10:] == 10 * places[-1:]

    qtbot.waitUntil(is_settled)  # it has its final size
    there = places[-1]
    qtbot.mouseMove(picture.canvas.viewport(), QPoint(5, 5))
    qtbot.mouseMove(picture.canvas.viewport(), there)
    texts = []
    for frame in (100, 200):
        view = look(run.at(frame), view)
        picture.show_view(view)
        values = view.frame.field("ux_um").values
        texts.append(picture.pointed.text())
        assert texts[-1].startswith("x 203 px, y 144 px  ·  1.43 mm, 1.0")
        assert "  ·  grey " in texts[-1]
        assert texts[-1].endswith(f"uₓ {values[13, 19]:.3g} µm".replace("-", "−"))
    assert texts[0] != texts[1]


def test_the_cut_goes_through_the_centre(
    qtbot: QtBot, picture: InterfaceView, run: ScriptedRun
) -> None:
    view = look(run.at(200))
    picture.show_view(view)
    qtbot.mouseClick(picture.show_cut, Qt.MouseButton.LeftButton, pos=QPoint(8, 8))
    (line,) = picture.cut.chart.lines
    row = int((run.centre_px[1] - 5) // 10)
    np.testing.assert_array_equal(line.y, view.frame.field("ux_um").values[row])
    np.testing.assert_allclose(line.x, run.grid_x_px * MM)
    assert line.columns == ("x_mm", "ux_um")
    choose(picture, "sigma_kPa")
    assert picture.cut.chart.y_label == "σₓz (kPa)"
    # what is pointed at in the cut is marked in the picture
    qtbot.mouseMove(picture.cut.viewport(), QPoint(5, 5))
    qtbot.mouseMove(picture.cut.viewport(), picture.cut.place(1.0, 12.0).toPoint())
    assert picture.canvas._place == pytest.approx(1.0, abs=0.02)


def test_a_new_run_shows_all_again(picture: InterfaceView, run: ScriptedRun, qtbot: QtBot) -> None:
    picture.show_view(look(run.at(100)))
    before = picture.canvas.box.viewRange()
    qtbot.keyClick(picture.canvas, Qt.Key.Key_Plus)
    assert picture.canvas.is_zoomed
    picture.show_setup(setup_of(run))
    assert not picture.canvas.is_zoomed
    assert picture.canvas.box.viewRange() == before
    assert picture.field is None


def test_the_axis_is_named_by_the_way_of_the_drive_in_the_picture(
    picture: InterfaceView, run: ScriptedRun
) -> None:
    setup = setup_of(run)

    def name(angle: float, way: float) -> str:
        config = setup.config
        camera, plan = replace(config.camera, angle=angle), replace(config.run, travel=way * 1e-4)
        config = replace(config, camera=camera, run=plan)
        picture.show_setup(replace(setup, config=config))
        return picture.canvas.axes[1].labelText

    assert "→" in name(0.0, 1.0)
    assert "→" in name(np.pi, -1.0)
    assert "←" in name(0.0, -1.0)
    assert "←" in name(np.pi, 1.0)
    assert name(np.pi / 2, 1.0) == name(np.pi / 2, -1.0) == "x (mm)"


def test_the_picture_keeps_its_shape_when_zoomed(
    picture: InterfaceView, run: ScriptedRun, qtbot: QtBot
) -> None:
    picture.show_view(look(run.at(100)))
    for _ in range(3):
        step = picture.canvas.place(1.5, 1.2) - picture.canvas.place(0.5, 0.2)
        assert step.x() == pytest.approx(step.y())
        qtbot.keyClick(picture.canvas, Qt.Key.Key_Plus)


# ------------------------------------------------------------------ the charts


@pytest.fixture
def curves(qtbot: QtBot, run: ScriptedRun) -> CurvesView:
    view = shown(qtbot, CurvesView(), 700, 820)
    view.show_setup(setup_of(run))
    return view


def draw(curves: CurvesView, view: ViewState) -> None:
    for cell in curves.cells:
        if cell.isVisible():
            cell.show_view(view)


def keys(curves: CurvesView) -> list[str]:
    return [cell.key for cell in curves.cells if cell.isVisible()]


def test_there_are_as_many_charts_as_there_is_room_for(curves: CurvesView) -> None:
    assert len(keys(curves)) in (7, 8)
    curves.resize(320, 420)
    assert keys(curves) == ["loading", "sticking"]


def test_another_chart_is_chosen_in_its_place(
    qtbot: QtBot, curves: CurvesView, run: ScriptedRun
) -> None:
    draw(curves, look(run.at(200)))
    cell = curves.cells[0]
    cell.choice.setFocus()
    qtbot.keyClicks(cell.choice, "Noise")
    assert cell.key == "noise"
    assert cell.plot.chart.y_label == "noise of uₓ (px)"
    assert not cell.mark.isVisible()


def test_frames_are_numbered_on_the_loading_curve(
    qtbot: QtBot, curves: CurvesView, run: ScriptedRun
) -> None:
    view = None
    for frame in (100, 200):
        view = look(run.at(frame), view)
        draw(curves, view)
        click(qtbot, curves.cells[0].mark)
    marks = curves.cells[0].plot.chart.marks
    assert [mark.text for mark in marks] == ["1: frame 99", "2: frame 199"]
    snapshot = run.snapshots_since(99)[0]
    assert marks[0].x == pytest.approx(snapshot.conditions.travel_m * 1e6)
    assert marks[0].y == pytest.approx(snapshot.conditions.shear_force_n)


def test_a_frame_is_numbered_on_a_curve_over_v_t(qtbot: QtBot, curves: CurvesView) -> None:
    run = make_run()
    run.started, unread = True, {"travel_m": math.nan}
    run._snapshots = [
        replace(one, conditions=replace(one.conditions, **unread)) for one in run._snapshots
    ]
    curves.show_setup(setup_of(run))
    cell = curves.cells[0]
    draw(curves, look(run.at(50)))  # whose velocity of sliding is not known yet
    click(qtbot, cell.mark)
    assert cell.plot.chart.marks == ()
    assert cell.saved.text() == "Frame 49 is not marked: no travel is known of it."
    view = look(run.at(60))
    draw(curves, view)
    click(qtbot, cell.mark)
    (mark,), (line,) = cell.plot.chart.marks, cell.plot.chart.lines
    assert cell.plot.chart.x_label == "travel δ = v t (µm)"
    assert (mark.x, mark.y) == pytest.approx((line.x[-1], line.y[-1]))
    curves.show_setup(setup_of(run))
    assert cell.saved.isHidden()


def play(curves: CurvesView, run: ScriptedRun, session: str, load_n: float = 0.5) -> None:
    """Show a run of a session, to its end."""
    config = run.config
    setup = setup_of(run)
    run_settings = replace(config.run, normal_force=load_n)
    setup = replace(setup, session=Path(session), config=replace(config, run=run_settings))
    curves.show_setup(setup)
    draw(curves, look(run.at(330)))


def test_earlier_runs_are_seen_faintly_behind(curves: CurvesView, run: ScriptedRun) -> None:
    for n in range(1, 13):
        play(curves, run, f"run-{n}.h5")
    lines = curves.cells[0].plot.chart.lines
    faint = [line for line in lines if line.is_faint]
    assert len(faint) == 5
    assert [line.name for line in faint] == [f"0.5 N run-{n}" for n in (7, 8, 9, 10, 11)]
    assert all(len(line.x) <= 310 for line in faint)
    assert lines[-1] is not faint[-1]
    assert "earlier" in curves.cells[0].caption.text()
    # nothing else of those runs is held
    assert not any(line.x.base is not None for line in faint)


def test_earlier_runs_are_told_apart_by_their_load(curves: CurvesView, run: ScriptedRun) -> None:
    for name, load_n in (("b", 0.7), ("a", 0.3), ("c", 0.5), ("a", 0.3), ("now", 0.5)):
        play(curves, run, f"{name}.h5", load_n)
    faint = [line for line in curves.cells[0].plot.chart.lines if line.is_faint]
    assert [line.name for line in faint] == ["0.3 N a", "0.5 N c", "0.7 N b"]
    assert len({line.role for line in faint}) == 3
    legend = curves.cells[0].plot.legend
    assert "0.3 N a" in legend.toPlainText().replace("\xa0", " ")


def test_one_plot_is_enlarged_and_all_are_shown_again(
    qtbot: QtBot, curves: CurvesView, run: ScriptedRun
) -> None:
    draw(curves, look(run.at(200)))
    before, cell = keys(curves), curves.cells[2]
    size = cell.plot.size()
    click(qtbot, cell.enlarge)
    assert keys(curves) == [cell.key]
    qtbot.waitUntil(lambda: cell.plot.width() > 1.8 * size.width())
    curves.resize(800, 900)
    assert keys(curves) == [cell.key]
    click(qtbot, cell.enlarge)
    assert keys(curves) == before


def test_a_new_run_forgets_marks_and_zoom(
    qtbot: QtBot, curves: CurvesView, run: ScriptedRun
) -> None:
    draw(curves, look(run.at(200)))
    curves.mark_frame()
    qtbot.keyClick(curves.cells[0].plot, Qt.Key.Key_Plus)
    assert curves.cells[0].plot.is_zoomed
    curves.show_setup(setup_of(run))
    draw(curves, look(run.at(60)))
    assert not curves.cells[0].plot.is_zoomed
    assert curves.cells[0].plot.chart.marks == ()
