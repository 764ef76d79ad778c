"""A command that a signal ends says so in one sentence, whatever compiled code made of it."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import NoReturn

import pytest
import typer

from app import cli
from app.cli import program
from app.cli.terminal import plain_errors
from app.system import interrupting
from app.system.errors import UserError
from drivers.errors import DeviceError


@pytest.mark.parametrize("kind", [KeyboardInterrupt(), SystemExit(130)])
def test_ctrl_c_before_a_command_has_begun_is_one_sentence(
    kind: BaseException, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> None:
        raise kind

    monkeypatch.setattr(program, "main", interrupted)
    # this program goes on, and hears of them
    monkeypatch.setattr(interrupting, "ignore_signals_to_end", lambda: None)
    monkeypatch.setattr(interrupting, "heed_signal_to_end", lambda: None)
    monkeypatch.setattr(sys, "argv", ["slipscope", "info", "a.h5"])
    with pytest.raises(SystemExit, match="1"):
        cli.main()
    assert capsys.readouterr().err == "slipscope: Ctrl-C: nothing was done\n"


@pytest.fixture
def heeded() -> Iterator[None]:
    """Signals to end are those of a program that has just begun while a test lasts."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in interrupting.REASONS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    interrupting.heed_signal_to_end()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
    interrupting.HEARD.clear()


def lose(number: int, error: Exception) -> NoReturn:
    """Raise an error in the place of the interrupt of a signal, as compiled code may."""
    with suppress(KeyboardInterrupt):
        signal.raise_signal(number)
    raise error


@pytest.mark.parametrize(
    "objection",
    [SystemError("a result with an exception set"), ImportError("initialization failed")],
)
@pytest.mark.parametrize("number", interrupting.REASONS)
@pytest.mark.usefixtures("heeded")
def test_a_signal_to_end_that_compiled_code_has_lost_is_told_as_such(
    number: signal.Signals, objection: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    told = capsys.readouterr
    with pytest.raises(typer.Exit), plain_errors(as_json=False, debug=False, computes=False):
        lose(number, objection)
    reason = interrupting.REASONS[number]
    assert told().err.startswith(f"slipscope: {reason}: left before the end; what was")
    # of the next command it is not the end
    with pytest.raises(typer.Exit), plain_errors(as_json=False, debug=False, computes=False):
        raise objection
    assert told().err.startswith(f"slipscope: unexpected {type(objection).__name__}: ")


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("error", [UserError("a.h5: no session"), DeviceError("camera: silent")])
def test_an_error_that_says_what_is_wrong_is_told_after_a_signal_too(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit), plain_errors(as_json=False, debug=False, computes=False):
        lose(signal.SIGINT, error)
    assert capsys.readouterr().err == f"slipscope: {error}\n"


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("is_heard", [True, False])
def test_a_signal_to_end_that_an_import_has_lost_is_one_sentence(
    is_heard: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def imported() -> None:
        objection = ImportError("initialization failed")
        if is_heard:
            lose(signal.SIGTERM, objection)
        raise objection

    monkeypatch.setattr(program, "main", imported)
    monkeypatch.setattr(interrupting, "ignore_signals_to_end", lambda: None)
    monkeypatch.setattr(sys, "argv", ["slipscope", "info", "a.h5"])
    with pytest.raises(SystemExit if is_heard else ImportError, match="1" if is_heard else "init"):
        cli.main()
    told = "slipscope: the signal to end: nothing was done\n" if is_heard else ""
    assert capsys.readouterr().err == told
