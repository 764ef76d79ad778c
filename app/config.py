"""Every option of SlipScope: frozen settings read from one commented TOML file, and checked on the
way in.

`app.sections` declares the options; `default_toml` writes them out, `load` reads them back.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from app.sections import Config, Dic, Section
from app.toml import LONGEST_TOML, parse_toml

if TYPE_CHECKING:
    import numpy as np

    from analysis.dic import Correlation


BENCHES = Path(__file__).parent / "benches"
ANALYSED = (  # tables and options that do not say what was measured but what is made of it
    "sample",
    "dic",
    "stress",
    "camera.pixel",
    *(
        f"forces.{of}_{sensor}"
        for of in ("sensitivity", "stiffness")
        for sensor in ("normal", "shear")
    ),
    *(f"forces.{name}" for name in ("stiffness_uncertainty", "sign", "zero", "coupling")),
)


class ConfigError(ValueError):
    """The settings can not be used; the message names the key, what was found and what is allowed."""


def _meta(hint: Any) -> tuple[Any, Meta | None]:
    if get_origin(hint) is Annotated:
        base, *rest = get_args(hint)
        return base, next((m for m in rest if isinstance(m, Meta)), None)
    return hint, None


def options(section: type[Section]) -> dict[str, tuple[Any, Meta]]:
    """Name -> (type, Meta) of every option of a table, in order."""
    found = {}
    for name, hint in get_type_hints(section, include_extras=True).items():
        base, meta = _meta(hint)
        found[name] = (base, meta or Meta())
    return found


def _limits_text(meta: Meta) -> str:
    """``more than 0 and at most 10``; the words of a choice; empty where anything goes."""
    if meta.pattern:
        return " or ".join(f"'{word}'" for word in re.findall(r"[\w-]+", meta.pattern))
    low = (
        f"at least {meta.ge:g}"
        if meta.ge is not None
        else f"more than {meta.gt:g}"
        if meta.gt is not None
        else ""
    )
    high = (
        f"at most {meta.le:g}"
        if meta.le is not None
        else f"less than {meta.lt:g}"
        if meta.lt is not None
        else ""
    )
    return " and ".join(part for part in (low, high) if part)


def _unit(meta: Meta) -> str:
    return str((meta.extra or {}).get("unit", ""))


def _wanted_text(base: Any, meta: Meta) -> str:
    """What an option may be, for an error: ``a number more than 0 and at most 10 N``."""
    if meta.pattern:
        return _limits_text(meta)
    plain = {
        float: "a number",
        int: "a whole number",
        bool: "true or false",
        str: "a text in quotes",
    }
    if base in plain:
        kind = plain[base]
    else:
        kinds = {
            "tuple[tuple": "two rows of two numbers, [[a, b], [c, d]]",
            "tuple[str, ...]": 'texts in quotes, ["a", "b"]',
        }
        kinds |= {
            "tuple[str, str]": 'two texts in quotes, ["a", "b"]',
            "tuple[int": "two whole numbers, [a, b]",
        }
        kind = next(
            (words for start, words in kinds.items() if str(base).startswith(start)),
            "two numbers, [a, b]",
        )
    unit = _unit(meta)
    text = " ".join(part for part in (kind, _limits_text(meta)) if part)
    return (
        f"{text} {unit}" if _limits_text(meta) and unit else f"{text} in {unit}" if unit else text
    )


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return msgspec.json.encode(value).decode()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return repr(value)


def _brief(text: str) -> str:
    return text if len(text) <= 200 else f"{text[:100]} ..."


def _comment_text(meta: Meta) -> str:
    """`` [N], more than 0 and at most 10``: what follows the meaning of an option in the settings
    file.
    """
    unit, limits = _unit(meta), _limits_text(meta)
    return (f" [{unit}]" if unit else "") + (f", {limits}" if limits else "")


def to_toml(config: Config, comments: bool = True) -> str:
    """The settings as a TOML text, each option with its meaning, unit and limits."""
    lines = (
        ["# SlipScope settings. Delete what you do not change: every option has this default.", ""]
        if comments
        else []
    )
    for table, (kind, _) in options(Config).items():
        if comments and kind.__doc__:
            lines.append(f"# {' '.join(kind.__doc__.split())}")
        lines.append(f"[{table}]")
        for name, (_, meta) in options(kind).items():
            if comments and meta.description:
                lines.append(f"# {meta.description}{_comment_text(meta)}.")
            lines.append(f"{name} = {_toml_value(getattr(getattr(config, table), name))}")
        lines.append("")
    return "\n".join(lines)


def default_toml() -> str:
    """The commented default settings file."""
    return to_toml(Config())


def _nearest(word: str) -> str:
    """The table or ``table.key`` whose name is most like `word`, with or without its table."""
    names = {table: table for table in options(Config)}
    for table, (kind, _) in options(Config).items():
        for key in options(kind):
            names.setdefault(key, f"{table}.{key}")
            names[f"{table}.{key}"] = f"{table}.{key}"
    close = difflib.get_close_matches(word, list(names), n=1, cutoff=0.0)[0]
    return f"the nearest known one is '{names[close]}'"


def _check_keys(data: dict[str, Any], where: str) -> None:
    tables = options(Config)
    for table, content in data.items():
        if table not in tables:
            raise ConfigError(
                f"{where}: unknown table or key '{_brief(table)}'; {_nearest(_brief(table))}"
            )
        if not isinstance(content, dict):
            raise ConfigError(
                f"{where}: '{table}' is a table of options, found {_brief(repr(content))}; write"
                f" [{table}] above its options"
            )
        known = options(tables[table][0])
        for key, value in content.items():
            if key not in known:
                unknown = _brief(f"{table}.{key}")
                raise ConfigError(f"{where}: unknown key '{unknown}'; {_nearest(unknown)}")
            _check_finite(value, f"{where}: {table}.{key}")


def _check_finite(value: Any, where: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: a finite number is needed; found {value!r}")
    if isinstance(value, list):
        for item in value:
            _check_finite(item, where)


def _explain(error: msgspec.ValidationError, data: dict[str, Any], where: str) -> ConfigError:
    match = re.search(r"at `\$\.(\w+)\.(\w+)", str(error))
    if not match:
        return ConfigError(f"{where}: {error}")
    table, key = match.groups()
    base, meta = options(options(Config)[table][0])[key]
    return ConfigError(
        f"{where}: {table}.{key} must be {_wanted_text(base, meta)}; found"
        f" {_brief(_toml_value(data[table][key]))}"
    )


def from_data(data: dict[str, Any], where: str) -> Config:
    """Settings from nested plain dicts; `where` names the source in error sentences."""
    _check_keys(data, where)
    try:
        config = msgspec.convert(data, Config)
    except msgspec.ValidationError as error:
        raise _explain(error, data, where) from None
    _check_together(config, where)
    return config


def from_record(text: str, where: str) -> Config:
    """Settings as a session holds them.

    One without `dic.method` was measured by the direct one: there was no other.
    """
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise ConfigError(f"{where}: not TOML: {error}") from None
    if isinstance(data.setdefault("dic", {}), dict):
        data["dic"].setdefault("method", "direct")
    return from_data(data, where)


def correlation(settings: Dic, full_scale: int | None = None) -> Correlation:
    """The way to correlate that the settings ask for; ValueError if two of them can not be used
    together.

    `full_scale` is the end of the grey scale where the settings name none; None: that of the
    image's type.
    """
    from analysis.dic import Correlation  # takes a second

    own = {"tolerance": settings.tolerance or None, "full_scale": settings.full_scale or full_scale}
    return Correlation(**(msgspec.structs.asdict(settings) | own))


def tracking(config: Config) -> Correlation:
    """The way to correlate the camera's images."""
    return correlation(config.dic, 2 ** bits(config) - 1)


