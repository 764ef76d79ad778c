"""All settings as text: read from a commented TOML file and from ``table.key=value``, checked, and
written again.

People write settings in the units that their declarations name; a `Config` holds SI units.
"""

from __future__ import annotations

import copy
import difflib
import keyword
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import fields, make_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol, get_type_hints

from analysis.options import Section, as_written, option, options
from analysis.settings import PRESETS, RETIRED, Correlation
from app.settings.certificates import CALIBRATED, with_certificates
from app.settings.plain_values import (
    STEPS,
    brief,
    section_from,
    step_as_written,
    steps_from,
    steps_lines,
    title,
    toml_text,
)
from app.settings.sections import Config, RunSettings
from app.settings.toml_text import parse_toml, read_toml
from app.settings.trusted_settings import (
    check_local,
    check_module,
    check_port,
    check_producer,
    check_server,
)
from app.system.errors import ConfigError, UserError
from drivers.errors import DeviceNotFound
from drivers.settings import DeviceSettings

__all__ = ["ConfigError", "section_from"]
BENCHES = Path(__file__).parent / "benches"
CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
OWN = "options"  # the table of a driver's own settings, within that of its device
CHECKS = {  # what names something outside, and what it may be
    "forces.server": check_server,
    "forces.certificate": check_local,
    "camera.producer": check_local,
    "camera.folder": check_local,
    "actuator.port": check_port,
    "replay.session": check_local,
    "sim.law_table": check_local,
    "sim.pressure_table": check_local,
}
ANALYSED = (  # tables and options that say how a measurement is analysed, not what was measured
    "about",
    "dic",
    "stress",
    "calibration",
    "recording.results",
    "camera.angle_from",
    "camera.readout",
    "forces.delay",
    "camera.fixed_pattern",
    *CALIBRATED,
)
FORMER = {  # the direct method, a drive along the rows of the picture, no look for a fixed pattern
    "dic": {"method": "direct"},
    "camera": {"angle_from": "angle", "fixed_pattern": "ignore"},
}

OF_CAMPAIGNS = {"bench", "repeats", "runs", "settings", "vary"}  # keys that no settings file has
Change = tuple[str, str, Any]  # table, key and value of a setting


@cache
def tables() -> dict[str, type[Section]]:
    """Name -> section of every table of the settings file, in order."""
    kinds = get_type_hints(Config)
    return {f.name: kinds[f.name] for f in fields(Config)}


def values_of(config: Config) -> dict[str, dict[str, Any]]:
    """Table -> key -> value of all settings, in the units of the settings file; a driver's own are
    a dict under the key "options" of its device, the steps of a protocol a list of dicts.
    """
    values = {table: as_written(getattr(config, table)) for table in tables()}
    if config.run.steps:
        values["run"][STEPS] = [step_as_written(step) for step in config.run.steps]
    for table, section in own_options(config).items():
        values[table][OWN] = as_written(section)
    return values


def keyed(config: Config) -> dict[str, Any]:
    """``table.key`` -> value of all settings, as `values_of` has them."""
    return {
        f"{table}.{key}": value
        for table, held in values_of(config).items()
        for key, value in held.items()
    }


def is_analysed(key: str) -> bool:
    """Whether a setting ``table.key`` says how a measurement is analysed, not what was measured."""
    return key in ANALYSED or key.partition(".")[0] in ANALYSED


def own_options(config: Config) -> dict[str, Section]:
    """Table -> the settings of its driver's own, of the devices whose drivers have any."""
    sections = {table: getattr(getattr(config, table), OWN, Section()) for table in tables()}
    return {table: section for table, section in sections.items() if options(type(section))}


def with_own(values: dict[str, Any], config: Config) -> dict[str, Any]:
    """These ``table.key`` -> value with each setting of a driver's own under a key of its own."""
    for table in own_options(config):
        own = values.pop(f"{table}.{OWN}")
        values |= {f"{table}.{OWN}.{key}": value for key, value in own.items()}
    return values


# ---------------------------------------------------------------------- from plain data


