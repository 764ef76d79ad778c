"""How a setting is declared, once.

A section of settings is a frozen dataclass whose fields are made by `option`: a default, what the
setting means, the unit in which people write it, and its limits. Everything else follows from that
declaration: the settings file and its comments, the options of the command line, the checks and
their sentences, the table in the documentation. Instances hold SI units.

Nothing heavy is imported here: the command line needs the declarations before it does anything.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from inspect import cleandoc
from textwrap import fill, indent
from typing import Any, TypeVar, get_type_hints

UNITS = {
    # what is SI already, or is counted
    **dict.fromkeys(
        ("", "N", "N/m", "V", "Hz", "s", "N/V", "baud", "dB", "electrons", "frames/s"), 1.0
    ),
    **dict.fromkeys(("grey levels", "images", "px", "px/s", "samples", "A", "degC"), 1.0),
    "%": 1e-2,
    "N/mm": 1e3,
    "um": 1e-6,
    "um/N": 1e-6,
    "um/V": 1e-6,
    "um/s": 1e-6,
    "mm": 1e-3,
    "mm/s": 1e-3,
    "mm/s2": 1e-3,
    "mA": 1e-3,
    "ms": 1e-3,
    "mN": 1e-3,
    "mJ/m2": 1e-3,
    "MPa": 1e6,
    "kPa": 1e3,
    "kPa/um": 1e9,
    "uJ": 1e-6,
    "degrees": math.pi / 180,
}
"""Unit in which a setting is written -> factor to the one in which it is held."""

KINDS = {
    float: "a number",
    int: "a whole number",
    bool: "true or false",
    str: "a text in quotes",
    tuple[float, float]: "two numbers, [a, b]",
    tuple[int, int]: "two whole numbers, [a, b]",
    tuple[str, str]: 'two texts in quotes, ["a", "b"]',
    tuple[str, ...]: 'texts in quotes, ["a", "b"]',
    tuple[tuple[float, float], tuple[float, float]]: ("two rows of two numbers, [[a, b], [c, d]]"),
}
"""The types that a setting may have, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One setting as its owner declares it.

    Attributes
    ----------
    name : str
    type : type
        One of `KINDS`.
    default
        In the unit in which people write it, like the limits.
    meaning, unit : str
    gt, ge, lt, le : float or None
        Limits of the number, or of each number of a tuple.
    choices : tuple
        All that it may be; empty where other values are possible.
    """

    name: str = ""
    type: Any = None
    default: Any
    meaning: str
    unit: str
    gt: float | None
    ge: float | None
    lt: float | None
    le: float | None
    choices: tuple[Any, ...]

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise ValueError(
                f"option: the unit '{self.unit}' ({self.meaning}) is not known; use one of"
                f" {', '.join(filter(None, UNITS))}, or none"
            )

    @property
    def limits(self) -> str:
        """The limits or choices in words, ``more than 0 and at most 10``; or empty."""
        if self.choices:
            return " or ".join(f"'{c}'" if isinstance(c, str) else f"{c}" for c in self.choices)
        words = (
            ("more than", self.gt),
            ("at least", self.ge),
            ("less than", self.lt),
            ("at most", self.le),
        )
        return " and ".join(f"{word} {limit:g}" for word, limit in words if limit is not None)

    @property
    def wanted(self) -> str:
        """What a value may be, in words: ``a number more than 0 and at most 10 N``."""
        if self.choices and self.type is str:
            return self.limits
        each = ", each" if self.type in (tuple[float, float], tuple[int, int]) else ""
        limits = f"{each} {self.limits} {self.unit}" if self.limits else ""
        return (KINDS[self.type] + (limits or (self.unit and f" in {self.unit}"))).rstrip()

    def si(self, written: Any) -> Any:
        """The value that is held for one that somebody wrote."""
        factor = UNITS[self.unit]
        return written if factor == 1 else _each(lambda number: number * factor, written)

    def written(self, value: Any) -> Any:
        """What somebody would write for a value that is held: `si` gives the same value again."""
        factor = UNITS[self.unit]
        return value if factor == 1 else _each(lambda number: _shortest(number, factor), value)

    def allows(self, value: Any) -> bool:
        """Whether a value that is held lies within the limits, or is one of the choices."""
        if self.choices:
            return all(part in self.choices for part in _parts(value))
        factor = UNITS[self.unit]
        return all(
            (self.gt is None or number > self.gt * factor)
            and (self.ge is None or number >= self.ge * factor)
            and (self.lt is None or number < self.lt * factor)
            and (self.le is None or number <= self.le * factor)
            for number in _parts(value)
            if not isinstance(number, str)
        )


def option(
    default: Any,
    meaning: str,
    unit: str = "",
    *,
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
    choices: tuple[Any, ...] = (),
) -> Any:
    """The declaration of a setting, as a field of a `Section`; see `Option`."""
    declared = Option(
        default=default, meaning=meaning, unit=unit, gt=gt, ge=ge, lt=lt, le=le, choices=choices
    )
    return field(default=declared.si(default), metadata={"option": declared})


def like(section: type[Section], name: str) -> Any:
    """A field that is declared as another one is, for a section that needs the same setting."""
    declared = options(section)[name]
    return field(default=declared.si(declared.default), metadata={"option": declared})


def number_in(text: str) -> float:
    """The number that somebody wrote, with a point; it need not be finite.

    Raises
    ------
    ValueError
        It is none, or only Python takes it for one: ``1_000``, digits that are not those of ASCII.
    """
    if "_" in text or not text.strip().isascii():
        raise ValueError(f"'{text[:40]}' is no number")
    return float(text)


class SettingError(ValueError):
    """A value is outside its limits, or none of its choices.

    Attributes
    ----------
    option : Option
    """

    def __init__(self, option: Option, value: Any) -> None:
        found = _each(lambda part: getattr(part, "tolist", lambda: part)(), option.written(value))
        super().__init__(f"{option.name} must be {option.wanted}; found {found!r}")
        self.option = option


@dataclass(frozen=True, kw_only=True)
class Section:
    """Base of all sections: no instance has a value outside its limits.

    Raises
    ------
    SettingError
        A value is.
    """

    @classmethod
    def resolved(cls, written: dict[str, Any]) -> dict[str, Any]:
        """The settings that somebody wrote, by name, with those that one of them stands for."""
        return written

    def __post_init__(self) -> None:
        for name, declared in options(type(self)).items():
            if not declared.allows(value := getattr(self, name)):
                raise SettingError(declared, value)


def options(section: type[Section]) -> dict[str, Option]:
    """Name -> declaration of every setting of a section, in order."""
    if section not in _DECLARED:
        types = get_type_hints(section)
        _DECLARED[section] = {
            f.name: replace(f.metadata["option"], name=f.name, type=types[f.name])
            for f in fields(section)
            if "option" in f.metadata
        }
    return _DECLARED[section]


_DECLARED: dict[type[Section], dict[str, Option]] = {}
Kind = TypeVar("Kind", bound=Section)


def described(section: type[Kind]) -> type[Kind]:
    """The section, its parameters added to its docstring."""
    # since Python 3.13 a docstring comes without its indentation
    lines = [cleandoc(section.__doc__ or ""), "", "Parameters", "----------"]
    for name, one in options(section).items():
        kind = ", ".join(filter(None, (one.type.__name__, one.unit, one.limits)))
        lines += [f"{name} : {kind}; default {one.default!r}"]
        lines += [indent(fill(f"{one.meaning}.", 88), " " * 4)]
    section.__doc__ = "\n".join(lines) + "\n"
    return section


def as_written(section: Section) -> dict[str, Any]:
    """Name -> value of every setting of a section, in the units in which people write them."""
    return {
        name: declared.written(getattr(section, name))
        for name, declared in options(type(section)).items()
    }


def quantity(section: Section, name: str) -> str:
    """A setting with its unit, for people: ``190 um``."""
    declared = options(type(section))[name]
    numbers = _parts(declared.written(getattr(section, name)))
    return f"{', '.join(f'{number:g}' for number in numbers)} {declared.unit}".rstrip()


def _each(convert: Callable[[float], float], value: Any) -> Any:
    return (
        tuple(_each(convert, part) for part in value)
        if isinstance(value, tuple)
        else convert(value)
    )


def _parts(value: Any) -> Iterator[Any]:
    if isinstance(value, tuple):
        for part in value:
            yield from _parts(part)
    else:
        yield value


def _shortest(value: float, factor: float) -> float:
    """The shortest number whose product with `factor` is `value`, or else the nearest."""
    near = value / factor
    tries = [float(f"{near:.{digits}g}") for digits in (15, 16)]
    tries += [near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf)]
    return next((number for number in tries if number * factor == value), near)