def bits(config: Config) -> int:
    """Bits of a pixel of the camera."""
    found = re.search(r"\d+", config.camera.pixel_format)
    assert found is not None
    return int(found[0])


def pixel_type(config: Config) -> np.dtype[Any]:
    """Array type of the camera's images."""
    import numpy as np

    return np.dtype(np.uint8 if bits(config) <= 8 else np.uint16)


def sensitivities(config: Config) -> tuple[float, float]:
    """Displacement per volt of the normal and the shear sensor, m/V, with their signs."""
    f = config.forces
    return f.sign[0] * f.sensitivity_normal * 1e-6, f.sign[1] * f.sensitivity_shear * 1e-6


def averaging_box_px(settings: Dic) -> float:
    """Side of the box whose plain average passes as much of long waves as the correlation does
    (`benchmarks/dic.py waves`).
    """
    return 0.6 * settings.box if settings.method == "shared" else float(settings.box)


def _check_together(config: Config, where: str) -> None:
    """The limits that one option sets on another."""
    rate = config.forces.sample_rate / config.camera.divisor
    if rate > config.camera.max_rate:
        least = math.ceil(config.forces.sample_rate / config.camera.max_rate)
        raise ConfigError(
            f"{where}: camera.divisor = {config.camera.divisor} asks {rate:.3g} frames/s,"
            f" {config.camera.max_rate:g} is the camera's limit;"
            f" use a divisor of {least} or more"
        )
    if exposure_samples(config) > config.camera.divisor:
        raise ConfigError(
            f"{where}: camera.exposure = {config.camera.exposure:g} ms is longer than the trigger"
            " period of"
            f" {1e3 / rate:.4g} ms; shorten it or raise camera.divisor"
        )
    if config.run.travel > config.limits.travel:
        raise ConfigError(
            f"{where}: run.travel = {config.run.travel:g} um is beyond limits.travel ="
            f" {config.limits.travel:g} um"
        )
    if config.run.normal_force >= config.limits.normal_force:
        raise ConfigError(
            f"{where}: run.normal_force = {config.run.normal_force:g} N is not below"
            f" limits.normal_force = {config.limits.normal_force:g} N"
        )
    _check_devices(config, where)
    (a, b), (c, d) = config.forces.coupling
    if abs(a * d - b * c) < 1e-6:
        raise ConfigError(
            f"{where}: forces.coupling has no inverse; its determinant is {a * d - b * c:g}"
        )
    if config.dic.box >= min(config.camera.width, config.camera.height):
        raise ConfigError(
            f"{where}: dic.box = {config.dic.box} px does not fit the {config.camera.width} x"
            f" {config.camera.height} image"
        )
    if config.dic != Dic():
        try:
            correlation(config.dic)
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None


