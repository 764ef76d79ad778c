"""What only Python takes for a number is none, wherever a person or another program writes one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import Result

from analysis.options import number_in
from app.cli.names import parse_pace
from app.files.height_maps import read_height_map
from app.files.text_tables import FORCES, read_table
from app.gui.form import Form, numbers_of
from app.settings.config import load
from app.settings.hung_weights import growing_newtons
from app.system.errors import UserError
from drivers.settings import ForceSettings
from drivers.sim.contact import read_law
from drivers.sim.faults import parse, timed
from drivers.sim.settings import parse_error

OF_PYTHON = ["1_0", "\u0661"]  # the second is an Arabic 1
NOT_FINITE = ["infinity", "nan", "1e999"]


def in_a_field(number: str) -> object:
    """What the window makes of a typed number."""
    form = Form(load())
    field = next(one for group in form.groups() for one in group.fields if one.key == "run.travel")
    value = field.plain(number)
    if isinstance(value, str):
        raise ValueError(value)
    return value


def in_a_file(read: Callable[[Path], object], before: str, after: str) -> Callable[[str], object]:
    """What becomes of a number in a file."""

    def written(number: str) -> object:
        path = Path("table.csv")
        path.write_text(f"{before}{number}{after}", encoding="utf-8")
        return read(path)

    return written


READERS = {
    "any": number_in,
    "pace": parse_pace,
    "weights": lambda text: growing_newtons("weights", text, "weights", most=1e3),
    "channel": lambda text: ForceSettings(auxiliary=(f"heat ai2 degC {text}",)),
    "fault": lambda text: parse(f"lost-trigger {text}"),
    "mistake": lambda text: parse_error(f"camera.pixel {text}"),
    "field": in_a_field,
    "list": lambda text: numbers_of(text, "Loads"),
    "law": in_a_file(read_law, "0,0\n", ",1\n"),
    "map": in_a_file(lambda path: read_height_map(path, 1e-6, 1e-6), "1,2\n3,", "\n"),
    "table": in_a_file(lambda path: read_table(path, FORCES), "time_s,P_N,Q_N\n", ",1,1\n"),
}
CHECKED_LATER = ("any", "field", "list", "map", "law", "table")


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("text", OF_PYTHON + NOT_FINITE)
def test_no_reader_takes_it(
    text: str, reader: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert READERS[reader]("1")
    if text in NOT_FINITE and reader in CHECKED_LATER:
        return
    with pytest.raises((ValueError, UserError)):
        READERS[reader](text)


@pytest.mark.parametrize("text", OF_PYTHON + NOT_FINITE)
def test_a_fault_at_a_time_that_is_none_is_left_as_it_is(text: str) -> None:
    assert timed("lost-trigger 1s", 100.0, 10) == "lost-trigger 10"
    assert timed(f"lost-trigger {text}s", 100.0, 10) == f"lost-trigger {text}s"


@pytest.mark.parametrize("text", OF_PYTHON + NOT_FINITE)
@pytest.mark.parametrize(
    "command", [("model", "--shear-force"), ("model", "--modulus"), ("tradeoff", "x", "--threads")]
)
def test_no_option_takes_it(
    slipscope: Callable[..., Result], command: tuple[str, ...], text: str
) -> None:
    result = slipscope(*command, text)
    assert result.exit_code > 0
    assert command[-1] in result.stderr
    assert "number" in result.stderr or "integer" in result.stderr


def test_toml_keeps_its_own_numbers() -> None:
    assert load(None, ["run.travel=1_50"]).run.travel == load(None, ["run.travel=150"]).run.travel
