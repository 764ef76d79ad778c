"""Sections of settings from plain values, in the units in which people write them, and back; the
steps of a protocol among them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from analysis.options import Section, SettingError, as_written, options
from app.settings.protocol_steps import DO, EXAMPLE, KINDS, Step
from app.system.errors import ConfigError

STEPS = "steps"  # the list of tables of a protocol, within that of the run
LONGEST_QUOTE = 200  # characters of somebody's text in an error

S = TypeVar("S", bound=Section)


def section_from(kind: type[S], written: dict[str, Any], name: Callable[[str], str]) -> S:
    """A section from plain values, in the units in which people write them.

    Parameters
    ----------
    name : callable
        What the errors call an option, given its name in the section.

    Raises
    ------
    ConfigError
        A value cannot be used, or two cannot be used together.
    """
    try:
        written = kind.resolved(written)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    values = {}
    for key, value in written.items():
        declared = options(kind)[key]
        if (number := _not_finite(value)) is not None:
            raise ConfigError(f"{name(key)}: a finite number is needed; found {number}")
        try:
            values[key] = declared.si(msgspec.convert(value, declared.type))
        except msgspec.ValidationError:
            raise _refused(name(key), declared.wanted, value) from None
    try:
        return kind(**values)
    except SettingError as error:
        key = error.option.name
        raise _refused(name(key), error.option.wanted, written[key]) from None
    except ValueError as error:
        raise ConfigError(str(error)) from None


def _refused(name: str, wanted: str, value: Any) -> ConfigError:
    sentence = f"{name} must be {wanted}; found {brief(toml_text(value))}"
    if wanted.startswith("a number") and re.fullmatch(r"[+-]?\d+,(?!\d{3}$)\d+", str(value)):
        sentence += f"; write {str(value).replace(',', '.')}"
    return ConfigError(sentence)


def _not_finite(value: Any) -> float | None:
    """The first number in a value that is not finite; None if all are."""
    parts = value if isinstance(value, list | tuple) else ()
    found = [value] if isinstance(value, float) else map(_not_finite, parts)
    return next((n for n in found if n is not None and not math.isfinite(n)), None)


def brief(text: str) -> str:
    """A text as it can be quoted."""
    return text if len(text) <= LONGEST_QUOTE else f"{text[: LONGEST_QUOTE // 2]} ..."


def toml_text(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool | str):
        return msgspec.json.encode(value).decode()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_text, value)) + "]"
    return repr(value)


# ---------------------------------------------------------------------- steps


def steps_from(given: Any) -> tuple[Step, ...]:
    """The steps of a protocol from plain data."""
    if not isinstance(given, list) or not all(isinstance(one, dict) for one in given):
        raise ConfigError(
            f"run.{STEPS} is a list of tables, found {brief(repr(given))}; write [[run.{STEPS}]]"
            " above each step"
        )
    return tuple(_step(number, one) for number, one in enumerate(given, 1))


def _step(number: int, given: dict[str, Any]) -> Step:
    kind, where = given.get(DO), f"run.{STEPS}: step {number}"
    known = f"known: {', '.join(KINDS)}"
    if kind is None:
        raise ConfigError(
            f"{where} does not say what it is; write {DO} = one of its kinds, {known}"
        )
    if not isinstance(kind, str) or kind not in KINDS:
        raise ConfigError(f"{where}: there is no kind {brief(toml_text(kind))} of steps; {known}")
    step, where = KINDS[kind], f"{where} ({kind})"
    keys = options(step)
    for key in given:
        if key != DO and key not in keys:
            raise ConfigError(f"{where}: it has no key '{brief(key)}'; it has {', '.join(keys)}")
    for key in step.needs:
        if key not in given:
            raise ConfigError(f"{where}: it needs {key}, {keys[key].wanted}")
    plain = {key: value for key, value in given.items() if key != DO}
    return section_from(step, plain, f"{where}: {{}}".format)


def step_as_written(step: Step) -> dict[str, Any]:
    """What is written of a step: what it needs, and what is not as by default."""
    keys = options(type(step))
    values = as_written(step).items()
    return {DO: step.kind} | {
        key: value for key, value in values if key in step.needs or value != keys[key].default
    }


def steps_lines(steps: tuple[Step, ...], comments: bool) -> list[str]:
    """The steps as lines of TOML; with comments, an example where there are none."""
    lines = []
    if comments and not steps:
        lines += ["# The steps of the run, if not those of [run] (the manual: protocols):"]
        lines += [f"# {line}".rstrip() for line in EXAMPLE.splitlines()] + [""]
    for step in steps:
        written = step_as_written(step).items()
        lines += [f"[[run.{STEPS}]]", *(f"{k} = {toml_text(v)}" for k, v in written), ""]
    return lines


def title(kind: type[Section]) -> str:
    """The first paragraph of a section's docstring, on one line."""
    return " ".join((kind.__doc__ or "").partition("\n\n")[0].split())