def _check_devices(config: Config, where: str) -> None:
    """The pairs whose limits a number alone can not have, and devices that need an option."""
    forces, camera, actuator = config.forces, config.camera, config.actuator
    checks = {
        "forces.range": (
            all(0 < v <= 100 for v in forces.range),
            "two numbers above 0 V, at most 100 V",
            forces.range,
        ),
        "forces.sign": (set(forces.sign) <= {1, -1}, "1 or -1, twice", forces.sign),
        "forces.stiffness_uncertainty": (
            min(forces.stiffness_uncertainty) >= 0,
            "two numbers from 0 N/m on",
            forces.stiffness_uncertainty,
        ),
        "camera.offset": (min(camera.offset) >= 0, "two whole numbers from 0 px on", camera.offset),
        "actuator.travel": (
            actuator.travel[0] < actuator.travel[1],
            "a least and a greatest position in mm",
            actuator.travel,
        ),
        "camera.folder": (
            camera.source != "folder" or camera.folder,
            "the folder of the images that camera.source = 'folder' plays",
            "",
        ),
        "camera.producer": (
            camera.source != "gentl" or camera.producer,
            "the .cti file of the camera's vendor, for camera.source = 'gentl'",
            "",
        ),
        "replay.session": (
            config.replay.session
            or "replay" not in (forces.source, camera.source, actuator.source),
            "the session that a source = 'replay' plays",
            "",
        ),
        "actuator.port": (
            actuator.source not in ("smc100", "conex-cc") or actuator.port,
            "the port that the actuator's controller is on",
            "",
        ),
    }
    for key, (is_fine, wanted, found) in checks.items():
        if not is_fine:
            raise ConfigError(
                f"{where}: {key} must be {wanted}; found {_brief(_toml_value(found))}"
            )
    if (
        forces.exposure_counter
        and forces.exposure_counter == forces.trigger_counter
        and forces.trigger == "counter"
    ):
        raise ConfigError(
            f"{where}: forces.exposure_counter and forces.trigger_counter are both"
            f" {forces.exposure_counter!r}; take two"
        )
    if config.run.velocity > actuator.max_velocity:
        raise ConfigError(
            f"{where}: run.velocity = {config.run.velocity:g} um/s is beyond actuator.max_velocity"
            f" = {actuator.max_velocity:g} um/s"
        )


