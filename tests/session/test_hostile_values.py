"""A session whose values somebody changed, with valid checksums: every command reads it or ends
with one sentence and exit code 2.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import whole_runs
from changed_files import Change, changing, put
from command_line import call

SMALL = (
    *("camera.width=320", "camera.height=240", "camera.pixel=16", "dic.threads=1"),
    *("run.normal_force=0.1", "run.travel=8", "limits.age=10", "run.reference_time=0.5"),
    *("run.background_time=0.3", "run.settle_time=0.2", "sim.press_time=0.3"),
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "a.h5"
    whole_runs.recorded(path, *SMALL)
    return path


def set_to(old: str, new: str) -> Change:
    """Other settings in the session."""

    @changing
    def spoil(file: h5py.File) -> None:
        text = file["/entry/settings/toml"][()].decode()
        assert old in text
        file["/entry/settings/toml"][()] = text.replace(old, new)

    return spoil


@changing
def reversed_grid(file: h5py.File) -> None:
    file["/entry/fields/y"][...] = file["/entry/fields/y"][...][::-1]


@changing
def shorter_grid(file: h5py.File) -> None:
    grid = file["/entry/fields/x"][1:]
    del file["/entry/fields/x"]
    file["/entry/fields/x"] = grid


def resources(text: str) -> Change:
    return put("/entry/run/resources", text)


@pytest.mark.parametrize(
    ("spoil", "command", "sentence"),
    [
        (resources("[1]"), "info", "run/resources: Expected `object`, got `array`"),
        (resources('{"cpu_s": "x", "wall_s": {}}'), "info", "resources: Expected `float`"),
        (resources('{"peak_memory_mib": null}'), "info", "resources: Expected `float`"),
        (resources('{"cpu_s": 1, "wall_s": 1e400}'), "info", "run/resources: "),
        (resources('{"cpu_s": NaN, "wall_s": 1}'), "info", "run/resources: JSON is malformed"),
        (resources("{" * 5000), "info", "run/resources: "),
        (put("/entry/fields/x", np.nan, 3), "info", "fields/x: it is no grid of boxes"),
        (put("/entry/fields/x", 1e308, 3), "info", "fields/x: it is 1e\\+308"),
        (put("/entry/fields/y", 1e6, -1), "info", "fields/y: it is no grid of boxes"),
        (reversed_grid, "info", "fields/y: it is no grid of boxes"),
        (shorter_grid, "invert", "fields/ux: its fields are"),
        (put("/entry/events/sample", -1, 2), "info", "events/sample: it is -1"),
        (put("/entry/events/sample", 2**63 - 1, 2), "info", "events/sample: it is 9.22"),
        (put("/entry/gaps/first", -1, ...), "info", ""),  # there is none: it is read
        (put("/entry/instrument/actuator/position", 1e308, 2), "replay", "position: it is 1e"),
        (put("/entry/forces/shear_sensor", 1e308, 2), "export", "shear_sensor: it is 1e"),
        (put("/entry/summary/apparent_radius_errors", -1.0), "info", "radius_errors: it is -1"),
        (put("/entry/contact/radius_errors", -1.0), "invert", "radius_errors: it is -1"),
        (put("/entry/results/stick_radius_errors", -1.0, 7), "export", "errors: it is -1"),
        (put("/entry/counts/samples_lost", -1), "info", "counts/samples_lost: it is -1"),
        (put("/entry/instrument/camera/pixel", 5e-324), "info", "camera/pixel: it is 4.94"),
        (
            put("/entry/clock/exposure", 3 * 10**8),
            "replay",
            "in samples: 300000000 in the session",
        ),
        (
            put("/entry/clock/divisor", 3 * 10**8),
            "replay",
            "300000000 in the session, 125 in its",
        ),
        (
            set_to("width = 320", "width = 16384"),
            "replay",
            r"\(240, 320\) .* \(240, 16384\)",
        ),
        (put("/entry/events/text", "phase"), "replay", "its events name no phases"),
        (put("/entry/events/number", 5000), "replay", "an event of a step has its number"),
        (put("/entry/events/number", -2), "info", "events/number: it is -2"),
        (put("/entry/triggers/index", 3, 9), "replay", "triggers: its frames are in no order"),
        (put("/entry/triggers/sample", -1, 9), "export", "triggers: .* at no sample"),
        (put("/entry/triggers/image", -1, 9), "replay", "there is no image of trigger 9"),
        (put("/entry/triggers/image", 10**9, 9), "replay", "row 1000000000 is needed"),
        (put("/entry/results/stress_count", -1), "replay", "stress_count: -1 values are claimed"),
    ],
)
def test_a_changed_value_is_one_sentence(
    recorded: Path, tmp_path: Path, spoil: Change, command: str, sentence: str
) -> None:
    path = shutil.copy(recorded, tmp_path / "a.h5")
    spoil(path)
    arguments = {
        "info": [],
        "export": ["-o", str(tmp_path / "a.npz")],
        "invert": ["-o", str(tmp_path / "a.csv")],
        "replay": ["--headless"],
    }
    done = call(command, path, *arguments[command])
    if not sentence:
        assert done.exit_code == 0
        return
    last = done.output.strip().splitlines()[-1]
    assert done.exit_code == 2, done.output
    assert last.startswith(f"slipscope: {path}: ")
    assert re.search(sentence, last), last
    assert not (tmp_path / "a.png").exists()