def from_data(
    data: dict[str, Any],
    where: str,
    *,
    recorded: bool = False,
    folders: Sequence[Path] | None = None,
    is_edited: bool = False,
) -> Config:
    """Settings from nested plain dicts; `where` names the source in error sentences.

    With `recorded`, a driver's own settings are taken as they are, and no driver is imported: it
    need not be installed, and a session from somebody else executes nothing. With the `folders` of
    settings files, code that lies there or in the current folder must have been confirmed. Of
    settings that are `is_edited`, certificates that were read before are not read again.
    """
    sections: dict[str, Any] = {}
    try:
        if not recorded and "calibration" in data:
            folder = folders[0] if folders else Path()
            data = with_certificates(data, folder, is_remembered=is_edited)
        for table, content in data.items():
            sections[table] = _section(table, content, recorded, folders)
        return Config(**sections)
    except (ValueError, DeviceNotFound, UserError) as error:
        raise ConfigError(f"{where}: {error}") from None


def _section(table: str, content: Any, recorded: bool, folders: Sequence[Path] | None) -> Section:
    if table not in tables():
        raise ConfigError(f"unknown table or key '{brief(table)}'; {_nearest(brief(table))}")
    if not isinstance(content, dict):
        raise ConfigError(
            f"'{table}' is a table of options, found {brief(repr(content))}; write [{table}] above"
            " its options"
        )
    kind = tables()[table]
    apart = STEPS if kind is RunSettings else OWN if issubclass(kind, DeviceSettings) else ""
    plain = {key: value for key, value in content.items() if key != apart}
    retired = {}
    if kind is Correlation:
        given = {key: plain.pop(key, now) for key, now in RETIRED.items()}
        retired = {key: brief(f"{value}") for key, value in given.items() if value != RETIRED[key]}
    for key in plain:
        if key not in options(kind):
            unknown = brief(f"{table}.{key}")
            raise ConfigError(f"unknown key '{unknown}'; {_nearest(unknown)}")
    section = section_from(kind, plain, f"{table}.{{}}".format)
    if isinstance(section, Correlation):
        section = replace(section, retired=tuple(retired.items()))
        if not recorded and section.refusal:
            raise ConfigError(section.refusal)
    if isinstance(section, RunSettings):
        return replace(section, steps=steps_from(content.get(STEPS, [])))
    if not recorded:
        _check_names(table, section, folders)
    if not isinstance(section, DeviceSettings):
        return section
    where, given = f"{table}.{OWN}", content.get(OWN, {})
    if not isinstance(given, dict):
        raise ConfigError(
            f"'{where}' is a table of the driver's own options, found {brief(repr(given))}; write"
            f" [{where}] above them"
        )
    own = _as_recorded(tuple(given)) if recorded else _options_of(table, section.source)
    known = options(own)
    for key, value in given.items():
        if key not in known:
            close = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
            nearest = f"the nearest known one is '{where}.{close[0]}'" if close else "leave it out"
            raise ConfigError(
                f"unknown key '{brief(f'{where}.{key}')}' of the driver '{section.source}', which"
                f" has {len(known) or 'no'} options of its own; {nearest}"
            )
        if recorded and not _is_plain(value):
            raise ConfigError(f"{where}.{key}: a number, text or list is needed")
    return replace(section, options=section_from(own, given, f"{where}.{{}}".format))


def _check_names(table: str, section: Section, folders: Sequence[Path] | None) -> None:
    """Refuse what stands for more than a device or a file, and code that was not confirmed."""
    for key, check in CHECKS.items():
        if key.partition(".")[0] == table:
            check(key, getattr(section, key.partition(".")[2]))
    if folders is not None and isinstance(section, DeviceSettings):
        check_module(f"{table}.source", section.source, folders)
        check_producer(f"{table}.producer", getattr(section, "producer", ""))


def _options_of(kind: str, source: str) -> type[Section]:
    """The section of a driver's own settings."""
    from drivers.sources import driver  # a session is read without any driver

    return driver(kind, source).options


@cache
def _as_recorded(names: tuple[str, ...]) -> type[Section]:
    """A section of options of these names, with any values."""
    if not names:
        return Section
    for name in names:
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,99}", name) or keyword.iskeyword(name):
            raise ConfigError(f"'{brief(name)}' cannot be the name of an option")
    about = [(name, Any, option(None, "as recorded")) for name in names]
    return make_dataclass("RecordedOptions", about, bases=(Section,), frozen=True, kw_only=True)


