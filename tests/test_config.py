"""The settings file: what it says is what is read, and whatever can not be used is refused in one
sentence.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from analysis.dic import INTERPOLANTS, METHODS, Correlation
from app import config
from app.config import (
    ConfigError,
    correlation,
    from_data,
    from_record,
    load,
    parse_override,
    to_toml,
)
from app.sections import Config, Dic


def all_options() -> list[tuple[str, str]]:
    return [
        (table, key)
        for table, (kind, _) in config.options(Config).items()
        for key in config.options(kind)
    ]


def test_the_default_file_reads_back_as_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text(config.default_toml(), encoding="utf-8")
    assert load(file) == Config()


def test_the_default_file_explains_every_option() -> None:
    lines = config.default_toml().splitlines()
    for table, key in all_options():
        at = next(
            i
            for i, line in enumerate(lines)
            if line.startswith(f"{key} = ") and f"[{table}]" in lines[: i + 1]
        )
        assert lines[at - 1].startswith("# "), f"{table}.{key}"


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
    assert changed.run.travel == 151.5
    assert changed.forces.zero == (0.25, -1e-3)
    assert from_data(tomllib.loads(to_toml(changed, comments=False)), "again") == changed


def test_an_override_wins_over_the_file(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("[run]\ntravel = 100\nvelocity = 4\n", encoding="utf-8")
    settings = load(file, ["run.travel=120"])
    assert (settings.run.travel, settings.run.velocity) == (120.0, 4.0)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_a_file_redirected_by_any_shell_is_read(tmp_path: Path, encoding: str) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("[run] # Q für a\ntravel = 77\n", encoding=encoding)
    assert load(file).run.travel == 77


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
            "correlation: double precision asked of method 'shared'; use method 'icgn', or single"
            " precision",
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
        (
            "run.normal_force=1.9",
            "run.normal_force = 1.9 N is not below limits.normal_force = 1.9 N",
        ),
        ("forces.coupling=[[1, 1], [1, 1]]", "forces.coupling has no inverse"),
        ("travel=3", "'travel=3' is not table.key=value"),
        ("run.travel", "'run.travel' is not table.key=value"),
    ],
)
def test_what_can_not_be_used_is_refused_with_what_is_allowed(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load(None, [override])
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_settings_of_the_correlation_are_its_own() -> None:
    """Same names, same defaults, same choices; 0 stands for what the method or the images decide."""
    assert correlation(Dic()) == Correlation()
    changed = load(
        None,
        [
            "dic.method=icgn",
            "dic.precision=double",
            "dic.tolerance=0.01",
            "dic.full_scale=4095",
            "dic.update=every",
        ],
    ).dic
    assert correlation(changed) == Correlation(
        method="icgn", precision="double", tolerance=0.01, full_scale=4095, update="every"
    )
    for key, words in [("method", METHODS), ("interpolant", INTERPOLANTS)]:
        assert config.options(Dic)[key][1].pattern == f"^({'|'.join(words)})$"


def test_a_record_without_a_method_is_from_before_there_was_a_choice(tmp_path: Path) -> None:
    old = "[dic]\nbox = 20\nsearch = 16\n"
    assert from_record(old, "session").dic == Dic(method="direct", search=16)
    assert from_record("", "session").dic.method == "direct"
    assert from_record(to_toml(Config()), "session") == Config()
    file = tmp_path / "bench.toml"  # a user's file says what he changed, and means today's method
    file.write_text(old, encoding="utf-8")
    assert load(file).dic == Dic(method="shared", search=16)
    with pytest.raises(ConfigError, match="session: 'dic' is a table of options, found 3"):
        from_record("dic = 3", "session")


def test_a_box_must_fit_the_image() -> None:
    with pytest.raises(ConfigError, match="does not fit the 64 x 80 image"):
        load(None, ["camera.width=64", "camera.height=80", "dic.box=64"])


def test_the_smallest_allowed_divisor_is_allowed() -> None:
    assert load(None, ["camera.divisor=42"]).camera.divisor == 42


def test_a_key_above_the_tables_is_named(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("travel = 3\n", encoding="utf-8")
    with pytest.raises(
        ConfigError,
        match=r"bench\.toml: unknown table or key 'travel'; the nearest known one is 'run\.travel'",
    ):
        load(file)


def test_a_table_that_is_a_number_is_named(tmp_path: Path) -> None:
    file = tmp_path / "bench.toml"
    file.write_text("run = 3\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="'run' is a table of options, found 3"):
        load(file)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"[run\n", "not a TOML file"),
        (b"\x80\x81\x82", "not a TOML file"),
        (None, "can not be read: No such file"),
    ],
)
def test_a_file_that_is_no_settings_file_is_refused(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    file = tmp_path / "bench.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigError, match=words):
        load(file)


def test_an_override_is_read_as_toml_and_else_as_a_word() -> None:
    assert parse_override("run.travel=1e2") == ("run", "travel", 100.0)
    assert parse_override("sim.renderer=exact") == ("sim", "renderer", "exact")
    assert parse_override("sim.slow_actuator = true") == ("sim", "slow_actuator", True)


def test_the_exposure_is_whole_samples_and_one_at_least() -> None:
    assert config.exposure_samples(load(None, ["camera.exposure=10.4"])) == 10
    assert config.exposure_samples(load(None, ["camera.exposure=0.01"])) == 1
