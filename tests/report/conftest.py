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

P_N, VELOCITY, PIXEL_M, MU = 0.5, 4.83e-6, exact.PIXEL, exact.MU
SHEAR_PA = exact.STATED_E / (2 * (1 + exact.NU))
HERTZ_M = exact.hertz_radius(P_N, exact.STATED_E)


@dataclass(frozen=True)
class Loading:
    """Arguments of `app.report.figures.experiment_figure`."""

    snapshots: list[Snapshot]
    contact: ContactResult
    summary: Summary
    x_px: np.ndarray
    y_px: np.ndarray


def radial_displacement(r: np.ndarray, c: float) -> np.ndarray:
    """u_x(r) where a circle of radius c sticks."""
    centre, there = (exact.elastic(at, c, P_N, exact.STATED_E) for at in (np.zeros(1), r))
    return centre - there


@pytest.fixture(scope="session")
def loading() -> Loading:
    rng = np.random.default_rng(5)
    x_px, y_px = np.arange(19.5, 1580, 20), np.arange(19.5, 1180, 20)
    centre = (812.0, 590.0)
    r = np.hypot(*np.meshgrid((x_px - centre[0]) * PIXEL_M, (y_px - centre[1]) * PIXEL_M))
    rings = np.arange(10, 560, 10) * PIXEL_M
    shift_cm = 3 * MU * P_N * (2 - exact.NU) / (16 * SHEAR_PA * HERTZ_M)
    onset = (shift_cm + MU * P_N / exact.K_T) / VELOCITY
    snapshots = []
    for frame, time in enumerate(np.arange(0.5, 38, 0.25)):
        travel = VELOCITY * time
        share = np.linspace(0, 1, 4000)
        share = np.interp(
            travel, shift_cm * (1 - (1 - share) ** (2 / 3)) + MU * P_N * share / exact.K_T, share
        )
        c = HERTZ_M * np.cbrt(1 - share)
        slid = max(0.0, travel - VELOCITY * onset)
        force = share * MU * P_N
        lens = float(exact.COMPLIANCE * force)
        ux_m = radial_displacement(r, c) + slid + lens + rng.normal(0, 0.1e-6, r.shape)
        ring_ux = radial_displacement(rings, c) + slid
        is_known = 0.1 < c / HERTZ_M < 0.97
        stick_m = float(c + rng.normal(0, 2e-5)) if is_known else np.nan
        noise = np.full(r.shape, 0.01, np.float32)
        snapshots.append(
            Snapshot(
                frame,
                125 * frame,
                Conditions(Phase.DRIVE, float(time), P_N, float(force), float(travel)),
                motion=FrameMotion(lens, float(slid)),
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
