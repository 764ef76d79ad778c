"""The settings file: what it says is what is read, and whatever cannot be used is refused in one
sentence.
"""

from __future__ import annotations

import json
import random
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from analysis.dic import Correlation
from analysis.options import Option, as_written, options, quantity
from app.campaigns.plan import KINDS, campaign_file
from app.settings import config
from app.settings.config import ConfigError, from_data, from_record, load, parse_override, to_toml
from app.settings.sections import Config, RunSettings
from docs import reference
from drivers.settings import ForceSettings


def all_options() -> list[tuple[str, Option]]:
    return [(table, o) for table, kind in config.tables().items() for o in options(kind).values()]


def test_the_default_file_reads_back_as_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(config.to_toml(Config()), encoding="utf-8")
    assert load(file) == Config()


def test_the_default_file_explains_every_option() -> None:
    lines = config.to_toml(Config()).splitlines()
    for table, option in all_options():
        at = lines.index(f"[{table}]")
        at = next(i for i in range(at, len(lines)) if lines[i].startswith(f"{option.name} = "))
        assert lines[at - 1].startswith(f"# {option.meaning}"), f"{table}.{option.name}"


def test_changed_settings_survive_the_way_through_a_file() -> None:
    changed = load(
        None,
        [
            "run.travel=151.5",
            "forces.zero=[0.25,-1e-3]",
            "forces.coupling=[[1,0.1],[0,2]]",
            "sim.slow_actuator=false",
        ],
    )
    assert changed.run.travel == 151.5 * 1e-6
    assert changed.forces.zero == (0.25, -1e-3)
    assert from_data(tomllib.loads(to_toml(changed, comments=False)), "again") == changed


def test_a_note_of_any_length_that_is_allowed_can_be_read_back() -> None:
    note = ("µ\t#\"\\'\n" * 250)[:1500] + "." * 100 + "e" * 400
    written = load(None, [f"about.note={json.dumps(note)}", "about.operator=Élise O'Neil"])
    assert (written.about.note, written.about.operator) == (note, "Élise O'Neil")
    assert from_record(to_toml(written), "again") == written


