"""Every option of SlipScope: frozen settings read from one commented TOML file, and checked on the way in.

The structs below are the only place where an option is declared: name, default, unit, limits and the sentence that explains
it. `default_toml` writes them out, `load` reads them back.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct

if TYPE_CHECKING:
    from analysis.dic import Correlation


class ConfigError(ValueError):
    """The settings can not be used; the message names the key, what was found and what is allowed."""


class Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every table of the settings file."""


def _f(text: str, unit: str = "", **limits: Any) -> Meta:
    return Meta(description=text, extra={"unit": unit}, **limits)


class Run(Section, frozen=True):
    """The loading experiment."""

    normal_force: Annotated[float, _f("Normal force P the contact is pressed to", "N", gt=0, le=10)] = 0.5
    velocity: Annotated[float, _f("Velocity asked of the actuator", "um/s", gt=0, le=1000)] = 5.0
    travel: Annotated[float, _f("Stage travel of the drive; the actuator is never asked for more", "um", gt=0, le=20000)] = 190.0
    background_time: Annotated[
        float,
        _f(
            "Images of the free block are taken for this long before contact; 0: none, the apparent radius is not measured",
            "s",
            ge=0,
            le=60,
        ),
    ] = 1.0
    contact_timeout: Annotated[float, _f("How long the operator has to press the contact to P", "s", gt=0, le=3600)] = 120.0
    settle_time: Annotated[float, _f("P must stay within settle_tolerance for this long", "s", gt=0, le=600)] = 1.0
    settle_tolerance: Annotated[float, _f("Allowed distance of P from normal_force, as a fraction of it", "", gt=0, le=0.5)] = 0.02
    shear_tolerance: Annotated[
        float, _f("Allowed initial |Q|, as a fraction of P; above it the contact must be renewed", "", gt=0, le=1)
    ] = 0.01
    reference_time: Annotated[float, _f("Rest under load in which the reference image is taken, before the drive", "s", gt=0, le=60)] = 1.5


class Forces(Section, frozen=True):
    """The DAQ board and the two capacitive sensors."""

    source: Annotated[str, _f("Driver of the DAQ board")] = "sim"
    sample_rate: Annotated[int, _f("Sampling rate: the clock of everything", "Hz", ge=100, le=100000)] = 1000
    block: Annotated[int, _f("Samples read at a time", "samples", ge=1, le=10000)] = 50
    sensitivity_normal: Annotated[float, _f("Displacement per volt of the normal sensor", "um/V", gt=0, le=10000)] = 300.0
    sensitivity_shear: Annotated[float, _f("Displacement per volt of the shear sensor", "um/V", gt=0, le=10000)] = 22.0
    stiffness_normal: Annotated[float, _f("Stiffness k_N of the normal cantilever", "N/m", gt=0, le=1e7)] = 689.0
    stiffness_shear: Annotated[float, _f("Stiffness K_T of the tangential cantilever", "N/m", gt=0, le=1e7)] = 9579.0
    zero: Annotated[tuple[float, float], _f("Sensor readings at no force (normal, shear)", "V")] = (0.0, 0.0)
    coupling: Annotated[
        tuple[tuple[float, float], tuple[float, float]],
        _f("Cross-coupling: reading = coupling x (P, Q); undone by its inverse"),
    ] = ((1.0, 0.004), (0.008, 1.0))


class Camera(Section, frozen=True):
    """The triggered camera."""

    source: Annotated[str, _f("Driver of the camera")] = "sim"
    divisor: Annotated[int, _f("Samples per trigger: 125 is 8 frames/s at 1 kHz, 250 is 4", "samples", ge=1, le=1000000)] = 125
    max_rate: Annotated[float, _f("Fastest trigger rate the camera follows", "frames/s", gt=0, le=10000)] = 24.0
    width: Annotated[int, _f("Image width", "px", ge=64, le=16384)] = 1600
    height: Annotated[int, _f("Image height", "px", ge=64, le=16384)] = 1200
    pixel: Annotated[float, _f("Size of a pixel on the interface", "um", gt=0, le=1000)] = 7.04
    exposure: Annotated[float, _f("Exposure time", "ms", gt=0, le=1000)] = 10.0


class Actuator(Section, frozen=True):
    """The DC actuator that drives the block."""

    source: Annotated[str, _f("Driver of the actuator")] = "sim"


