"""Settings spoiled in any way are read, or refused with one sentence that is not long, at once."""

from __future__ import annotations

import random
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from spoiled_settings import spoil_settings

from app.settings.config import ConfigError, from_record, load, to_toml, values_of
from app.settings.sections import Config
from app.settings.toml_text import LONGEST_TOML, parse_toml

KEYS = [f"{table}.{key}" for table, values in values_of(Config()).items() for key in values]
PLAIN = st.one_of(st.booleans(), st.integers(-(2**70), 2**70), st.floats(), st.text(max_size=20))
VALUES = st.recursive(PLAIN, lambda inner: st.lists(inner, max_size=3), max_leaves=6)


def toml(value: object) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(toml(part) for part in value)}]"
    return (
        '"' + "".join(f"\\U{ord(c):08x}" for c in value) + '"'
        if isinstance(value, str)
        else repr(value)
    )


def read_or_refused(path: Path, overrides: list[str]) -> Config | None:
    try:
        return load(path, overrides)
    except ConfigError as error:
        assert 10 < len(str(error)) < 2000  # noqa: PT017  (either outcome is right)
        return None


@pytest.mark.slow
@settings(
    max_examples=100,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.dictionaries(st.sampled_from(KEYS), VALUES, min_size=1, max_size=3))
def test_any_value_of_an_option(tmp_path: Path, found: dict[str, object]) -> None:
    """The same in a file and by --set; what is taken is of the option's own type."""
    path = tmp_path / "bench.toml"
    texts = [f"{key} = {toml(value)}" for key, value in found.items()]
    path.write_text("\n".join(texts), encoding="utf-8")
    empty = tmp_path / "empty.toml"
    empty.write_text("")
    from_file, from_overrides = read_or_refused(path, []), read_or_refused(empty, texts)
    assert from_file == from_overrides
    if from_file is not None:
        path.write_text("\n".join(texts), encoding="utf-8")
        for key in found:
            table, _, name = key.partition(".")
            assert isinstance(
                getattr(getattr(from_file, table), name), bool | int | float | str | tuple
            )


@pytest.mark.parametrize("seed", range(60))
def test_any_file(tmp_path: Path, seed: int) -> None:
    content = spoil_settings(random.Random(seed))
    path = tmp_path / "bench.toml"
    path.write_bytes(content)
    read_or_refused(path, [])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[run]\ntravel = " + "[" * 30_000, "nested too deeply"),
        ("[" + ".".join("a" * 10_000) + "]", "more than 100 dots"),
        ("[run]\ntravel = 1" + "0" * 70_000, "more than 65536 characters"),
        ("[run]\ntravel = 1" + "0" * 5000, "not a TOML file|run.travel must be"),
        ("[run]\n" + "x" * 60_000 + " = 1", r"unknown key 'run\.x+ \.\.\.'"),
        ('[run]\ntravel = "' + "x" * 60_000 + '"', r'run\.travel must be .*; found "x+ \.\.\.'),
    ],
)
def test_monsters_are_refused_briefly(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=sentence) as caught:
        load(path)
    assert len(str(caught.value)) < 600


def test_a_session_given_as_settings_is_not_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_bytes(bytes(1 << 26))  # not holes, which are refused before anything is read
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match="not a TOML file"):
            load(path)
        assert tracemalloc.get_traced_memory()[1] < 1 << 23
    finally:
        tracemalloc.stop()


def test_the_settings_of_a_run_can_be_read_from_its_session(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    asks = f'{{do = "ask", question = "{"x" * 199}."}},\n' * 190
    contact = '{do = "approach"}, {do = "reference"}, {do = "drive"}'
    path.write_text(f"[run]\nsteps = [\n{asks}{contact}]")
    config = load(path)
    assert len(written := to_toml(config)) > LONGEST_TOML
    assert from_record(written, "sample7.h5") == config
    numbers = [n * 1.5e-6 for n in range(128)]  # a table of a driver, which is one line there
    assert parse_toml(f"table = {numbers}") == {"table": numbers}
    path.write_text(f"""[run]\nsteps = [{{do = "ask", question = "P{"." * 101}"}}]""")
    with pytest.raises(ConfigError, match="more than 100"):
        load(path)


def test_settings_of_a_session_that_are_none_are_told() -> None:
    for text in ("[run", "a = " + "[" * 5000, "[run]\nnormal_force = -1", "dic = 3"):
        with pytest.raises(ConfigError, match=r"^sample7\.h5: "):
            from_record(text, "sample7.h5")
