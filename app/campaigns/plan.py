"""The file of a campaign, and the runs that it plans: the settings and the session of each."""

from __future__ import annotations

import difflib
import re
import string
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import count, product
from pathlib import Path
from typing import Any

from analysis.options import as_written, quantity
from app.settings.certificates import located
from app.settings.config import (
    CAMPAIGNS,
    OWN,
    Change,
    altered,
    bench_file,
    campaign_names,
    keyed,
    own_file,
    parse_override,
    read_settings,
)
from app.settings.sections import Config
from app.settings.toml_text import decoded, read_toml
from app.settings.trusted_settings import check_local
from app.system.errors import ConfigError, UserError
from drivers.sources import natures_of

KINDS: dict[str, tuple[type, str]] = {
    "name": (str, "a text in quotes"),
    "bench": (str, "a settings file, or a bench of the program, in quotes"),
    "sessions": (str, 'the names of the sessions in quotes, such as "{name}-{load}N-{repeat}"'),
    "pauses": (bool, "true or false: whether the operator is waited for before each run"),
    "repeats": (int, "a whole number from 1 to 1000"),
    "settings": (dict, "tables of settings that all runs have, under [settings]"),
    "vary": (dict, "tables of settings, each with a list of its values, under [vary]"),
    "runs": (list, "tables of settings, each under [[runs]]"),
}
MOST_RUNS = 1000
MOST_LISTED, MOST_NAMED = 5, 12  # runs whose faults or names are told at once
ALWAYS_SHOWN = ("run.normal_force", "run.velocity", "about.sample", "about.note", "sim.seed")
SHORT = {"load": "run.normal_force", "velocity": "run.velocity", "sample": "about.sample"}
_FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[defgs]?")
_NAME = re.compile(r"[^\x00-\x1f\x7f-\x9f/\\:*?\"<>|]{1,150}")  # of a file on any system


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run of a campaign.

    Attributes
    ----------
    number : int
        From 1.
    session : Path
    config : Config
    varied : dict
        ``table.key`` -> value, as in the settings file, of what is not the same in all runs.
    """

    number: int
    session: Path
    config: Config
    varied: dict[str, Any]

    @property
    def name(self) -> str:
        """Of its session, without the ending."""
        return self.session.stem


@dataclass(frozen=True, slots=True)
class Campaign:
    """Runs, one after the other.

    Attributes
    ----------
    file : Path
        In which they are planned.
    text : str
        What that says, with what the command line changed.
    folder : Path
        Where the sessions lie.
    pauses : bool
        Whether the operator is waited for before each run.
    """

    name: str
    file: Path
    text: str
    folder: Path
    pauses: bool
    runs: tuple[PlannedRun, ...]


def campaign_file(path: Path) -> Path:
    """The file at `path`, or else the campaign of that name that comes with the program."""
    return own_file(path, CAMPAIGNS)


def read_campaign(
    path: Path, folder: Path | None = None, overrides: Sequence[str] = ()
) -> Campaign:
    """The campaign of a file, with ``table.key=value`` for all its runs; nothing is opened.

    Parameters
    ----------
    folder : Path, optional
        Where the sessions go; else a folder of the campaign's name in the current one.

    Raises
    ------
    ConfigError
        It cannot be read, or plans what cannot be run: a sentence for each run.
    """
    file = campaign_file(path)
    said = read_toml(file, "campaign", campaign_names())
    _check_kinds(said, path)
    near = file.resolve().parent
    name = said.get("name", file.stem)
    if not _NAME.fullmatch(name) or name.startswith("."):
        raise ConfigError(f"{path}: name = '{name[:200]}' cannot be the name of a folder")
    if not 1 <= (repeats := said.get("repeats", 1)) <= MOST_RUNS:
        raise ConfigError(f"{path}: repeats = {repeats}: {KINDS['repeats'][1]} is needed")
    data, folders = {}, [near]
    if "bench" in said:
        bench = _bench(said["bench"], near, path)
        try:
            data = read_settings(bench)
        except ConfigError as error:
            raise ConfigError(f"{path}: bench: {error}") from None
        folders.append(bench_file(bench).resolve().parent)
        data = located(data, folders[-1])
    common = list(_changes(said.get("settings", {}), f"{path}: [settings]"))
    last = [parse_override(text) for text in overrides]
    configs: list[Config] = []
    faults: list[str] = []
    numbers: list[int] = []  # of the repeat of each run
    for repeat, changes in _variants(said, repeats, path):
        numbers.append(repeat)
        if len(numbers) > MOST_RUNS:
            raise ConfigError(f"{path}: more than {MOST_RUNS} runs; make several campaigns of it")
        try:
            where = f"{path}, run {len(numbers)}"
            configs.append(
                _repeated(altered(data, [*common, *changes, *last], where, folders), repeat)
            )
        except ConfigError as error:
            faults.append(str(error))
    if faults:
        more = len(faults) - MOST_LISTED
        listed = faults[:MOST_LISTED] + ([f"and {more} more"] if more > 0 else [])
        raise ConfigError("; ".join(listed))
    varied = _varied(configs)
    idle = set.intersection(*(config.run.said_by_steps for config in configs))
    for key in sorted(idle & varied[0].keys()):
        raise ConfigError(
            f"{path}: {key} differs between the runs and has no effect, because the steps of"
            " their protocol say it themselves; take it out of the steps or out of the campaign"
        )
    place = Path(name) if folder is None else folder
    names = _names(said.get("sessions", "{name}-{number}"), name, configs, numbers, path)
    places = [place / f"{one}.h5" for one in names]
    runs = tuple(map(PlannedRun, count(1), places, configs, varied))
    text = "".join(f"# --set {one}\n" for one in overrides) + decoded(file.read_bytes())
    return Campaign(
        name,
        file,
        text,
        place,
        said.get("pauses", any("real" in natures_of(config.sources) for config in configs)),
        runs,
    )


def settings_as_planned(config: Config) -> dict[str, Any]:
    """``table.key`` -> value, with the load, velocity and travel that the steps of the run say."""
    planned = as_written(config.run.as_planned)
    return keyed(config) | {
        f"run.{key}": planned[key] for key in ("normal_force", "velocity", "travel")
    }


def select_runs(campaign: Campaign, only: Sequence[str]) -> tuple[PlannedRun, ...]:
    """The runs of these numbers (``3``, ``2-4``) or names (``*-0.5N``); all where none is given.

    Raises
    ------
    UserError
        There is none of that number or name.
    """
    if not only:
        return campaign.runs
    wanted: set[int] = set()
    for text in (part.strip() for given in only for part in given.split(",")):
        span = re.fullmatch(r"(\d{1,4})(?:-(\d{1,4}))?", text)
        first, last = (int(span[1]), int(span[2] or span[1])) if span else (0, 0)
        found = {
            run.number
            for run in campaign.runs
            if first <= run.number <= last or (not span and fnmatchcase(run.name, text))
        }
        if len(found) < (last - first + 1 if span else 1):
            count = len(campaign.runs)
            names = ", ".join(run.name for run in campaign.runs[:MOST_NAMED])
            raise UserError(
                f"--only {text[:200]}: there is no such run; {campaign.file.name} has runs 1 to"
                f" {count}: {names}{', ...' if count > MOST_NAMED else ''}"
            )
        wanted |= found
    return tuple(run for run in campaign.runs if run.number in wanted)


def orders(plan: Campaign, run: PlannedRun) -> str:
    """What is to be done at the bench for a run, and what is another than in the one before."""
    config, others = run.config, plan.runs
    former = others[max(run.number - 2, 0)]
    before = former.config
    planned = config.run.as_planned
    parts = [f"P = {quantity(planned, 'normal_force')}, {quantity(planned, 'velocity')}"]
    parts += [
        f"{key} = {value}"
        for key, value in run.varied.items()
        if key not in ALWAYS_SHOWN and value != former.varied.get(key)
    ]
    if config.about.sample:
        verb = "mount " if config.about.sample != before.about.sample else ""
        parts.insert(0, f"{verb}sample {config.about.sample}")
    if config.about.note != before.about.note:
        parts.append(config.about.note)
    return f"run {run.number} of {len(others)}, {run.name}: {'; '.join(parts)}"


# ---------------------------------------------------------------------- what the file says


def _check_kinds(said: dict[str, Any], path: Path) -> None:
    for key, value in said.items():
        if key not in KINDS:
            near = difflib.get_close_matches(key, KINDS, n=1, cutoff=0.0)[0]
            raise ConfigError(
                f"{path}: unknown key '{key[:200]}'; the nearest known one is '{near}', and"
                " settings are under [settings]"
            )
        kind, wanted = KINDS[key]
        if not isinstance(value, kind) or isinstance(value, bool) is not (kind is bool):
            raise ConfigError(f"{path}: {key} must be {wanted}; found {str(value)[:200]!r}")
    for n, run in enumerate(said.get("runs", []), 1):
        if not isinstance(run, dict):
            raise ConfigError(f"{path}: runs must be {KINDS['runs'][1]}; entry {n} is {run!r:.200}")


def _bench(name: str, near: Path, path: Path) -> Path:
    """The bench that a campaign names: beside its file, or one of the program's own."""
    try:
        check_local(f"{path}: bench", name)
    except UserError as error:
        raise ConfigError(str(error)) from None
    beside = near / name
    return beside if beside.exists() or "/" in name or "\\" in name else Path(name)