class Limits(Section, frozen=True):
    """Beyond these the actuator stops and the run ends by name."""

    shear_force: Annotated[float, _f("Greatest |Q|", "N", gt=0, le=100)] = 1.9
    normal_force: Annotated[float, _f("Greatest P", "N", gt=0, le=100)] = 1.9
    travel: Annotated[float, _f("Greatest stage travel from the start of the drive", "um", gt=0, le=20000)] = 500.0


class Sample(Section, frozen=True):
    """The block, the lens, and what holds them."""

    young_modulus: Annotated[float, _f("Young's modulus E of the block", "MPa", gt=0, le=1e6)] = 3.43
    poisson: Annotated[float, _f("Poisson's ratio of the block", "", ge=0, le=0.5)] = 0.5
    lens_radius: Annotated[float, _f("Radius of curvature R of the lens", "mm", gt=0, le=1e5)] = 128.8
    roughness: Annotated[float, _f("Standard deviation h of the heights of the rough surface", "um", ge=0, le=1000)] = 0.595
    thickness: Annotated[float, _f("Thickness of the block on its rigid plate, for the traction; 0: a half-space", "mm", ge=0, le=1e4)] = (
        0.0
    )
    lens_compliance: Annotated[float, _f("Displacement of the lens holder per newton of Q", "um/N", ge=0, le=100)] = 0.68


class Dic(Section, frozen=True):
    """Digital image correlation of each frame with the reference."""

    method: Annotated[str, _f("Passes over the image, IC-GN box by box, the paper's search", pattern="^(shared|icgn|direct)$")] = "shared"
    box: Annotated[int, _f("Side of the correlation box", "px", ge=4, le=200)] = 20
    step: Annotated[int, _f("Pitch of the grid of boxes", "px", ge=1, le=200)] = 10
    order: Annotated[int, _f("Deformation of a box in icgn: 0 shift, 1 and its gradient, 2 and its curvature", "", ge=0, le=2)] = 1
    interpolant: Annotated[
        str,
        _f("How images are read between pixels", pattern="^(matched|bilinear|bicubic|bspline3|bspline5|sinc6|sinc8)$"),
    ] = "matched"
    precision: Annotated[str, _f("Arithmetic; double in icgn only", pattern="^(single|double)$")] = "single"
    tolerance: Annotated[float, _f("A step shorter than this is the last; 0: the method's own limit", "px", ge=0, le=1)] = 0.0
    search: Annotated[int, _f("Largest jump between two images that must be found", "px", ge=1, le=200)] = 64
    min_correlation: Annotated[float, _f("A point whose correlation is lower is lost", "", ge=0, lt=1)] = 0.5
    min_contrast: Annotated[float, _f("A box whose standard deviation is smaller is not correlated", "grey levels", ge=0)] = 2.0
    max_saturated: Annotated[float, _f("Share of a box that may be at full scale (shared, icgn)", "", ge=0, le=1)] = 0.2
    full_scale: Annotated[int, _f("End of the grey scale, 4095 for 12 bit; 0: of the image type", "grey levels", ge=0, le=65535)] = 0
    update: Annotated[str, _f("When an image becomes the new reference", pattern="^(never|every|quality)$")] = "never"
    update_every: Annotated[int, _f("Images from one reference to the next, for update = every", "images", ge=1)] = 100
    update_below: Annotated[float, _f("Median correlation that asks for a new reference, for update = quality", "", ge=0, le=1)] = 0.8
    threads: Annotated[int, _f("Threads that share a field; the result does not depend on it", "", ge=1, le=64)] = 2


class Stress(Section, frozen=True):
    """The shear traction sigma_xz, from the displacement field by the Green's tensor of the block."""

    method: Annotated[str, _f("Profile about the contact's centre on every frame, or none", pattern="^(axisymmetric|none)$")] = (
        "axisymmetric"
    )
    field: Annotated[bool, _f("The traction of every grid point as well, by conjugate gradients", "")] = False


class Recording(Section, frozen=True):
    """The session file."""

    flush_interval: Annotated[float, _f("Time between flushes to disk", "s", gt=0, le=0.5)] = 0.4
    queue: Annotated[float, _f("Data the recorder's queue holds before the run ends by name", "s", gt=0, le=60)] = 4.0


