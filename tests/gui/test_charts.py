"""Charts as plain values: what a file of them says, and where their points are on the screen."""

import csv
import io

import numpy as np
import pytest

from app.gui.charts import AxesFrame, Chart, Line, paths, spots

TRAVEL_Q = ("travel_um", "Q_N")


def line(x: list[float], y: list[float], **more: object) -> Line:
    return Line("", np.array(x), np.array(y), "shear", TRAVEL_Q, **more)  # type: ignore[arg-type]


def test_a_file_of_numbers_names_columns_as_the_exports_do() -> None:
    radii, sd = np.array([0.5, 1.0]), np.array([0.1, np.nan])
    chart = Chart(
        "Shear traction",
        "r (mm)",
        "σ (kPa)",
        (
            Line("measured", radii, np.array([12.25, 3.0]), "shear", ("r_mm", "sigma_kPa"), sd=sd),
            Line("model", radii[:1], np.array([12.0]), "model", ("r_mm", "sigma_kPa")),
        ),
    )
    rows = list(csv.DictReader(io.StringIO(chart.table())))
    assert list(rows[0]) == ["curve", "r_mm", "sigma_kPa", "sigma_sd_kPa"]
    assert rows[0] == {
        "curve": "measured", "r_mm": "0.5", "sigma_kPa": "12.25", "sigma_sd_kPa": "0.1"
    }  # fmt: skip
    assert rows[1]["sigma_sd_kPa"] == ""
    assert (rows[2]["curve"], rows[2]["sigma_kPa"]) == ("model", "12")


def test_axes_hold_all_lines_and_their_bands_but_not_earlier_runs() -> None:
    chart = Chart(
        "", "", "",
        (line([0.0, 10.0], [1.0, 2.0], sd=np.array([0.0, 0.5])),
         line([0.0, 100.0], [-50.0, 50.0], is_faint=True)),
    )  # fmt: skip
    (low_x, high_x), (low_y, high_y) = chart.ranges()
    assert (low_x, high_x) == (0.0, 10.0)
    assert low_y <= 1.0
    assert 2.5 <= high_y < 5.0
    held = ((0.0, 12.0), (0.0, 3.0))
    assert chart.ranges(held) == held


def test_places_and_points_are_each_others_inverse() -> None:
    for is_downward in (False, True):
        frame = AxesFrame(40.0, 10.0, 300.0, 200.0, (-1.0, 5.0), (2.0, 8.0), is_downward)
        assert frame.place(-1.0, 2.0) == (40.0, 10.0 if is_downward else 210.0)
        assert frame.point(*frame.place(3.0, 7.5)) == pytest.approx((3.0, 7.5))
        x, y = frame.zoomed((3.0, 7.0), (0.5, 1.0))
        assert (*x, *y) == pytest.approx((1.0, 4.0, 2.0, 8.0))
        ranges = frame.moved(50.0, 20.0)
        moved = AxesFrame(40.0, 10.0, 300.0, 200.0, *ranges, is_downward)
        before = frame.place(3.0, 7.0)
        assert moved.place(3.0, 7.0) == pytest.approx((before[0] + 50.0, before[1] + 20.0))


def test_a_long_noisy_curve_keeps_its_extremes_in_every_column() -> None:
    x = np.linspace(0.0, 1.0, 20_000)
    y = np.random.default_rng(0).normal(size=20_000)
    frame = AxesFrame(0.0, 0.0, 200.0, 100.0, (0.0, 1.0), (-5.0, 5.0))
    (thin,) = paths(x, y, frame)
    assert len(thin) <= 2 * 201
    left, top = frame.place(x, y)
    for pixel in (0, 57, 199):
        drawn = thin[np.floor(thin[:, 0]) == pixel, 1]
        whole = top[np.floor(left) == pixel]
        assert drawn.max() >= whole.max() - 1e-9 or pixel in (0, 199)
        assert drawn.min() <= whole.min() + 1e-9 or pixel in (0, 199)


def test_a_curve_is_interrupted_where_nothing_was_measured() -> None:
    frame = AxesFrame(0.0, 0.0, 100.0, 100.0, (0.0, 4.0), (0.0, 1.0))
    pieces = list(paths(np.arange(5.0), np.array([0.0, 1.0, np.nan, 1.0, 0.0]), frame))
    assert [len(piece) for piece in pieces] == [2, 2]
    assert len(spots(np.zeros(100), np.linspace(0, 0.01, 100), frame)) == 1
    assert len(spots(np.zeros(100), np.linspace(0, 0.99, 100), frame)) == 50
