"""The settings as a form, without Qt: what stands in each field, and what becomes of what is typed.

A `Form` holds settings that can be used. What is typed is checked as a settings file is, with the
same sentences; what cannot be used waits beside its field until it can, or is typed anew.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from analysis.options import Option, Section, number_in, options
from analysis.settings import PRESETS
from app.gui.cells import typeset
from app.settings.config import (
    OWN,
    ConfigError,
    altered,
    bench_names,
    keyed,
    load,
    own_options,
    read_settings,
    tables,
    to_toml,
    values_of,
    with_own,
)
from app.settings.plain_values import STEPS, step_as_written, steps_from, title
from app.settings.protocol_steps import EXAMPLE
from app.settings.sections import AboutSettings, Config
from app.settings.toml_text import parse_toml
from app.system.outputs import new_file

WHERE = "settings"  # what the sentences of the declarations call the form; left out in it
STEPS_KEY = f"run.{STEPS}"
PRESET_KEY = "dic.preset"
AS_SET = "simple drive"  # the protocol of a run without steps
OWN_STEPS = "own protocol"
EXAMPLE_STEPS = "example of six steps"
_COMMA = re.compile(r"(?<=\d),(?=\d)")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
Values = dict[str, Any]  # by their keys, in the units in which people write them
Steps = list[Values]  # of a protocol, as a settings file has them
_TEXTS = (str, tuple[str, str], tuple[str, ...])


@dataclass(frozen=True, slots=True)
class FormField:
    """One setting in the form.

    Attributes
    ----------
    key : str
        ``table.name``, as everywhere in the settings.
    option : Option
        Its declaration.
    point : str
        Before the decimals of a number, as the operator's language has it.
    """

    key: str
    option: Option
    point: str = "."

    @property
    def name(self) -> str:
        """What stands before its editor."""
        return self.option.name.replace("_", " ")

    @property
    def unit(self) -> str:
        """The unit in which it is written."""
        return typeset(self.option.unit)

    @property
    def help(self) -> str:
        """Its meaning, and what it may be."""
        wanted = "" if self.option.type is str and not self.option.choices else self.option.limits
        limits = f" Allowed: {wanted} {self.option.unit}".rstrip() + "." if wanted else ""
        return typeset(f"{self.option.meaning}.{limits}")

    def text(self, value: Any) -> str:
        """A value as people write it in a field, without its unit."""
        if isinstance(value, tuple | list):
            rows = any(isinstance(part, tuple | list) for part in value)
            return ("; " if rows else ", ").join(map(self.text, value))
        if isinstance(value, float):
            return repr(value).removesuffix(".0").replace(".", self.point)
        return str(value)

    def plain(self, text: str) -> Any:
        """What was typed as a settings file would hold it; the text itself where it is none of
        that type, so that its check says so.
        """
        kind = self.option.type
        if kind is str:
            return text
        bare = text.strip()
        if self.point == "," and kind not in _TEXTS:
            bare = _COMMA.sub(".", bare)
        if self.option.unit:
            bare = re.sub(rf"\s*({re.escape(self.option.unit)}|{re.escape(self.unit)})$", "", bare)
        if kind is bool:
            return {"True": True, "False": False}.get(bare, text)
        if kind in (float, int):
            value = _number(bare)
            is_whole = kind is int and isinstance(value, float) and value.is_integer()
            return int(value) if is_whole else value
        if kind == tuple[tuple[float, float], tuple[float, float]]:
            return [[_number(one) for one in row.split(",")] for row in bare.split(";")]
        parts = [part.strip() for part in bare.split(",") if part.strip()]
        return parts if kind in _TEXTS else [_number(part) for part in parts]

    def is_like(self, words: Sequence[str]) -> bool:
        """Whether somebody who looks for these words may mean it."""
        about = f"{self.key} {self.name} {self.help} {self.option.meaning}".casefold()
        return all(word in about for word in words)


def fields_of(table: str, kind: type[Section], point: str) -> list[FormField]:
    """The fields of a section of settings, whose keys begin with the name of its table."""
    return [FormField(f"{table}.{name}", one, point) for name, one in options(kind).items()]


def text_field(key: str, meaning: str, choices: tuple[str, ...] = ()) -> FormField:
    """A field for a text, or one of several, that is no setting of the declarations."""
    declared = options(AboutSettings)["note"]
    return FormField(key, replace(declared, name=key, meaning=meaning, choices=choices))


def _number(text: str) -> Any:
    """The number that a text is, or else the text."""
    try:
        number = number_in(text)
    except ValueError:
        return text
    return int(text) if text.strip("+- ").isdigit() else number


def numbers_of(text: str, what: str) -> list[float]:
    """The numbers in a text, apart by blanks or semicolons, with a point or a comma.

    Raises
    ------
    ConfigError
        One of them is no number.
    """
    found = []
    for part in text.replace(";", " ").split():
        value = _number(part.strip(",").replace(",", "."))
        if isinstance(value, str):
            raise ConfigError(
                f"{what}: '{part[:40]}' is no number; write them apart by blanks, as in 0.1 0.3 0.5"
            )
        found.append(float(value))
    return found


@dataclass(frozen=True, slots=True)
class FormGroup:
    """A table of the settings."""

    table: str
    title: str
    fields: tuple[FormField, ...]


@dataclass(frozen=True, slots=True)
class RefusedEntry:
    """What was typed and cannot be used: its text, the plain value, and why."""

    text: str
    value: Any
    sentence: str = ""


@dataclass(frozen=True, slots=True)
class Base:
    """Settings that those of the form are compared with, and what they are."""

    name: str
    config: Config


DEFAULTS = Base("the defaults", Config())


class Form:
    """The settings of the next run, field by field.

    Attributes
    ----------
    config : Config
        That can be used; what was refused is not in it.
    base : Base
        What is marked as changed differs from this; a reset takes its value.
    refused : dict
        Key -> what was typed and cannot be used; it is tried again with whatever is typed next.
    point : str
        Before the decimals of a number, as the operator's language has it.
    """

    def __init__(self, config: Config, point: str = ".") -> None:
        self.config, self.point = config, point
        self.base = DEFAULTS
        self.refused: dict[str, RefusedEntry] = {}

    # ------------------------------------------------------------------ what there is

    def groups(self) -> tuple[FormGroup, ...]:
        """All settings by table; a driver's own follow those of its device."""
        own = own_options(self.config)
        made = []
        for table, kind in tables().items():
            fields = fields_of(table, kind, self.point)
            if table in own:
                fields += fields_of(f"{table}.{OWN}", type(own[table]), self.point)
            made.append(FormGroup(table, typeset(title(kind)), tuple(fields)))
        return tuple(made)

    def field(self, key: str) -> FormField:
        """The field of this key."""
        return next(one for group in self.groups() for one in group.fields if one.key == key)

    def values(self) -> Values:
        """Key -> value of every setting, in the units in which people write them."""
        return _flat(self.config)

    def base_values(self) -> Values:
        """The same of the base, which may lack some of a driver's own."""
        return _flat(self.base.config)

    def changed(self) -> dict[str, tuple[Any, Any]]:
        """Key -> value and that of the base, of every setting in which the two differ."""
        here, there = self.values(), self.base_values()
        return {key: (here.get(key), there.get(key)) for key in here if here[key] != there.get(key)}

    def steps(self) -> Steps:
        """The steps of the protocol as a settings file has them, also while they cannot be used;
        of a run without steps those that its other settings stand for.
        """
        refused, run = self.refused.get(STEPS_KEY), self.config.run
        if refused is not None:
            return [dict(step) for step in refused.value]
        written = [(step, step_as_written(step)) for step in run.steps or run.protocol]
        for step, one in written if not run.steps else ():
            for name, of in step.like_run.items():
                if getattr(step, name) == getattr(run, of):
                    one.pop(name, None)
        return [one for _, one in written]

    def protocol(self) -> str:
        """Which of `protocols` the run has; those of its own while some cannot be used."""
        if STEPS_KEY in self.refused:
            return OWN_STEPS
        steps, known = self.config.run.steps, protocols().items()
        return next((name for name, held in known if steps_from(held) == steps), OWN_STEPS)

    # ------------------------------------------------------------------ what is done with it

    def put(self, key: str, value: Any, text: str | None = None) -> bool:
        """Let a setting be `value`, as a settings file would hold it; whether it can be.

        What was refused before is tried again with it: two settings may only be right together.
        """
        if text is None:
            text = str(value) if key == STEPS_KEY else self.field(key).text(value)
        self.refused.pop(key, None)
        self.refused = {key: RefusedEntry(text, value), **self.refused}
        self._take()
        return key not in self.refused

    def type(self, field: FormField, text: str) -> bool:
        """Let a setting be what was typed; whether it can be."""
        return self.put(field.key, field.plain(text), text)

    def put_steps(self, steps: Steps) -> bool:
        """Let the run have these steps; whether it can."""
        return self.put(STEPS_KEY, steps)

    def reset(self, key: str) -> bool:
        """Let a setting be as in the base."""
        held = self.base_values()
        return self.put(key, held[key] if key in held else self.field(key).option.default)

    def replace(self, config: Config) -> None:
        """Have other settings; what was refused is forgotten."""
        self.config = config
        self.refused.clear()

    # ------------------------------------------------------------------ checks

    def _take(self) -> None:
        """Use of what was typed as much as can be used: all at once, or else one by one."""
        if self._take_these(list(self.refused)):
            return
        while any(self._take_these([key]) for key in list(self.refused)):
            pass

    def _take_these(self, keys: list[str]) -> bool:
        """Whether these can be used together; else each has the sentence that says why not."""
        try:
            self.config = self._with({key: self.refused[key].value for key in keys})
        except ConfigError as error:
            sentence = typeset(str(error).removeprefix(f"{WHERE}: "))
            for key in keys:
                one = self.refused[key]
                text, hint = one.text.strip(), ""
                if isinstance(one.value, str) and _DECIMAL_COMMA.fullmatch(text):
                    hint = f"; write it with a point: {text.replace(',', '.')}"
                self.refused[key] = replace(one, sentence=sentence + hint)
            return False
        for key in keys:
            del self.refused[key]
        return True

    def _with(self, written: Values) -> Config:
        data = values_of(self.config)
        changes = []
        for key, value in written.items():
            table, _, name = key.partition(".")
            if key == STEPS_KEY:
                data[table][STEPS] = value
                if value and not self.config.run.steps:
                    data[table]["reversals"] = 0  # the steps say how it turns
                continue
            if name == "source" and value != data[table]["source"]:
                data[table].pop(OWN, None)  # of another driver
            changes.append((table, name, value))
        return altered(data, changes, WHERE, None)


