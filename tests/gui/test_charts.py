"""Charts as plain values: what a file of them says, and what their axes hold."""

import csv
import io
from pathlib import Path

import numpy as np

from app.gui.charts import Chart, Line
from app.gui.source import Setup
from app.settings.config import load

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


def test_a_run_that_presses_to_no_load_is_named_by_its_session_alone() -> None:
    free = 'run.purpose="calibration"', 'run.steps=[{do="background"}]'
    for steps, name in ((), "0.5 N a"), (free, "a"):
        config = load(None, steps)
        assert Setup("bench", 7.0, (0, 0, 1, 1), config, session=Path("a.h5")).name == name