class Sim(Section, frozen=True):
    """The simulated bench: one world, seen by all simulated devices."""

    seed: Annotated[int, _f("Seed of everything random; same seed, same bits", "", ge=0)] = 1
    law: Annotated[
        str,
        _f(
            "Friction at each point: rigid and sliding, mu p (1 - exp(-s/(mu L))), or a table",
            pattern="^(cattaneo-mindlin|elasto-plastic|table)$",
        ),
    ] = "cattaneo-mindlin"
    friction: Annotated[float, _f("Friction coefficient mu of the interface, at 1 N", "", gt=0, le=5)] = 0.93
    friction_decay: Annotated[float, _f("mu falls with the normal force like its power of minus this", "", ge=0, le=1)] = 0.0
    slip_length: Annotated[float, _f("Length L of the elasto-plastic law", "um", gt=0, le=100)] = 0.8
    law_table: Annotated[str, _f("For law = 'table': CSV file of slip (um) and shear traction as a share of mu p, two columns")] = ""
    thickness: Annotated[float, _f("Thickness of the block on its rigid plate (elasto-plastic, table); 0: a half-space", "mm", ge=0)] = 0.0
    renderer: Annotated[str, _f("'fast' keeps up with the camera; 'exact' sums analytic blobs", pattern="^(fast|exact)$")] = "fast"
    force_noise: Annotated[float, _f("Standard deviation of the force noise of each sensor", "mN", ge=0, le=1000)] = 1.0
    read_noise: Annotated[float, _f("Standard deviation of the camera's read noise", "grey levels", ge=0, le=50)] = 1.0
    full_well: Annotated[float, _f("Electrons at full scale (sets the shot noise); 0: no shot noise", "electrons", ge=0)] = 20000.0
    press_time: Annotated[float, _f("When the simulated operator begins to press the contact", "s", ge=0, le=3600)] = 1.25
    slow_actuator: Annotated[bool, _f("The stage really moves 2 to 5 % slower than asked, as in the paper", "")] = True
    stage_drift: Annotated[float, _f("The stage creeps by this besides what it reports", "um/s", ge=-1, le=1)] = 0.0
    drive_angle: Annotated[float, _f("Angle of the drive to the rows of the image", "degrees", ge=-10, le=10)] = 0.0
    image_drift: Annotated[tuple[float, float], _f("The camera drifts over the interface (x, y), as when it warms up", "px/s")] = (0.0, 0.0)


class Config(Section, frozen=True):
    """A bench and what to do with it."""

    run: Run = Run()
    forces: Forces = Forces()
    camera: Camera = Camera()
    actuator: Actuator = Actuator()
    limits: Limits = Limits()
    sample: Sample = Sample()
    dic: Dic = Dic()
    stress: Stress = Stress()
    recording: Recording = Recording()
    sim: Sim = Sim()


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
    low = f"at least {meta.ge:g}" if meta.ge is not None else f"more than {meta.gt:g}" if meta.gt is not None else ""
    high = f"at most {meta.le:g}" if meta.le is not None else f"less than {meta.lt:g}" if meta.lt is not None else ""
    return " and ".join(part for part in (low, high) if part)


def _unit(meta: Meta) -> str:
    return str((meta.extra or {}).get("unit", ""))


def _wanted_text(base: Any, meta: Meta) -> str:
    """What an option may be, for an error: ``a number more than 0 and at most 10 N``."""
    if meta.pattern:
        return _limits_text(meta)
    kinds = {float: "a number", int: "a whole number", bool: "true or false", str: "a text in quotes"}
    if base in kinds:
        kind = kinds[base]
    else:
        kind = "two rows of two numbers, [[a, b], [c, d]]" if "tuple[tuple" in str(base) else "two numbers, [a, b]"
    unit = _unit(meta)
    text = " ".join(part for part in (kind, _limits_text(meta)) if part)
    return f"{text} {unit}" if _limits_text(meta) and unit else f"{text} in {unit}" if unit else text


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return msgspec.json.encode(value).decode()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_toml_value(v) for v in value) + "]"
    return repr(value)


def _comment_text(meta: Meta) -> str:
    """`` [N], more than 0 and at most 10``: what follows the meaning of an option in the settings file."""
    unit, limits = _unit(meta), _limits_text(meta)
    return (f" [{unit}]" if unit else "") + (f", {limits}" if limits else "")


