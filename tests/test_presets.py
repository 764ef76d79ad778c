"""A preset stands for other settings: what is given beside it is kept, a session holds what it
stood for, and without one nothing changes.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import call
from tradeoff.grains import Speckle

from analysis.options import as_written
from analysis.settings import PRESETS, Correlation
from app.settings import config
from app.settings.config import ConfigError, load
from app.settings.sections import Config


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_its_settings(name: str) -> None:
    found = load(None, [f"dic.preset={name}"]).dic
    assert found == Correlation(**PRESETS[name]) == Correlation.of_preset(name)
    assert found != Correlation()
    assert len(set(PRESETS[name]) ^ set(PRESETS["fast"])) == 0


def test_what_is_given_beside_a_preset_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text('[dic]\npreset = "accurate"\nbox = 20\nthreads = 3\n')
    found = load(file).dic
    assert (found.box, found.threads, found.order, found.method) == (20, 3, 2, "shared")
    found = load(None, ["dic.step=7", "dic.preset=finest"]).dic
    assert (found.step, found.box) == (7, PRESETS["finest"]["box"])


def test_a_preset_on_the_command_line_replaces_what_the_file_says(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(config.to_toml(Config()))
    found = load(file, ["dic.preset=accurate", "dic.step=12"]).dic
    assert found == Correlation.of_preset("accurate", step=12)
    assert load(file, ["dic.preset=custom"]) == Config()


def test_a_preset_that_would_change_nothing_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    text = config.to_toml(Config()).replace('preset = "custom"', 'preset = "fast"')
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"dic.preset = 'fast' changes nothing.*leave out"):
        load(file)


def test_settings_with_a_preset_come_back_from_a_session_as_they_were() -> None:
    settings = load(None, ["dic.preset=fast", "dic.box=26"])
    text = config.to_toml(settings)
    assert 'preset = "custom"' in text
    assert config.from_record(text, "session") == settings
    again = config.revised(settings, ["dic.preset=finest"])
    assert again.dic == Correlation.of_preset("finest")


@pytest.mark.parametrize("value", ['"quick"', "3", '["fast"]', "true"])
def test_another_word_is_refused(value: str) -> None:
    with pytest.raises(ConfigError, match=r"dic.preset must be 'custom' or 'fast'"):
        load(None, [f"dic.preset={value}"])


def test_an_instance_has_no_preset() -> None:
    assert as_written(Correlation())["preset"] == "custom"
    with pytest.raises(ValueError, match="of_preset"):
        Correlation(preset="fast")


def test_a_preset_of_plain_files(tmp_path: Path) -> None:
    speckle = Speckle((160, 200))
    for name, ux in (("a.png", 0.0), ("b.png", 0.4)):
        cv2.imwrite(str(tmp_path / name), speckle.image(ux, noise=1))
    files = [tmp_path / name for name in ("a.png", "b.png")]
    for words, box, step in (
        ((), 20, 10),
        (("--preset", "fast"), 20, 20),
        (("--preset", "fast", "--box", "32", "--step", "10"), 32, 10),
    ):
        output = tmp_path / f"{box}-{step}.npz"
        done = call("dic", *files, "-o", output, *words)
        assert done.exit_code == 0, done.output
        with np.load(output) as found:
            held = dict(found["settings"])
            assert held["preset"] == "custom"
            assert (held["box"], held["step"]) == (str(box), str(step))
            assert np.diff(found["x_px"])[0] == step
