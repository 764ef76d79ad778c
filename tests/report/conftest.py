"""A loading experiment in closed form: Cattaneo and Mindlin's contact, then sliding."""

from __future__ import annotations

from dataclasses import dataclass

import closed_form as exact
import numpy as np
import pytest

from app.records.record_types import (
    Conditions,
    ContactResult,
    DisplacementField,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
    Stick,
)
from app.records.study_results import StudyResults
from app.records.summary import Summary

PIXEL_M, E_PA, NU, MU, P_N, K_T, VELOCITY = 7.04e-6, 3.43e6, 0.5, 0.93, 0.5, 9579.0, 4.83e-6
SHEAR_PA = E_PA / (2 * (1 + NU))
HERTZ_M = (3 * P_N * 128.8e-3 * (1 - NU**2) / (4 * E_PA)) ** (1 / 3)
LENS_M_PER_N = 0.68e-6


@dataclass(frozen=True)
class Loading:
    """Arguments of `app.report.figures.experiment_figure`."""

    snapshots: list[Snapshot]
    contact: ContactResult
    summary: Summary
    x_px: np.ndarray
    y_px: np.ndarray


def potential(r: np.ndarray, a: float) -> np.ndarray:
    """Azimuthal mean of the displacement under sqrt(1 - r^2/a^2), times 2 pi G / (1 - nu/2)."""
    outside = np.maximum(r, a)
    far = (
        np.pi
        / (2 * a)
        * ((2 * a**2 - outside**2) * np.arcsin(a / outside) + a * np.sqrt(outside**2 - a**2))
    )
    return np.where(r <= a, np.pi**2 * (2 * a**2 - r**2) / (4 * a), far)


def radial_displacement(r: np.ndarray, c: float) -> np.ndarray:
    """u_x(r) where a circle of radius c sticks."""
    q0 = MU * 3 * P_N / (2 * np.pi * HERTZ_M**2)
    scale = q0 * (1 - NU / 2) / (2 * np.pi * SHEAR_PA)

    def pulled(at: np.ndarray) -> np.ndarray:
        inner = c / HERTZ_M * potential(at, c) if c > 0 else 0.0
        return scale * (potential(at, HERTZ_M) - inner)

    return pulled(np.zeros(1))[0] - pulled(r)


@pytest.fixture(scope="session")
def loading() -> Loading:
    rng = np.random.default_rng(5)
    x_px, y_px = np.arange(19.5, 1580, 20), np.arange(19.5, 1180, 20)
    centre = (812.0, 590.0)
    r = np.hypot(*np.meshgrid((x_px - centre[0]) * PIXEL_M, (y_px - centre[1]) * PIXEL_M))
    rings = np.arange(10, 560, 10) * PIXEL_M
    shift_cm = 3 * MU * P_N * (2 - NU) / (16 * SHEAR_PA * HERTZ_M)
    onset = (shift_cm + MU * P_N / K_T) / VELOCITY
    snapshots = []
    for frame, time in enumerate(np.arange(0.5, 38, 0.25)):
        travel = VELOCITY * time
        share = np.linspace(0, 1, 4000)
        share = np.interp(
            travel, shift_cm * (1 - (1 - share) ** (2 / 3)) + MU * P_N * share / K_T, share
        )
        c = HERTZ_M * np.cbrt(1 - share)
        slid = max(0.0, travel - VELOCITY * onset)
        force = share * MU * P_N
        ux_m = (
            radial_displacement(r, c) + slid + LENS_M_PER_N * force + rng.normal(0, 0.1e-6, r.shape)
        )
        ring_ux = radial_displacement(rings, c) + slid
        is_known = 0.1 < c / HERTZ_M < 0.97
        stick_m = float(c + rng.normal(0, 2e-5)) if is_known else np.nan
        noise = np.full(r.shape, 0.01, np.float32)
        snapshots.append(
            Snapshot(
                frame,
                125 * frame,
                Conditions(Phase.DRIVE, float(time), P_N, float(force), float(travel)),
                motion=FrameMotion(float(LENS_M_PER_N * force), float(slid)),
                field=DisplacementField(
                    (ux_m / PIXEL_M).astype(np.float32),
                    np.zeros(r.shape, np.float32),
                    noise,
                    noise,
                    np.ones(r.shape, np.float32),
                    np.zeros(r.shape, np.uint8),
                ),
                rings=RingProfile(rings, ring_ux, np.full(rings.shape, 2e-8)),
                stick=Stick(stick_m, 2e-5 / max(c / HERTZ_M, 0.1), np.nan) if is_known else None,
            )
        )
    summary = Summary(
        P_N,
        HERTZ_M + 2.7e-4,
        4e-5,
        HERTZ_M,
        float(onset),
        0.12,
        MU * P_N,
        MU,
        0.004,
        MU,
        (MU - 0.006, MU + 0.008),
        VELOCITY,
    )
    contact = ContactResult(centre, HERTZ_M + 2.7e-4, 4e-5, (0.0, 0.0), np.zeros(0), np.zeros(0))
    return Loading(snapshots, contact, summary, x_px, y_px)


@pytest.fixture(scope="session")
def results() -> StudyResults:
    """Runs of several loads in closed form, analysed."""
    return exact.campaign()