def to_toml(config: Config, comments: bool = True) -> str:
    """The settings as a TOML text, each option with its meaning, unit and limits."""
    lines = ["# SlipScope settings. Delete what you do not change: every option has this default.", ""] if comments else []
    for table, (kind, _) in options(Config).items():
        if comments and kind.__doc__:
            lines.append(f"# {kind.__doc__.strip()}")
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
            raise ConfigError(f"{where}: unknown table or key '{table}'; {_nearest(table)}")
        if not isinstance(content, dict):
            raise ConfigError(f"{where}: '{table}' is a table of options, found {content!r}; write [{table}] above its options")
        known = options(tables[table][0])
        for key, value in content.items():
            if key not in known:
                raise ConfigError(f"{where}: unknown key '{table}.{key}'; {_nearest(f'{table}.{key}')}")
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
    return ConfigError(f"{where}: {table}.{key} must be {_wanted_text(base, meta)}; found {_toml_value(data[table][key])}")


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
    """Settings as a session holds them. One without `dic.method` was measured by the direct one: there was no other."""
    data = tomllib.loads(text)
    if isinstance(data.setdefault("dic", {}), dict):
        data["dic"].setdefault("method", "direct")
    return from_data(data, where)


def correlation(settings: Dic) -> Correlation:
    """The way to correlate that the settings ask for; ValueError if two of them can not be used together."""
    from analysis.dic import Correlation  # takes a second

    own = {"tolerance": settings.tolerance or None, "full_scale": settings.full_scale or None}
    return Correlation(**(msgspec.structs.asdict(settings) | own))


def averaging_box_px(settings: Dic) -> float:
    """Side of the box whose plain average passes as much of long waves as the correlation does (`benchmarks/dic.py waves`)."""
    return 0.6 * settings.box if settings.method == "shared" else float(settings.box)


def _check_together(config: Config, where: str) -> None:
    """The limits that one option sets on another."""
    rate = config.forces.sample_rate / config.camera.divisor
    if rate > config.camera.max_rate:
        least = math.ceil(config.forces.sample_rate / config.camera.max_rate)
        raise ConfigError(
            f"{where}: camera.divisor = {config.camera.divisor} asks {rate:.3g} frames/s, {config.camera.max_rate:g} is the camera's limit;"
            f" use a divisor of {least} or more"
        )
    if exposure_samples(config) > config.camera.divisor:
        raise ConfigError(
            f"{where}: camera.exposure = {config.camera.exposure:g} ms is longer than the trigger period of"
            f" {1e3 / rate:.4g} ms; shorten it or raise camera.divisor"
        )
    if config.run.travel > config.limits.travel:
        raise ConfigError(f"{where}: run.travel = {config.run.travel:g} um is beyond limits.travel = {config.limits.travel:g} um")
    if config.run.normal_force >= config.limits.normal_force:
        raise ConfigError(
            f"{where}: run.normal_force = {config.run.normal_force:g} N is not below limits.normal_force = {config.limits.normal_force:g} N"
        )
    (a, b), (c, d) = config.forces.coupling
    if abs(a * d - b * c) < 1e-6:
        raise ConfigError(f"{where}: forces.coupling has no inverse; its determinant is {a * d - b * c:g}")
    if config.dic.box >= min(config.camera.width, config.camera.height):
        raise ConfigError(f"{where}: dic.box = {config.dic.box} px does not fit the {config.camera.width} x {config.camera.height} image")
    if config.dic != Dic():
        try:
            correlation(config.dic)
        except ValueError as error:
            raise ConfigError(f"{where}: {error}") from None


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
        value = tomllib.loads(f"v = {raw}")["v"]
    except tomllib.TOMLDecodeError:
        value = raw.strip()
    return table, name, value


def _decode(content: bytes) -> str:
    """Text of a settings file; Windows shells write UTF-16 when they redirect output."""
    return content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")


def load(path: Path | None = None, overrides: list[str] | tuple[str, ...] = ()) -> Config:
    """Settings from a TOML file (or the defaults), with ``table.key=value`` overrides on top.

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
            data = tomllib.loads(_decode(path.read_bytes()))
        except OSError as error:
            raise ConfigError(f"{path}: the settings file can not be read: {error.strerror}; check the name") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path}: not a TOML file: {error}") from None
    for text in overrides:
        table, name, value = parse_override(text)
        content = data.setdefault(table, {})
        if isinstance(content, dict):
            content[name] = value
    return from_data(data, where)
