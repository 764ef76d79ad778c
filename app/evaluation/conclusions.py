"""What an experiment comes down to, from the snapshots of its drive."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from analysis.arrays import F64
from analysis.dic.fixed_pattern import Pull
from analysis.friction.local_law import LocalLaw
from analysis.friction.onset import Onset, sliding_onset
from analysis.friction.pressure import check_pressure, modulus_of_width
from analysis.friction.uneven_drive import even_time
from analysis.mechanics.interface import elastic_length
from app.evaluation.budget import Budget, Measured, Values, budget
from app.evaluation.history import DriveForces
from app.evaluation.law_fit import Inverted, inverted
from app.evaluation.loops import local_results
from app.evaluation.readings import NOTHING_SEEN, creep_in_sliding, readings
from app.evaluation.setup import hertz_radius_m, sensor_chain
from app.evaluation.slides import slide_results
from app.evaluation.tractions import PEAK_REACH
from app.records.legs import first_loading
from app.records.record_types import ContactResult, Phase, Snapshot
from app.records.snapshot_numbers import all_series, series_of
from app.records.summary import Summary
from app.settings.sections import Config

LOG = logging.getLogger(__name__)
T = TypeVar("T")
MISALIGNED = math.radians(15.0)  # directions of frames that differ by more do not go together
OBLIQUE = 0.1  # share of the frames from which it is told that they are left out
SETTLED = 8.0  # slip in mu L from which all but exp(-8) of the traction is there
APART = 2.0  # standard uncertainties by which t_s by time and by the way do not agree
LONG_S = 1e3
# by which Q of the past is in the way if it is read late, by a delay or a low-pass; 0: the spring
LATE_S = (0.0, 0.1, 0.3, 1.0)
BUDGET_FRAMES = 96  # frames of the law in a budget, evenly spaced: a derivative needs no more
CENTRAL = 3  # rings whose mean is the pressure at the centre
HALF_WAY = 0.5  # share of the largest Q at which c of the budget is measured
AGREEMENT = "agreement"  # name of the ratio of force to traction among the results with a budget


def attempt(notes: list[str], what: str, estimator: Callable[[], T], otherwise: T) -> T:
    """What an estimator gives. Where it fails that is noted, once: it must not end what is
    measured, nor keep the other estimators from the frame.
    """
    try:
        return estimator()
    except Exception as error:
        LOG.debug("%s", what, exc_info=error)
        if not any(note.startswith(f"{what} failed") for note in notes):
            notes.append(f"{what} failed, first with {type(error).__name__}: {error}")
        return otherwise


def onset_of(measured: Measured, law: LocalLaw) -> Onset:
    """The onset of sliding, once the law is known. Of a drive that the pictures show to be uneven
    it is that of the way of the actuator, where both do not agree.
    """
    drive, config = measured.without_relaxation().drive, measured.config
    time, centre, shear, normal, centre_sd, block, lens = all_series(
        drive,
        "time_s",
        "centre_ux_m",
        "shear_force_n",
        "normal_force_n",
        "centre_ux_sd_m",
        "block_m",
        "lens_m",
    )
    # of two images of equal noise one is the reference
    told_sd = centre_sd[np.isfinite(centre_sd)]
    reference_sd = float(np.median(told_sd)) / math.sqrt(2) if len(told_sd) else 0.0
    settled = SETTLED * slip_scale(config, law, shear, normal)
    forces = measured.forces
    if forces is not None:
        # those of the first loading alone: its last frame may lie beyond the turn of the stage
        end = int(np.searchsorted(forces.time_s, time[-2] if len(time) > 1 else 0.0))
        forces = DriveForces(*(values[:end] for values in forces))

    def onset(time: F64, forces: DriveForces | None) -> Onset:
        return sliding_onset(
            time, centre, shear, normal, shared_sd=reference_sd, settled=settled, samples=forces
        )

    by_time = onset(time, forces)
    # the block, which the lens follows, and what the cantilever is bent
    way = block + lens + shear / config.forces.stiffness_shear
    uneven = even_time(time, way)
    if uneven is None:
        return by_time
    # forces that are read late, or a cantilever of another stiffness, are no uneven drive
    late = np.stack([np.interp(time - by, time, shear) for by in LATE_S])
    columns, known = np.stack([*late, time**0, time], 1), np.isfinite(way)
    share = np.linalg.lstsq(columns[known], way[known])[0]
    if even_time(time, way - share[:-2] @ late) is None:
        return by_time
    even, even_sd = uneven
    # before the first frame and after the last the drive counts as even
    at = np.concatenate([time[:1] - LONG_S, time, time[-1:] + LONG_S])
    then = np.concatenate([even[:1] - LONG_S, even, even[-1:] + LONG_S])
    if forces is not None:
        forces = forces._replace(time_s=np.interp(forces.time_s, at, then))
    by_way = onset(even, forces)
    onset_s, begin_s, end_s = np.interp([by_way.time, *by_way.window], then, at).tolist()
    sd = math.hypot(by_way.time_sd, even_sd)
    off = by_time.time - onset_s
    if not math.isfinite(onset_s):
        return by_time
    if abs(off) < APART * math.hypot(by_time.time_sd, sd):  # it is as uncertain as they differ
        return replace(by_time, time_sd=math.hypot(by_time.time_sd, off))
    note = (
        "onset: the pictures show that the drive is uneven, by up to"
        f" {1e6 * by_way.velocity * float(np.ptp(even - time)):.2g} um, as by the screw of the"
        " stage: t_s and what follows is that of the way, not of the time"
        + (f", by which t_s would be {1e3 * off:+.0f} ms" if math.isfinite(off) else "")
    )
    notes = (*by_way.notes, note)
    return replace(by_way, time=onset_s, time_sd=sd, window=(begin_s, end_s), notes=notes)


def onset_on_the_way(config: Config, frames: list[Snapshot]) -> float:
    """T_s in the time of the drive, from the frames of one motion so far; NaN until it can be
    found.
    """
    time, centre, shear, normal, travel = all_series(
        frames, "time_s", "centre_ux_m", "shear_force_n", "normal_force_n", "travel_m"
    )
    known = np.flatnonzero(np.isfinite(centre))
    if not len(known):
        return math.nan
    way, first = math.copysign(1.0, travel[-1] - travel[0]), known[0]
    settled = SETTLED * slip_scale(config, LocalLaw(), way * shear, normal)
    moved = way * (centre - centre[first])
    found = sliding_onset(time - time[0], moved, way * shear, normal, settled=settled)
    return found.time + float(time[0])


def results_of(
    measured: Measured, most_frames: int | None = None, beside: Inverted | None = None
) -> Values:
    """The results that have a budget, by their names in the session, without uncertainties; those
    of the law from `most_frames` at most, with what `beside` has prepared.
    """
    config, contact = measured.config, measured.contact
    normal = series_of(measured.drive, "normal_force_n")
    force, sample = float(normal.mean()), config.sample
    hertz_m = hertz_radius_m(config, force)
    frames = inverted(measured, hertz_m, most_frames, beside)
    law = frames.law(draws=0) if frames else LocalLaw()
    onset = onset_of(measured, law)
    results = {
        "apparent_radius": contact.apparent_radius_m if contact else math.nan,
        "hertz_radius": hertz_m,
        "onset_time": onset.time,
        "static_force": onset.static_force,
        "mu_s": onset.mu_s,
        "mu_d": onset.mu_d,
        "law_mu": law.mu,
        "law_length": law.L,
        "young_modulus": law.E,
        "sliding_velocity": onset.velocity,
    }
    if frames and math.isfinite(law.E):
        by_width = modulus_of_width(law, force, sample.poisson, sample.lens_radius)[0]
        at_centre = float(law.pressure[:CENTRAL].mean())
        results |= {
            "pressure": at_centre,
            "stress": at_centre * law.mu * sample.young_modulus / law.E,
            "block_displacement": float(law.D[-1]),
            "peak_radius": frames.stick_radius(HALF_WAY, PEAK_REACH * hertz_m),
            AGREEMENT: law.E / by_width,
        }
    return results


class Conclusion(NamedTuple):
    """What an experiment comes down to; `law_frames` are the numbers of the frames of the law's
    slip and ratio, row by row.
    """

    summary: Summary
    law: LocalLaw
    law_frames: tuple[int, ...]


def conclude(
    config: Config,
    snapshots: list[Snapshot],
    contact: ContactResult | None,
    notes: list[str],
    pull: Pull | None = None,
    forces: DriveForces | None = None,
) -> Conclusion:
    """What the experiment comes down to (paper, sections 2.3.1 and 3), from the snapshots and the
    forces of the drive; `pull` is that of a fixed pattern, which the former are corrected for.
    """
    driven = (s for s in snapshots if s.conditions.phase is Phase.DRIVE)
    loaded = [s for s in driven if s.conditions.has_forces]
    drive = along_the_drive(loaded)
    whole = Measured(config, drive, contact, forces=forces).delayed(config.forces.delay)
    elastic = whole.without_relaxation()
    measured = replace(whole, drive=first_loading(whole.drive))
    notes = list(notes)
    oblique = int(np.count_nonzero(np.abs(_turns(loaded)) < math.cos(MISALIGNED)))
    if oblique > OBLIQUE * len(loaded):
        notes.append(
            f"camera: the results do without {oblique} of {len(loaded)} frames of the drive, in"
            " which the block seems to move another way: the picture shakes, or turns"
        )
    against = int(np.count_nonzero(_turns(loaded) <= -math.cos(MISALIGNED)))
    if against > OBLIQUE * len(loaded):
        notes.append(
            f"camera: the results leave out {against} of {len(loaded)} frames of the drive, in"
            " which the block is behind its place in the reference, but by the stage it is not:"
            " give camera.angle, with camera.angle_from = 'angle'"
        )
    first = first_loading(elastic.drive)
    seen = attempt(
        notes,
        "readings",
        lambda: readings(config, snapshots, first, elastic.drive, forces),
        NOTHING_SEEN,
    )
    measured = replace(measured, seen=seen, pull=pull)
    normal = series_of(measured.drive, "normal_force_n")
    force = float(normal.mean()) if drive else math.nan
    hertz_m = hertz_radius_m(config, force)

    frames = attempt(notes, "local law", lambda: inverted(measured, hertz_m), None)
    law = LocalLaw()
    if frames is not None:
        law = attempt(notes, "local law", frames.law, law)
    onset = attempt(notes, "onset", lambda: onset_of(measured, law), Onset())
    crept: tuple[str, ...] = attempt(
        notes, "drift", lambda: creep_in_sliding(config, first, onset.window[0]), ()
    )
    nothing = Budget()
    spent = nothing
    if math.isfinite(onset.time) or law.sliding:
        spent = attempt(notes, "budget", lambda: _spent(measured, law, hertz_m), nothing)
    calibration = math.hypot(*sensor_chain(config).relative_uncertainty())
    sample, agreement = config.sample, spent.relative_sd(AGREEMENT)
    parameters = (force, sample.poisson, sample.lens_radius, sample.roughness)
    silent: tuple[str, ...] = ()
    disagreement = silent
    if law.sliding and math.isfinite(agreement):
        disagreement = attempt(
            notes,
            "pressure",
            lambda: check_pressure(law, *parameters, relative_sd=agreement).notes,
            silent,
        )
    local: dict[str, Any] = attempt(
        notes, "loops", lambda: local_results(whole, law, hertz_m, onset.time), {}
    )
    none: dict[str, Any] = {}
    shear = series_of(measured.drive, "shear_force_n")
    slip_m = slip_scale(config, law, shear, normal)
    local |= attempt(notes, "slides", lambda: slide_results(whole, notes, slip_m), none)
    summary = Summary(
        normal_force_n=force,
        apparent_radius_m=contact.apparent_radius_m if contact else math.nan,
        apparent_radius_sd_m=contact.apparent_radius_sd_m if contact else math.nan,
        hertz_radius_m=hertz_m,
        onset_time_s=onset.time,
        onset_time_sd_s=onset.time_sd,
        static_force_n=onset.static_force,
        static_force_sd_n=onset.static_force_sd,
        mu_s=onset.mu_s,
        mu_s_sd=onset.mu_s_sd,
        mu_d=onset.mu_d,
        mu_d_sd=onset.mu_d_sd,
        mu_d_range=onset.mu_d_range,
        sliding_velocity_m_s=onset.velocity,
        notes=(
            *notes,
            *_on_relaxation(whole),
            *seen.notes,
            *crept,
            *onset.notes,
            *law.notes,
            *disagreement,
            *spent.notes,
        ),
        law_chi2=law.reduced_chi2,
        pressure_radius_m=tuple(law.radius.tolist()),
        pressure_pa=tuple(law.pressure.tolist()),
        pressure_sd_pa=tuple(law.pressure_sd.tolist()),
        law_mu=law.mu,
        law_mu_sd=law.mu_sd,
        law_length_m=law.L,
        law_length_sd_m=law.L_sd,
        young_modulus_pa=law.E,
        young_modulus_sd_pa=law.E_sd,
        calibration_sd=calibration,
        budget_inputs=spent.inputs,
        budget_quantities=spent.results,
        budget=tuple(share for row in spent.shares for share in row),
        **local,
    )
    return Conclusion(summary, law, tuple(s.frame for s in frames.frames) if frames else ())


def _on_relaxation(measured: Measured) -> tuple[str, ...]:
    """What the results take for the modulus of a block that relaxes."""
    sample = measured.config.sample
    if not sample.relaxation:
        return ()
    told = (
        f"block: {100 * sample.relaxation:.3g} % of its modulus at once is taken to relax with"
        f" {sample.relaxation_time:.3g} s (sample.relaxation)"
    )
    if not any(s.traction for s in measured.drive):
        return (f"{told}, but there is no shear traction, so that t_s and mu_s are not corrected",)
    return (
        f"{told}: E is the relaxed modulus; E, L, the pressure, t_s, mu_s and local work are"
        " corrected, c and the tractions of the frames are those of an elastic block",
    )


def _spent(measured: Measured, law: LocalLaw, hertz_m: float) -> Budget:
    """The budget from some frames, or from all where some do not tell the law."""
    few = inverted(measured, hertz_m, BUDGET_FRAMES)
    some = results_of(measured, BUDGET_FRAMES, few)
    is_told = all(
        math.isfinite(some[name]) or not math.isfinite(value)
        for name, value in (("law_mu", law.mu), ("law_length", law.L), ("young_modulus", law.E))
    )
    most = BUDGET_FRAMES if is_told else None
    return budget(measured, lambda now: results_of(now, most, few))


def slip_scale(config: Config, law: LocalLaw, shear: F64, normal: F64) -> float:
    """Mu L in metres: measured, or else by the greatest Q/P and the roughness of the settings."""
    if math.isfinite(law.L):
        return law.mu * law.L
    sample = config.sample
    loaded = normal > 0
    ratios = shear[loaded] / normal[loaded]
    ratio = float(ratios[np.isfinite(ratios)].max(initial=0.0))
    return ratio * elastic_length(sample.roughness, sample.poisson)


def along_the_drive(drive: list[Snapshot]) -> list[Snapshot]:
    """Those frames of a drive whose direction in the picture is that of most: before the block has
    moved, a turned picture is not known to be one.
    """
    off = _turns(drive) < math.cos(MISALIGNED)
    return [s for s, is_off in zip(drive, off, strict=True) if not is_off]


def _turns(drive: list[Snapshot]) -> F64:
    """Cosine of the angle between the direction of each frame and that of most; NaN where it is not
    known.
    """
    angle = series_of(drive, "drive_angle_rad") if drive else np.empty(0)
    if not np.isfinite(angle).any():
        return np.full(len(drive), np.nan)
    x, y = np.nanmedian(np.cos(angle)), np.nanmedian(np.sin(angle))
    return np.cos(angle - math.atan2(y, x))