def _changes(tables: dict[str, Any], where: str) -> Iterator[Change]:
    """The settings of nested tables."""
    for table, content in tables.items():
        if not isinstance(content, dict):
            raise ConfigError(
                f"{where}: '{table[:200]}' is no setting; write table.key = value, as in"
                " run.normal_force = 0.5"
            )
        for key, value in content.items():
            if key == OWN and isinstance(value, dict):
                yield from ((table, f"{OWN}.{own}", one) for own, one in value.items())
            else:
                yield table, key, value


def _variants(said: dict[str, Any], repeats: int, path: Path) -> Iterator[tuple[int, list[Change]]]:
    """The number of the repeat and the settings of each run: each of [[runs]] with all
    combinations of [vary], the last of which changes fastest, then the repeats.
    """
    vary = list(_changes(said.get("vary", {}), f"{path}: [vary]"))
    for table, key, values in vary:
        if not isinstance(values, list) or not values:
            raise ConfigError(
                f"{path}: [vary] {table}.{key} must be a list of its values, at least one; found"
                f" {str(values)[:200]!r}"
            )
    for n, run in enumerate(said.get("runs") or [{}], 1):
        own = list(_changes(run, f"{path}: [[runs]] {n}"))
        twice = {(table, key) for table, key, _ in own} & {(t, k) for t, k, _ in vary}
        for table, key in twice:
            raise ConfigError(
                f"{path}: {table}.{key} is in [vary] and in [[runs]] {n}; leave it in one of them"
            )
        for values in product(*(values for *_, values in vary)):
            given = [(t, k, value) for (t, k, _), value in zip(vary, values, strict=True)]
            for repeat in range(1, repeats + 1):
                yield repeat, own + given