def _is_plain(value: Any) -> bool:
    return (
        all(map(_is_plain, value))
        if isinstance(value, list)
        else isinstance(value, bool | int | float | str)
    )


def _nearest(word: str) -> str:
    """The table or ``table.key`` whose name is most like `word`, with or without its table."""
    names = {table: table for table in tables()}
    for table, kind in tables().items():
        for key in options(kind):
            names.setdefault(key, f"{table}.{key}")
            names[f"{table}.{key}"] = f"{table}.{key}"
    close = difflib.get_close_matches(word, list(names), n=1, cutoff=0.0)[0]
    return f"the nearest known one is '{names[close]}'"


# ---------------------------------------------------------------------- from text


def from_record(text: str, where: str) -> Config:
    """Settings as a session holds them.

    What it does not say is as it was before there was a choice, see `FORMER`.
    """
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"{where}: not TOML: {error}") from None
    for table, former in FORMER.items():
        if isinstance(data.setdefault(table, {}), dict):
            data[table] = former | data[table]
    return from_data(data, where, recorded=True)


class RecordedSession(Protocol):
    """A session that is open to be read."""

    path: Path

    @property
    def header(self) -> Any: ...


def settings_of(session: RecordedSession) -> Config:
    """The settings that an open session was recorded with; ConfigError."""
    return from_record(session.header.config_toml, f"{session.path}: settings")


def parse_override(text: str) -> Change:
    """``run.travel=150`` -> ("run", "travel", 150); a bare word is a string."""
    key, separator, raw = text.partition("=")
    table, dot, name = key.strip().partition(".")
    if not separator or not dot:
        raise ConfigError(f"'{text}' is not table.key=value, e.g. run.travel=150")
    try:
        (value,) = parse_toml(f"v = {raw}").values()
    except ValueError:
        value = raw.strip()
    return table, name, value


def _override(data: dict[str, Any], changes: Iterable[Change]) -> None:
    changes = list(changes)
    for table, name, value in changes:
        if (table, name) == ("dic", "preset") and isinstance(data.get(table), dict):
            for key in (*PRESETS.get(str(value), ()), *RETIRED):
                data[table].pop(key, None)  # what the file says gives way to it
    for table, name, value in changes:
        content = data.setdefault(table, {})
        if name.startswith(f"{OWN}.") and isinstance(content, dict):
            content = content.setdefault(OWN, {})
        if isinstance(content, dict):
            content[name.removeprefix(f"{OWN}.")] = value


def revised(config: Config, overrides: Sequence[str]) -> Config:
    """The settings of a recorded experiment, with others for its analysis, or those of other
    certificates: ``calibration.certificates=["later.zip"]``.

    Raises
    ------
    ConfigError
        An override is not allowed, or changes what was measured rather than how it is analysed.
    """
    data = values_of(config)
    data["dic"] |= config.dic.retired
    changes = [parse_override(text) for text in overrides]
    _override(data, changes)
    given = {f"{table}.{name}" for table, name, _ in changes}
    if "calibration.certificates" in given:
        data = with_certificates(data, Path(), given)
    new = from_data(data, "--set", recorded=True)
    for name, (found, _) in measured_differently(config, new).items():
        raise ConfigError(
            f"--set: {name} is {found} in the session, as it was measured;"
            " what an analysis may change is " + ", ".join(ANALYSED)
        )
    return new


def measured_differently(
    a: Config, b: Config, also: Collection[str] = ()
) -> dict[str, tuple[str, str]]:
    """``table.key`` -> both values as text, of the settings of two experiments that differ in what
    no analysis may change, or in what is named as well.
    """
    was, now = keyed(a), keyed(b)
    return {
        key: (toml_text(was.get(key)), toml_text(now.get(key)))
        for key in was | now
        if was.get(key) != now.get(key) and (key in also or not is_analysed(key))
    }