def read_base(path: Path) -> Base:
    """The settings of a file, or of a bench that comes with the program; ConfigError if it cannot
    be used.
    """
    return Base(path.name, load(path))


def write_base(path: Path, config: Config) -> Base:
    """Write a settings file, which `slipscope run` takes; UserError if it cannot be."""
    with new_file(path, overwrite=True) as unfinished:
        unfinished.write_text(to_toml(config), encoding="utf-8")
    return Base(path.name, config)


def steps_in_words(config: Config) -> tuple[str, ...]:
    """What a run of these settings does, step by step."""
    return tuple(typeset(str(step)) for step in config.run.protocol)


@cache
def protocols() -> dict[str, Steps]:
    """Name -> steps as a settings file has them, of the protocols that can be chosen: none, the
    example, and those of the benches that come with the program.
    """
    benches = {name: read_settings(Path(name)).get("run", {}).get(STEPS) for name in bench_names()}
    chosen = {AS_SET: [], EXAMPLE_STEPS: parse_toml(EXAMPLE)["run"][STEPS]}
    return chosen | {name: steps for name, steps in benches.items() if steps}


def preset_of(config: Config) -> str:
    """The preset whose settings the correlation has, or "custom"."""
    dic = config.dic
    has = (
        name
        for name, given in PRESETS.items()
        if all(getattr(dic, key) == value for key, value in given.items())
    )
    return next(has, "custom")


def _flat(config: Config) -> Values:
    """Key -> value of every setting, as written."""
    return with_own({STEPS_KEY: [], **keyed(config), PRESET_KEY: preset_of(config)}, config)