def _repeated(config: Config, repeat: int) -> Config:
    """The settings of a repeat: a simulated bench goes on with the next seed, since the same one
    would give the same bits.
    """
    if natures_of(config.sources) == {"real"}:
        return config
    return replace(config, sim=replace(config.sim, seed=config.sim.seed + repeat - 1))


def _varied(configs: Sequence[Config]) -> list[dict[str, Any]]:
    """Of each run, the settings that are not the same in all."""
    values = [keyed(config) for config in configs]
    keys = dict.fromkeys(key for held in values for key in held)
    differ = [key for key in keys if any(held.get(key) != values[0].get(key) for held in values)]
    return [{key: held.get(key) for key in differ} for held in values]


# ---------------------------------------------------------------------- names


def _names(
    template: str, name: str, configs: Sequence[Config], repeats: Sequence[int], path: Path
) -> list[str]:
    """The names of the sessions, each another one."""
    numbers: dict[str, int] = {}  # of the runs by their names, which no disk tells apart by case
    names: list[str] = []
    for number, (config, repeat) in enumerate(zip(configs, repeats, strict=True), 1):
        known = {"name": name, "number": number, "repeat": repeat}
        made = _filled(template, known, settings_as_planned(config), path)
        if not _NAME.fullmatch(made) or made[0] in ". " or made[-1] in ". ":
            raise ConfigError(
                f"{path}, run {number}: '{made[:200]}' cannot be the name of a file; change"
                f" sessions = '{template[:200]}', or the sample"
            )
        if (first := numbers.setdefault(made.casefold(), number)) < number:
            raise ConfigError(
                f"{path}: runs {first} and {number} would both be {names[first - 1]}.h5;"
                " distinguish them by {number}, {repeat}, {load} or another setting in sessions ="
                f" '{template[:200]}'"
            )
        names.append(made)
    return names


def _filled(template: str, known: dict[str, Any], settings: dict[str, Any], path: Path) -> str:
    """The template with the values of its fields."""
    values = known | settings
    made = ""
    where = f"{path}: sessions = '{template[:200]}'"
    try:
        parts = list(string.Formatter().parse(template))
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None
    for literal, field, how, conversion in parts:
        made += literal
        if field is None:
            continue
        name = SHORT.get(field, field)
        if name not in values:
            names = ", ".join([*known, *SHORT])
            raise ConfigError(
                f"{where}: '{field}' is not known; use {names}, or a setting such as dic.box"
            )
        try:
            if conversion or not _FORMAT.fullmatch(how or ""):
                raise ValueError("a format such as .1f or 03d is needed")
            made += format(values[name], how or "")
        except (ValueError, TypeError) as error:
            value = values[name]
            raise ConfigError(f"{where}: {{{field}:{how}}} with {value!r}: {error}") from None
    return made
