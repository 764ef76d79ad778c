"""What an experiment comes down to, from the snapshots of its drive."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import TypeVar

from analysis.friction.local_law import LocalLaw
from analysis.friction.onset import Onset, sliding_onset
from analysis.friction.pressure import check_pressure
from analysis.mechanics import hertz
from app.engine.law import local_law
from app.engine.setup import sensor_chain
from app.numbers import series_of
from app.records import ContactResult, Phase, Snapshot, Summary
from app.settings import Config

LOG = logging.getLogger(__name__)
T = TypeVar("T")
SCALE_SD = 0.01  # relative, of pixel size and radius of the lens together


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


def hertz_radius_m(config: Config, normal_force_n: float) -> float:
    """Hertz contact radius of the settings' sample at a normal force, NaN for none."""
    s = config.sample
    if not normal_force_n > 0:
        return math.nan
    return float(hertz.contact_radius(normal_force_n, s.young_modulus, s.poisson, s.lens_radius))


def summarise(
    config: Config, snapshots: list[Snapshot], contact: ContactResult | None, notes: list[str]
) -> Summary:
    """What the experiment comes down to (paper, sections 2.3.1 and 3), from the snapshots of the
    drive.
    """
    drive = [s for s in snapshots if s.conditions.phase is Phase.DRIVE]
    time, centre, shear, normal = (
        series_of(drive, name)
        for name in ("time_s", "centre_ux_m", "shear_force_n", "normal_force_n")
    )
    force = float(normal.mean()) if drive else math.nan
    notes = list(notes)
    onset = attempt(notes, "onset", lambda: sliding_onset(time, centre, shear, normal), Onset())
    hertz_m = hertz_radius_m(config, force)
    law = attempt(
        notes, "local law", lambda: local_law(config, drive, contact, hertz_m), LocalLaw()
    )
    calibration = math.hypot(*sensor_chain(config).relative_uncertainty())
    sample, common = config.sample, math.hypot(calibration, SCALE_SD)
    told = (force, sample.poisson, sample.lens_radius, sample.roughness)
    nothing: tuple[str, ...] = ()
    disagreement = attempt(
        notes,
        "pressure",
        lambda: check_pressure(law, *told, relative_sd=common).notes if law.sliding else nothing,
        nothing,
    )
    return Summary(
        normal_force_n=force,
        apparent_radius_m=contact.apparent_radius_m if contact else math.nan,
        apparent_radius_sd_m=contact.apparent_radius_sd_m if contact else math.nan,
        hertz_radius_m=hertz_m,
        onset_time_s=onset.time,
        onset_time_sd_s=onset.time_sd,
        static_force_n=onset.static_force,
        mu_s=onset.mu_s,
        mu_s_sd=onset.mu_s_sd,
        mu_d=onset.mu_d,
        mu_d_range=onset.mu_d_range,
        sliding_velocity_m_s=onset.velocity,
        notes=(*notes, *onset.notes, *law.notes, *disagreement),
        law_mu=law.mu,
        law_mu_sd=law.mu_sd,
        law_length_m=law.L,
        law_length_sd_m=law.L_sd,
        young_modulus_pa=law.E,
        young_modulus_sd_pa=law.E_sd,
        calibration_sd=calibration,
    )
