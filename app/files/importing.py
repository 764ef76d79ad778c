"""Images and forces of other benches and programs, made into a session: settings, times, phases."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import F64, Array
from analysis.saturation import end_of_scale
from app.evaluation.frame_analysis import Analysis
from app.evaluation.pipeline import Pipeline
from app.evaluation.setup import header_of, pattern_of
from app.files.clocks import TOLERANCE, clocks_of, motion_of, only_clock
from app.files.forms import quoted
from app.files.frames import (
    ImportedTrigger,
    Sources,
    files_of,
    first_image,
    image_or_reason,
    listed,
    numbered,
    with_lost,
)
from app.files.grey_images import size_text
from app.files.imported_forces import measurements_of, rate_of
from app.files.phases import LONGEST_SD_S
from app.files.text_tables import (
    FORCES,
    FRAMES,
    LONGEST_S,
    TextTable,
    clock_samples,
    read_table,
)
from app.records.quantities import counted
from app.records.record_types import End, Event, Outcome, Phase
from app.replay.loop import Measurements, Trigger, record_analysis
from app.session.files import check_new_session
from app.session.versions import versions
from app.settings.certificates import calibration_records
from app.settings.config import load, read_settings
from app.settings.sections import Config
from app.system.errors import UserError
from app.system.progress import HowFar, unheard
from drivers.protocols import Frame, LostFrame

LATE = 0.05  # forces that begin later than this share of the images' time are noted
# of an experiment with forces, of which one at least must be measured
RESULTS = (
    *("apparent_radius_m", "onset_time_s", "mu_d", "law_mu", "law_length_m", "young_modulus_pa"),
    "sliding_velocity_m_s",
)


@dataclass(frozen=True, slots=True)
class Imported:
    """How the import ended, what was found and assumed, a sentence each, and how many samples are
    beside the table of forces, before its first row or after its last.
    """

    outcome: Outcome
    remarks: tuple[str, ...]
    samples_outside: int
    has_result: bool

    @property
    def shortcoming(self) -> str:
        """Why nothing came of it, and what to do; empty if there is a result."""
        counts, summary = self.outcome.counts, self.outcome.summary
        if not counts.frames_received:
            return "import: none of the images could be read; see the reasons in the session"
        if summary is not None and summary.normal_force_n < 0:
            return (
                f"import: P is {summary.normal_force_n:.3g} N under load, and must be positive"
                ' there; turn its sign with a minus: --columns "P_N=-NAME"'
            )
        if summary is None or self.has_result:
            return ""
        why = "; ".join(summary.notes[:3]) or "no quantity could be measured"
        return (
            f"import: nothing was measured ({why}); check the phases listed above, and give"
            " --background, --reference, --drive or --time-offset"
        )


def import_files(
    sources: Sources,
    output: Path,
    *,
    overwrite: bool = False,
    on_progress: HowFar = unheard,
) -> Imported:
    """Make a session at `output` of all images and forces, analysed as in a live run; it is
    complete or not there at all.

    Raises
    ------
    UserError, ConfigError
        Something cannot be used, or is needed and missing.
    """
    check_new_session(output, overwrite, has_picture=False)
    read = understood(sources, on_progress)
    config, frames, first = read.config, read.frames, read.first
    lost = sum(frame.path is None for frame in frames)
    reason = f"imported: {counted(len(frames) - lost, 'image')} given, {lost} missing, from"
    reason += f" {sources.images[0]}" + f", forces from {read.forces}" * bool(read.forces)
    read.measured.events.append(Event(len(read.measured.volts), "import", reason))
    end, exposure = len(read.measured.volts), config.exposure_samples

    pipeline, measured_fields = Pipeline(config, pattern_of(config)), 0
    analysis = Analysis(config, pipeline)

    def triggers() -> Iterator[Trigger]:
        nonlocal measured_fields
        for frame in frames:
            image, span = image_or_reason(frame, first), (frame.first, frame.last)
            if isinstance(image, str):
                yield LostFrame(frame.index, frame.sample, image, *span), None, None
            else:
                yield Frame(frame.index, frame.sample, image, *span, frame.stamp_s), image, None
                field = analysis.series.since(len(analysis.series) - 1)[0].field
                measured_fields += field is not None and bool(np.isfinite(field.ux_px).any())
            on_progress(f"frame {frame.index}", (frame.sample + exposure) / end)

    first_trigger = max(0, frames[0].sample - frames[0].index * config.camera.divisor)
    outcome = record_analysis(
        analysis,
        read.measured,
        triggers(),
        header_of(
            config, versions() | calibration_records(config), first_trigger, pipeline.pattern
        ),
        output,
        lambda: (End.IMPORTED, reason),
        overwrite=overwrite,
    )
    summary = outcome.summary
    if summary is not None and summary.mu_d < 0 < summary.normal_force_n:
        read.remarks.append(
            "Q is negative while the block moves along the drive, so that friction is negative;"
            ' turn its sign with a minus: --columns "Q_N=-NAME"'
        )
    has_result = (
        measured_fields > 0
        if read.forces is None
        else summary is not None and any(math.isfinite(getattr(summary, name)) for name in RESULTS)
    )
    return Imported(outcome, tuple(read.remarks), read.outside, has_result)


@dataclass(frozen=True, slots=True)
class Understood:
    """What is to be imported, once it is known what everything means."""

    config: Config
    frames: list[ImportedTrigger]
    first: Array
    measured: Measurements
    remarks: list[str]
    forces: Path | None
    outside: int


def understood(sources: Sources, on_progress: HowFar = unheard) -> Understood:
    """Read the tables and the first image, and find clocks and phases; see `import_files`."""
    remarks: list[str] = []
    sources, files = files_of(sources, remarks)
    table = read_table(sources.metadata, FRAMES, sources.form) if sources.metadata else None
    forces = read_table(sources.forces, FORCES, sources.form) if sources.forces else None
    if forces is not None and sources.rate_hz is not None:
        forces = forces.timed(sources.rate_hz, remarks)
    tables = [one for one in (table, forces) if one]
    _check_named(sources, tables)
    frames = numbered(files, remarks) if table is None else listed(table, files, remarks)
    first = first_image(frames)
    given = _given(sources)
    seen = f"{len(files)} images of {size_text(first)}, {files[0]} to {files[-1].name}"
    if missing := _missing(sources, given, table, forces):
        read = ". ".join([seen, *(one.description for one in tables)])
        if len(missing) > 1:
            missing = [f"({n}) {one}" for n, one in enumerate(missing, 1)]
        raise UserError(f"import: {'; '.join(missing)}. What was read: {read}")
    remarks += [one.description for one in tables]
    rate = rate_of(sources, given, forces)
    config = _settings(sources, given, first, table, forces, rate)
    if sources.settings is None:
        remarks.append(
            "no settings file: the sample, the lens and the sensors are those that `slipscope"
            " config` prints" + (", but for what --set gives" if sources.overrides else "")
        )
    places, clock_sd_s = _places(frames, table, config, sources), 0.0
    if forces is not None:
        on_progress("comparing the clocks of images and forces", 0.0)
        places, table, forces, clock_sd_s = _on_one_clock(
            sources, config, frames, places, table, forces, first, remarks
        )
    if table is not None:
        rate_hz = float(config.forces.sample_rate)
        if forces is None:
            table = table.from_its_start(rate_hz, remarks)
        if (at := clock_samples(table, rate_hz)) is not None:
            places = at
    for frame, place in zip(frames, places.tolist(), strict=True):
        frame.sample = round(place)
    frames = with_lost(frames)
    measured, start_sd_s = measurements_of(config, frames, table, places, forces, sources, remarks)
    whole_sd_s = min(math.hypot(start_sd_s, clock_sd_s), LONGEST_SD_S)
    found = {"start": whole_sd_s, "delay": clock_sd_s}
    found = {name: sd for name, sd in found.items() if sd and f"uncertainty.{name}" not in given}
    config = replace(config, uncertainty=replace(config.uncertainty, **found))
    _tell_saturated(config, frames, measured, first, remarks)
    outside = 0
    if forces is not None:
        is_known = np.asarray(np.isfinite(measured.volts).all(axis=1))
        known = np.flatnonzero(is_known)
        outside = len(is_known) - int(known[-1] - known[0] + 1) if len(known) else 0
        bare = [frame.index for frame in frames if frame.path and not is_known[frame.sample]]
        if bare:
            remarks.append(
                f"for {len(bare)} of {len(frames)} images there are no forces, the first is frame"
                f" {bare[0]}, the last frame {bare[-1]}"
            )
    return Understood(config, frames, first, measured, remarks, sources.forces, outside)


def _tell_saturated(
    config: Config,
    frames: list[ImportedTrigger],
    measured: Measurements,
    first: Array,
    remarks: list[str],
) -> None:
    """A remark if the grey scale of the reference ends before that of its type."""
    at = next((e.sample for e in measured.events if e.text == Phase.REFERENCE), -1)
    reference = next((one for one in frames if one.path and one.sample >= at), None)
    image = None if reference is None else image_or_reason(reference, first)
    given = config.correlation.full_scale
    if image is None or isinstance(image, str) or (end := end_of_scale(image, given)) >= given:
        return
    remarks.append(
        f"{(image >= end).mean():.2%} of the pixels of the reference share the grey level {end:g},"
        " at which the grey scale seems to end: they count as saturated; --set dic.full_scale=LEVEL"
        " says where it ends"
    )


def _check_named(sources: Sources, tables: list[TextTable]) -> None:
    """Refuse columns that are named and nowhere found."""
    for column, name in sources.form.columns.items():
        if not any(column.partition("_")[0].lower() in one.columns for one in tables):
            headers = "; ".join(f"{one.path.name}: {quoted(one.header)}" for one in tables)
            raise UserError(
                f"--columns: '{column}={name}' fits no table; there are the columns"
                f" {headers or 'of no table'}, and the quantities time_s, P_N, Q_N, normal_V,"
                " shear_V, stage_um, sample, frame, file"
            )


def _given(sources: Sources) -> set[str]:
    """``table.key`` of all settings that a file or --set gives."""
    data = {} if sources.settings is None else read_settings(sources.settings)
    keys = {
        f"{table}.{key}"
        for table, content in data.items()
        if isinstance(content, dict)
        for key in content
    }
    return keys | {one.partition("=")[0].strip() for one in sources.overrides}


def _missing(
    sources: Sources, given: set[str], table: TextTable | None, forces: TextTable | None
) -> list[str]:
    """What has to be known and is not, a clause each with what gives it."""
    missing: list[str] = []
    if sources.pixel_um is None and "camera.pixel" not in given:
        missing.append("the size of a pixel, um, is not known; give --pixel, or --settings")
    has_rate = sources.rate_hz is not None or "forces.sample_rate" in given
    has_divisor = sources.divisor is not None or "camera.divisor" in given
    by_samples = (table is not None and table.has("sample")) or (
        forces is not None and forces.has("sample")
    )
    is_timed = table is not None and (table.has("sample") or table.has("time"))
    if not is_timed and sources.frame_rate is None and not has_divisor:
        missing.append(
            "the time from one image to the next is not known; give --frame-rate HZ (or --divisor"
            " SAMPLES of the clock of --rate HZ), or a table --metadata with a column time_s"
        )
    uses_divisor = has_divisor and not is_timed and sources.frame_rate is None
    if not has_rate and (by_samples or uses_divisor):
        missing.append(
            "the samples of the forces per second (without forces: of the times of images), Hz, are"
            " not known; give --rate, or --settings"
        )
    if forces is not None:
        if not (forces.has("p", "q") or forces.has("normal", "shear")):
            missing.append(
                f"{forces.path}: the header has neither P_N and Q_N nor normal_V and shear_V; name"
                " the columns so, or say which they are:"
                ' --columns "time_s=NAME, P_N=NAME, Q_N=NAME" (units N, mN, V, mV; s, ms)'
            )
        if not forces.has("sample") and not forces.has("time"):
            missing.append(
                f"{forces.path}: the header has neither sample nor time_s; say when each row was"
                ' measured: --columns "time_s=NAME", or --rate HZ if the rows are evenly spaced'
            )
    return missing


def _settings(
    sources: Sources,
    given: set[str],
    first: Array,
    table: TextTable | None,
    forces: TextTable | None,
    rate: int | None,
) -> Config:
    """The settings of the analysis: those given, with what the images and the options say."""
    known: dict[str, Any] = {
        "camera.width": first.shape[1],
        "camera.height": first.shape[0],
        "camera.max_rate": 10000,  # they are taken already
        "camera.pixel": sources.pixel_um,
        "forces.sample_rate": rate,
        "camera.divisor": sources.divisor,
    }
    if forces is None:
        known["sample.lens_compliance"] = 0  # without Q nobody knows how far the lens moved
    overrides = [f"{key}={value}" for key, value in known.items() if value is not None]

    def loaded(*more: str) -> Config:
        asked = [*overrides, *sources.overrides, *more]
        return load(sources.settings, asked, recorded=True, option="options")

    if sources.divisor is None and (table is not None or sources.frame_rate is not None):
        found = loaded("camera.divisor=1000000").forces.sample_rate
        apart = found / sources.frame_rate if sources.frame_rate else 0.0
        if table is not None and (at := table.places(found)) is not None and len(at) > 1:
            numbers = table.numbers.get("frame", np.arange(table.rows))
            apart = float(np.median(np.diff(at) / np.diff(numbers)))
        if apart:
            overrides.append(f"camera.divisor={max(1, round(apart))}")
            most_s = max(1, round(apart)) / found
            if "camera.exposure" not in given and Config().camera.exposure > most_s:
                overrides.append(f"camera.exposure={1e3 * most_s:g}")
    config = loaded()
    if config.camera.dtype != first.dtype:
        word = "Mono8" if first.dtype == np.uint8 else "Mono16"
        config = loaded(f"camera.pixel_format={word}")
    return config


def _places(
    frames: list[ImportedTrigger], table: TextTable | None, config: Config, sources: Sources
) -> F64:
    """Place of each image on the sample clock; where no table has times, that of its number."""
    rate = float(config.forces.sample_rate)
    if table is not None and (at := table.places(rate)) is not None:
        return at
    apart = rate / sources.frame_rate if sources.frame_rate else float(config.camera.divisor)
    return np.array([frame.index * apart for frame in frames])


def _on_one_clock(
    sources: Sources,
    config: Config,
    frames: list[ImportedTrigger],
    places: F64,
    table: TextTable | None,
    forces: TextTable,
    first: Array,
    remarks: list[str],
) -> tuple[F64, TextTable | None, TextTable, float]:
    """The places of the images, and both tables, counted from one origin: the clock of the forces
    is moved by --time-offset, or by as much as the images say, with the standard uncertainty (s) of
    that.

    Raises
    ------
    UserError
        Forces and images do not overlap.
    """
    rate = float(config.forces.sample_rate)
    at = forces.places(rate)
    assert at is not None
    if not (np.diff(at) > 0).all():
        clock_samples(forces, rate)  # says which row
    offset_s, sd_s = sources.offset_s, 0.0
    if offset_s is None:
        offset_s = 0.0
        if not forces.has("sample") and len(places) > 1 and not any(f.phase for f in frames):
            places_s = places / rate
            offset_s, sd_s = _offset_s(config, frames, places_s, forces, first, remarks)
    elif math.isfinite(offset_s):
        remarks.append(
            f"{offset_s:.12g} s are added to the times of the forces, as --time-offset says"
        )
    else:
        raise UserError(f"--time-offset: {offset_s:g} is no number of seconds; give a finite one")
    begin, end = float(at[0]) / rate + offset_s, float(at[-1]) / rate + offset_s
    from_s, to_s = places[0] / rate, places[-1] / rate
    if not (end >= from_s and begin <= to_s + config.exposure_samples / rate):
        raise UserError(
            f"import: the forces cover {begin:.12g} to {end:.12g} s, the images {from_s:.12g} to"
            f" {to_s:.12g} s, which do not overlap; move the clock of the forces with --time-offset"
            f" SECONDS: {from_s - begin:.12g} if both began together"
        )
    origin = min(begin, from_s)
    if 0 <= origin <= LONGEST_S and max(begin, from_s) - origin < LONGEST_S:
        origin = 0.0
    elif origin:
        remarks.append(
            f"sample 0 is at {origin:.12g} s of the images' clock, where"
            f" {'the forces' if begin < from_s else 'the images'} begin"
        )
    table = table and table.shifted(-origin, rate)
    return places - origin * rate, table, forces.shifted(offset_s - origin, rate), sd_s


def _offset_s(
    config: Config,
    frames: list[ImportedTrigger],
    times_s: F64,
    forces: TextTable,
    first: Array,
    remarks: list[str],
) -> tuple[float, float]:
    """What is to be added to the times of the forces, and its standard uncertainty: both 0 if
    images and Q begin to move together; `UserError` where several clocks are possible.
    """

    def image(number: int) -> Array | None:
        found = image_or_reason(frames[number], first)
        return None if isinstance(found, str) else found

    motion = motion_of(times_s.tolist(), image)
    names = ("p", "q") if forces.has("p", "q") else ("normal", "shear")
    normal, shear = (forces.numbers[name] for name in names)
    at = forces.numbers["time"]
    exposure_s = config.exposure_samples / config.forces.sample_rate
    match = None
    if motion is not None:
        match = only_clock(clocks_of(motion, at, normal, shear, exposure_s))
    known = at[np.isfinite(at)]
    if match is None:
        late = LATE * (times_s[-1] - times_s[0])
        if known[0] > times_s[0] + late or known[-1] < times_s[-1] - late:
            remarks.append(
                f"the forces cover {known[0]:.12g} to {known[-1]:.12g} s, the images"
                f" {times_s[0]:.12g} to {times_s[-1]:.12g} s: if their clocks began at different"
                " times, give --time-offset SECONDS"
            )
        return 0.0, 0.0
    apart = float(np.median(np.diff(times_s)))
    close = max(3 * match.sd_s, TOLERANCE * apart)
    ahead = f"{match.ahead_s:.3f} ± {match.sd_s:.3f} s"
    if abs(match.ahead_s) <= close:
        return 0.0, 0.0
    together = {"began": known[0] - times_s[0], "ended": known[-1] - times_s[-1] - apart}
    which = next((one for one in together if abs(together[one] - match.ahead_s) <= close), "")
    added = -float(together.get(which, match.ahead_s))
    both = f", with which both {which} together" if which else ""
    remarks.append(
        f"the clock of the forces is {ahead} ahead of that of the images, by the start of the"
        f" motion in both; {added:.3f} s are added to its times{both} (--time-offset SECONDS for"
        " another)"
    )
    return added, min(match.sd_s, LONGEST_SD_S)