def exposure_samples(config: Config) -> int:
    """Exposure time in whole samples, one at least."""
    return max(1, round(config.camera.exposure * 1e-3 * config.forces.sample_rate))


def parse_override(text: str) -> tuple[str, str, Any]:
    """``run.travel=150`` -> ("run", "travel", 150); a bare word is a string."""
    key, separator, raw = text.partition("=")
    table, dot, name = key.strip().partition(".")
    if not separator or not dot:
        raise ConfigError(f"--set: '{text}' is not table.key=value, e.g. run.travel=150")
    try:
        value = parse_toml(f"v = {raw}")["v"]
    except ValueError:
        value = raw.strip()
    return table, name, value


def revised(config: Config, overrides: Sequence[str]) -> Config:
    """The settings of a recorded experiment, with others for its analysis.

    Raises
    ------
    ConfigError
        An override is not allowed, or says what was measured and not how it is analysed.
    """
    data: dict[str, Any] = msgspec.to_builtins(config)
    _override(data, overrides)
    new = from_data(data, "--set")
    for table, (kind, _) in options(Config).items():
        for key in options(kind):
            was, asked = (getattr(getattr(each, table), key) for each in (config, new))
            if was != asked and not {table, f"{table}.{key}"} & set(ANALYSED):
                raise ConfigError(
                    f"--set: {table}.{key} is {_toml_value(was)} in the session, as it was"
                    " measured; what an analysis may change is " + ", ".join(ANALYSED)
                )
    return new


def _override(data: dict[str, Any], overrides: Sequence[str]) -> None:
    for text in overrides:
        table, name, value = parse_override(text)
        content = data.setdefault(table, {})
        if isinstance(content, dict):
            content[name] = value


def _decode(content: bytes) -> str:
    """Text of a settings file; Windows shells write UTF-16 when they redirect output."""
    return content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")


def bench_names() -> list[str]:
    """Names of the benches that come with the program."""
    return sorted(file.stem for file in BENCHES.glob("*.toml"))


def bench_file(asked: Path) -> Path:
    """The settings file that was asked for, or the one of that name that comes with the program."""
    own = BENCHES / f"{asked}.toml"
    return own if not asked.exists() and asked.name == str(asked) and own.exists() else asked


def bench_text(name: str) -> str:
    """The settings file of a bench that comes with the program; ConfigError where there is none of
    that name.
    """
    if name not in bench_names():
        raise ConfigError(f"config: no bench is called '{name}'; known: {', '.join(bench_names())}")
    return (BENCHES / f"{name}.toml").read_text(encoding="utf-8")


def load(path: Path | None = None, overrides: Sequence[str] = ()) -> Config:
    """Settings from a TOML file, a bench that comes with the program, or the defaults, with
    ``table.key=value`` overrides on top.

    Raises
    ------
    ConfigError
        The file can not be read, is no TOML, or holds something not allowed.
    """
    data: dict[str, Any] = {}
    where = "--set" if overrides else "settings"
    if path is not None:
        where = f"{path} and --set" if overrides else str(path)
        try:
            with bench_file(path).open("rb") as file:
                data = parse_toml(_decode(file.read(2 * LONGEST_TOML + 2)))
        except OSError as error:
            known = ", ".join(bench_names())
            sentence = (
                f"{path}: the settings file can not be read: {error.strerror}; check the name, or"
                f" take one of the program's own: {known}"
            )
            raise ConfigError(sentence) from None
        except ValueError as error:
            raise ConfigError(f"{path}: not a TOML file: {error}") from None
    _override(data, overrides)
    return from_data(data, where)
