"""What is made beside the window, before it draws it."""

import threading

import pytest
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, begin, look, make_run, wait_for_frame

from app.gui import run_charts
from app.gui.charts import Chart
from app.gui.plots import raster
from app.gui.run_charts import RunCharts


@pytest.fixture(scope="module")
def script() -> ScriptedRun:
    return ScriptedRun(320, 240, frames=330)


def test_of_the_charts_that_are_drawn_in_turn_that_is_ready_which_is_next(
    script: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    script.started = True
    make, made = run_charts.RunCharts._chart, list[str]()

    def noted(charts: RunCharts, key: str) -> Chart:
        made.append(key)
        return make(charts, key)

    monkeypatch.setattr(run_charts.RunCharts, "_chart", noted)
    view, keys = look(script.at(200), None), ["loading", "sticking", "forces"]
    for key in keys:
        _ = view.charts[key]
    for frame, key in enumerate(2 * keys, 201):
        made.clear()
        view = look(script.at(frame), view)
        assert made == [key]
        _ = view.charts[key]
        assert made == [key]


class Asked(dict[str, int]):
    """Grows while somebody goes through it, as where another thread asks for a chart."""

    def items(self):  # type: ignore[no-untyped-def,override]
        for one in super().items():
            yield one
            self["noise"] = 0


def test_a_chart_is_asked_for_while_the_next_is_made(script: ScriptedRun) -> None:
    script.started = True
    view = look(script.at(200), None)
    view.charts.__dict__["_asked"] = Asked(loading=0)
    assert set(look(script.at(201), view).charts._asked) >= {"loading"}


def test_the_picture_is_made_in_the_thread_that_reads_the_run(
    qtbot: QtBot, open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run()
    window = open_window(run)
    begin(qtbot, window, run, 55)
    qtbot.wait(50)
    window.grab()  # it has been painted, also on a busy computer
    make, threads = raster._Image._scaled_part, list[str]()

    def noted(image: raster._Image, *place: object) -> object:
        threads.append(threading.current_thread().name)
        return make(image, *place)  # type: ignore[arg-type]

    monkeypatch.setattr(raster._Image, "_scaled_part", noted)
    run.at(56)
    wait_for_frame(qtbot, window, 56)
    qtbot.wait(50)
    assert set(threads) == {"slipscope-window-reader"}