def load(
    path: Path | None = None,
    overrides: Sequence[str] = (),
    *,
    recorded: bool = False,
    option: str = "--set",
) -> Config:
    """Settings from a TOML file, a bench that comes with the program, or the defaults, with
    ``table.key=value`` overrides on top, which came by the named `option`; with `recorded`, for
    what was measured: see `from_data`.

    Raises
    ------
    ConfigError
        The file cannot be read, is not TOML, or holds something that is not allowed.
    """
    where = option if overrides else "settings"
    data: dict[str, Any] = {}
    if path is not None:
        where = f"{path} and {option}" if overrides else str(path)
        data = read_settings(path)
    _override(data, map(parse_override, overrides))
    folders = None if path is None else [bench_file(path).parent]
    return from_data(data, where, recorded=recorded, folders=folders)


def altered(
    data: dict[str, Any], changes: Iterable[Change], where: str, folders: Sequence[Path] | None
) -> Config:
    """Settings from nested plain dicts, which stay as they are, with changes to them; see
    `from_data`.
    """
    new = copy.deepcopy(data)
    _override(new, changes)
    return from_data(new, where, folders=folders, is_edited=True)


def read_settings(path: Path) -> dict[str, Any]:
    """The nested plain dicts of a settings file, or of a bench that comes with the program."""
    data = read_toml(bench_file(path), "settings file", bench_names())
    if foreign := sorted(OF_CAMPAIGNS & data.keys()):
        raise ConfigError(
            f"{path}: '{foreign[0]}' is of the plan of a campaign, not of settings; run a plan by"
            f" `slipscope campaign {path}`, or take the key out of a settings file"
        )
    return data


def bench_names() -> list[str]:
    """Names of the benches that come with the program."""
    return sorted(file.stem for file in BENCHES.glob("*.toml"))


def campaign_names() -> list[str]:
    """Names of the campaigns that come with the program."""
    return sorted(file.stem for file in CAMPAIGNS.glob("*.toml"))


def sources() -> dict[str, dict[str, str]]:
    """Kind of device -> name of each driver -> its nature as in `drivers.sources.NEEDS`; empty for
    those that installed packages offer, which are not imported for it.
    """
    from drivers.sources import DRIVERS, offered

    return {
        kind: {name: one.own_nature for name, one in (own | offered(kind)).items()}
        for kind, own in DRIVERS.items()
    }


def bench_file(path: Path) -> Path:
    """The settings file at `path`, or else the bench of that name that comes with the program, or
    the campaign, which is refused as a campaign.
    """
    return own_file(path, BENCHES, CAMPAIGNS)


def own_file(path: Path, *folders: Path) -> Path:
    """The file at `path`, or else the one of that name in the first of these folders of the program
    that holds one, also beside a folder of that name: sessions of a campaign lie in such a one.
    """
    if path.is_file() or path.name != str(path):
        return path
    names = (folder / f"{path}.toml" for folder in folders)
    return next((own for own in names if own.exists()), path)


# ---------------------------------------------------------------------- to text


def to_toml(config: Config, comments: bool = True, only: Collection[str] = ()) -> str:
    """The settings as a TOML text, each option with its meaning, unit and limits; `only` those
    named ``table.key``, if any are.
    """
    lines = (
        ["# SlipScope settings. Delete what you do not change: every option has this default.", ""]
        if comments and not only
        else []
    )
    if only:
        for table in dict.fromkeys(key.partition(".")[0] for key in only):
            lines += _table_lines(table, getattr(config, table), comments, only)
        return "\n".join(lines)
    own = own_options(config)
    for table in tables():
        lines += _table_lines(table, getattr(config, table), comments)
        if table == "run":
            lines += steps_lines(config.run.steps, comments)
        if table in own:
            lines += _table_lines(f"{table}.{OWN}", own[table], comments)
    return "\n".join(lines)


def _table_lines(
    table: str, section: Section, comments: bool, only: Collection[str] = ()
) -> list[str]:
    lines = [f"# {title(type(section))}"] if comments else []
    lines.append(f"[{table}]")
    for key, value in as_written(section).items():
        if only and f"{table}.{key}" not in only:
            continue
        declared = options(type(section))[key]
        if comments:
            notes = f" [{declared.unit}]" if declared.unit else ""
            notes += f" ({declared.limits})" if declared.limits else ""
            lines.append(f"# {declared.meaning}{notes}.")
        lines.append(f"{key} = {toml_text(value)}")
    return [*lines, ""]