def test_an_override_wins_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("[run]\ntravel = 100\nvelocity = 4\n", encoding="utf-8")
    settings = load(file, ["run.travel=120"])
    assert (settings.run.travel, settings.run.velocity) == (120 * 1e-6, 4 * 1e-6)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_file_redirected_by_any_shell_is_read(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("[run] # Q für a\ntravel = 77\n", encoding=encoding)
    assert load(file).run.travel == 77 * 1e-6


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("run.travl=3", "unknown key 'run.travl'; the nearest known one is 'run.travel'"),
        ("run.lens_radius=3", "the nearest known one is 'sample.lens_radius'"),
        ("camra.width=3", "unknown table or key 'camra'; the nearest known one is 'camera'"),
        (
            "run.velocity=0",
            "run.velocity must be a number more than 0 and at most 1000 um/s; found 0",
        ),
        (
            "run.velocity='fast'",
            'run.velocity must be a number more than 0 and at most 1000 um/s; found "fast"',
        ),
        (
            "run.velocity=2,5",
            'run.velocity must be a number more than 0 and at most 1000 um/s; found "2,5"; write'
            " 2.5",
        ),
        ("dic.box=3", "dic.box must be a whole number at least 4 and at most 200 px; found 3"),
        ("sim.seed=1.5", "sim.seed must be a whole number at least 0; found 1.5"),
        (
            "dic.min_correlation=1",
            "dic.min_correlation must be a number at least 0 and less than 1; found 1",
        ),
        ("sim.renderer=slow", "sim.renderer must be 'fast' or 'exact'; found \"slow\""),
        ("sim.slow_actuator=1", "sim.slow_actuator must be true or false; found 1"),
        ("dic.method=lk", "dic.method must be 'shared' or 'icgn' or 'direct'; found \"lk\""),
        (
            "dic.search=201",
            "dic.search must be a whole number at least 1 and at most 200 px; found 201",
        ),
        (
            "dic.precision=double",
            "dic: precision double asked, which only earlier versions did; set"
            " dic.precision=single, or a dic.preset, to correlate now",
        ),
        ("camera.source=7", "camera.source must be a text in quotes; found 7"),
        ("forces.zero=[1]", "forces.zero must be two numbers, [a, b] in V; found [1]"),
        (
            "forces.coupling=3",
            "forces.coupling must be two rows of two numbers, [[a, b], [c, d]]; found 3",
        ),
        ("run.travel=nan", "run.travel: a finite number is needed; found nan"),
        (
            "forces.coupling=[[1, inf], [0, 1]]",
            "forces.coupling: a finite number is needed; found inf",
        ),
        (
            "camera.divisor=41",
            "asks 24.4 frames/s, 24 is the camera's limit; use a divisor of 42 or more",
        ),
        ("camera.exposure=126", "longer than the trigger period of 125 ms"),
        ("run.travel=501", "run.travel = 501 um is beyond limits.travel = 500 um"),
        ("run.travel=-501", "run.travel = -501 um is beyond limits.travel = 500 um"),
        (
            "run.normal_force=1.9",
            "run.normal_force = 1.9 N is not below limits.normal_force = 1.9 N",
        ),
        ("forces.coupling=[[1, 1], [1, 1]]", "forces.coupling has no inverse"),
        ("forces.exposure_counter=ctr0", "are both 'ctr0'; use two different counters"),
        ('forces.channels=["ai0","ai0"]', "channels are both 'ai0'; use an input for each"),
        (
            "forces.wiring=loose",
            "forces.wiring must be 'differential' or 'rse' or 'nrse'; found \"loose\"",
        ),
        (
            "forces.range=[0, 10]",
            "forces.range must be two numbers, [a, b], each more than 0 and at most 100 V;",
        ),
        ("forces.sign=[1, 2]", "two whole numbers, [a, b], each 1 or -1; found [1, 2]"),
        ("camera.pixel_format=RGB8", "camera.pixel_format must be 'Mono8' or 'Mono10' or"),
        ("actuator.travel=[3, 2]", "a least and a greatest position; found 3, 2 mm"),
        ("camera.source=folder", "camera.folder must be the folder of the images"),
        ("camera.source=replay", "replay.session must be the session"),
        ("sim.faults=['no-trigger 3']", "sim.faults: no fault is called 'no-trigger'; known:"),
        (
            "about.sample='%s'" % ("x" * 101),
            "about.sample has 101 characters, 0 of them full stops;",
        ),
        ("about.note='%s'" % ("." * 101), "2000 and 100 are the most"),
        ('about.operator="a\\u001b[2J"', "about.operator has the control character '\\x1b'"),
        ('about.sample="two\\nlines"', "about.sample has the control character '\\n'"),
        ("about.note=\udc80", "about.note has the control character '\\udc80'"),
        ("about.sample=7", "about.sample must be a text in quotes; found 7"),
        ("travel=3", "'travel=3' is not table.key=value"),
        ("run.travel", "'run.travel' is not table.key=value"),
    ],
)
def test_what_can_not_be_used_is_refused_with_what_is_allowed(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load(None, [override])
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_images_decide_where_the_grey_scale_ends_unless_the_settings_do() -> None:
    assert Config().correlation == Correlation(full_scale=255)
    assert load(None, ["camera.pixel_format=Mono12p"]).correlation.full_scale == 4095
    assert load(None, ["dic.full_scale=1000"]).correlation.full_scale == 1000


def test_settings_are_held_in_si_and_written_as_they_were() -> None:
    """Whatever number somebody writes, the file that a session keeps of it says the same."""
    rng = random.Random(1)
    for _, option in all_options():
        if option.type is not float:
            continue
        for digits in (1, 2, 3, 5, 9, 12, 15):
            number = float(f"{rng.uniform(1, 10):.{digits}g}")
            assert option.written(option.si(number)) == number
        exact = rng.uniform(1, 10)
        assert option.si(option.written(option.si(exact))) == option.si(exact)
    assert as_written(load(None, ["run.travel=7.04"]).run)["travel"] == 7.04
    assert quantity(RunSettings(travel=190e-6), "travel") == "190 um"


def test_the_page_of_all_settings_is_up_to_date() -> None:
    page = Path(__file__).parents[1] / "docs" / "settings.md"
    assert page.read_text(encoding="utf-8") == reference.settings(), (
        "docs/settings.md is behind the declarations: python docs/reference.py"
    )


def test_a_record_without_a_method_is_from_before_there_was_a_choice(tmp_path: Path) -> None:
    old = "[dic]\nbox = 20\nsearch = 16\n"
    assert from_record(old, "session").dic == Correlation(method="direct", search=16)
    assert from_record("", "session").dic.method == "direct"
    assert from_record("", "session").camera.fixed_pattern == "ignore"  # replayed to the bit
    assert from_record(to_toml(Config()), "session") == Config()
    file = tmp_path / "bench.toml"  # a user's file says what he changed, and means today's method
    file.write_text(old, encoding="utf-8")
    assert load(file).dic == Correlation(method="shared", search=16)
    with pytest.raises(ConfigError, match="session: 'dic' is a table of options, found 3"):
        from_record("dic = 3", "session")


def test_a_box_must_fit_the_image() -> None:
    with pytest.raises(ConfigError, match="does not fit the 64 x 80 image"):
        load(None, ["camera.width=64", "camera.height=80", "dic.box=64"])


def test_the_smallest_allowed_divisor_is_allowed() -> None:
    assert load(None, ["camera.divisor=42"]).camera.divisor == 42


def test_a_campaign_is_no_settings_file() -> None:
    ours = campaign_file(Path("six-loads"))
    with pytest.raises(
        ConfigError, match=r"six-loads\.toml: .* `slipscope campaign .*six-loads\.toml`"
    ):
        load(ours)
    assert set(KINDS) > config.OF_CAMPAIGNS
    assert config.OF_CAMPAIGNS.isdisjoint(config.tables())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[run\n", "not a TOML file"),
        (b"\x80\x81\x82", "not a TOML file: it is no text in UTF-8; save it so"),
        (b"[run]\nnormal_force = 0,5\n", r"line 2, column .*; write 0\.5 for 0,5$"),
        (b"[run]\r\ntravel = -12,75 # um\r\n", r"; write -12\.75 for -12,75$"),
        (b"[run]\ntravel = [1,2]\nvelocity = x\n", r"column \d+\)$"),
        (b"[about]\nnote = '''\na = 1,5\n'''\n[run]\ntravel = x\n", r"column \d+\)$"),
        (None, "cannot be read: No such file"),
        (b"travel = 3\n", r"unknown table or key 'travel'; the nearest known one is 'run\.travel'"),
        (b"run = 3\n", "'run' is a table of options, found 3"),
        (b"[settings]\ntravel = 3\n", "'settings' is of the plan of a campaign"),
    ],
)
def test_a_file_that_is_no_settings_file_is_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    file = tmp_path / "bench.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=rf"^{re.escape(str(file))}.*{words}"):
        load(file)


def test_an_override_is_read_as_toml_and_else_as_a_word() -> None:
    assert parse_override("run.travel=1e2") == ("run", "travel", 100.0)
    assert parse_override("sim.renderer=exact") == ("sim", "renderer", "exact")
    assert parse_override("sim.slow_actuator = true") == ("sim", "slow_actuator", True)
    # of several lines none is dropped
    assert parse_override("run.travel=1\nw = 2") == ("run", "travel", "1\nw = 2")


def test_the_exposure_is_whole_samples_and_one_at_least() -> None:
    assert load(None, ["camera.exposure=10.4"]).exposure_samples == 10
    assert load(None, ["camera.exposure=0.01"]).exposure_samples == 1


def test_a_number_of_numpy_is_told_as_a_number() -> None:
    with pytest.raises(ValueError, match=r"found \(-1\.0, 5\)$"):
        ForceSettings(range=(np.float64(-1), 5))
