"""Results of several loads in closed form, without any code of the analysis: Cattaneo and Mindlin's
contact under a stage, then sliding; slip and traction over that of sliding by the exponential law.
"""

from __future__ import annotations

import numpy as np

from app.records.record_types import ContactResult
from app.records.snapshot_numbers import ROW
from app.records.study_results import (
    BoxNoise,
    BoxSearch,
    Instants,
    Joint,
    LawSeries,
    Origin,
    Pictures,
    RingSeries,
    RunResult,
    StudyResults,
)
from app.records.summary import Summary
from app.settings.config import load, to_toml

NU, R, MU, LENGTH = 0.5, 128.8e-3, 0.93, 0.8e-6
K_T, COMPLIANCE, VELOCITY, PIXEL = 9579.0, 0.68e-6, 4.8e-6, 7.04e-6
STATED_E = 3.43e6  # of the settings
PITCH = 10 * PIXEL
LOADS = (0.1, 0.3, 0.7)
INPUTS = ("pixel size", "shear force")
QUANTITIES = ("young_modulus", "law_length", "mu_s", "agreement")
BUDGET = (-0.0099, 0.0066, 0.0, -0.011, 0.004, -0.0052, 0.004, 0.004)


def hertz_radius(P: float, E: float) -> float:
    return (3 * P * R * (1 - NU**2) / (4 * E)) ** (1 / 3)


def potential(r: np.ndarray, a: float) -> np.ndarray:
    """Azimuthal mean of the displacement under sqrt(1 - r^2/a^2), times 2 pi G/(1 - nu/2)."""
    far = np.maximum(r, a)
    beyond = np.pi / (2 * a) * (
        (2 * a**2 - far**2) * np.arcsin(a / far) + a * np.sqrt(far**2 - a**2)
    )  # fmt: skip
    return np.where(r <= a, np.pi**2 * (2 * a**2 - r**2) / (4 * a), beyond)


def elastic(r: np.ndarray, c: float, P: float, E: float) -> np.ndarray:
    """Displacement of the surface against the block far away, stuck inside the radius c."""
    a = hertz_radius(P, E)
    scale = MU * 3 * P / (2 * np.pi * a**2) * (1 - NU / 2) * (1 + NU) / (np.pi * E)
    inner = c / a * potential(r, c) if c > 0 else 0.0
    return scale * (potential(r, a) - inner)


def traction(r: np.ndarray, c: float, P: float, E: float) -> np.ndarray:
    a = hertz_radius(P, E)
    outer = np.sqrt(np.maximum(1 - r**2 / a**2, 0))
    inner = c / a * np.sqrt(np.maximum(1 - r**2 / c**2, 0)) if c > 0 else 0.0
    return MU * 3 * P / (2 * np.pi * a**2) * (outer - inner)


def run_of(P: float, E: float = STATED_E, *, slides: bool = True) -> RunResult:
    """The results of one load on a block of modulus E, which the settings give as `STATED_E`."""
    a, G = hertz_radius(P, E), E / (2 * (1 + NU))
    full = 3 * MU * P * (2 - NU) / (16 * G * a)
    soft = 1 / K_T + COMPLIANCE
    onset = (full + MU * P * soft) / VELOCITY
    times = np.linspace(0.05, 1.6 if slides else 0.8, 81) * onset
    share = np.linspace(0, 1, 200001)  # of mu P
    reached = full * (1 - (1 - share) ** (2 / 3)) + MU * P * share * soft
    r = PITCH * (np.arange(50) + 0.5)
    inside = r < 1.3 * a
    frames = np.zeros(len(times) + 1, ROW)
    for name in ROW.names or ():
        if ROW[name].kind == "f":
            frames[name] = np.nan
    frames["phase"] = "drive"
    frames["phase"][0] = "reference"
    frames["frame"] = np.arange(len(frames))
    shape = (len(frames), len(r))
    ux, stress = np.full(shape, np.nan), np.full((len(frames), inside.sum()), np.nan)
    slip, ratio = (np.full((len(frames), inside.sum()), np.nan) for _ in range(2))
    sticks = np.zeros(len(frames))
    for i, time in enumerate(times, 1):
        travel = VELOCITY * time
        part = float(np.interp(travel, reached, share))
        Q, c = part * MU * P, a * (1 - part) ** (1 / 3)
        shift = full * (1 - (1 - part) ** (2 / 3))
        slid = max(0.0, travel - VELOCITY * onset)
        sticks[i] = c
        ux[i] = shift - elastic(r, c, P, E) + slid
        stress[i] = traction(r[inside], c, P, E) * STATED_E / E
        if time < onset:
            slip[i] = 3 * MU * LENGTH * i / len(times) * (1 + r[inside] / a)
            ratio[i] = 1 - np.exp(-slip[i] / (MU * LENGTH))
        known = {
            "time_s": time, "normal_force_n": P, "shear_force_n": Q, "travel_m": travel,
            "lens_m": COMPLIANCE * Q, "centre_ux_m": slid, "block_m": shift + slid,
            "stress_force_n": Q * STATED_E / E, "stress_force_sd_n": 1e-4,
        }  # fmt: skip
        if 0.1 < c / a < 0.97:
            known |= {"peak_radius_m": c, "peak_radius_sd_m": 1e-5}
        for name, value in known.items():
            frames[name][i] = value
    p = 3 * P / (2 * np.pi * a**2) * np.sqrt(np.maximum(1 - r[inside] ** 2 / a**2, 0))
    nan = float("nan")
    stated = hertz_radius(P, STATED_E)
    summary = Summary(
        P, stated + 2.77e-4, 3e-5, stated, onset, 0.01, 0.99 * MU * P, 0.99 * MU, 0.002, MU,
        (MU - 0.006, MU + 0.008), VELOCITY, ("a note",),
        law_mu=MU, law_mu_sd=0.001, law_length_m=LENGTH, law_length_sd_m=0.01e-6,
        young_modulus_pa=E, young_modulus_sd_pa=0.004 * E, calibration_sd=0.0077,
        static_force_sd_n=2e-4, mu_d_sd=1e-3, law_chi2=1.1,
        pressure_radius_m=tuple(r[inside]), pressure_pa=tuple(p),
        pressure_sd_pa=tuple(np.full(len(p), 100.0)),
        interface_stiffness_pa_m=tuple(p / LENGTH),
        interface_stiffness_sd_pa_m=tuple(np.full(len(p), 1e8)),
        precursor_slip_m=tuple(np.full(len(p), 1.5e-6)),
        budget_inputs=INPUTS, budget_quantities=QUANTITIES, budget=BUDGET,
    ) if slides else Summary(
        P, stated + 2.77e-4, 3e-5, stated, nan, nan, nan, nan, nan, nan, (nan, nan), nan,
        ("it did not slide",),
    )  # fmt: skip
    settings = [
        f"run.normal_force={P:g}",
        f"sim.seed={round(1000 * P)}",
        "camera.width=320",
        "camera.height=240",
    ]
    x, y = (PITCH * np.arange(-n, n + 1.0) for n in (15, 11))
    away = np.hypot(*np.meshgrid(x, y))
    chosen = np.array([12, 24, 36, 48, 60, 81])
    waves = np.add.outer(np.arange(240.0), np.arange(320.0))
    grey = (60 + 40 * np.sin(waves / 2.3) * np.cos(waves.T[0] / 1.7)[:, None]).astype(np.uint8)
    bright = grey.copy()
    bright[115:125, 155:165] += 80
    return RunResult(
        origin=Origin(
            f"load-{P:g}.h5",
            "2026-11-23T12:00:00+00:00",
            "done",
            "the drive is complete",
            to_toml(load(None, settings)),
            sample="PDMS <7>",
            note="a | b",
        ),
        summary=summary,
        contact=ContactResult(
            (159.5, 119.5),
            summary.apparent_radius_m,
            3e-5,
            (0.0, 0.0),
            np.arange(1.0, 500.0, 5.0),
            np.where(np.arange(1.0, 500.0, 5.0) * PIXEL < summary.apparent_radius_m, 5.0, 0.0),
        ),
        pictures=Pictures(bright, grey, PIXEL),
        frames=frames,
        rings=RingSeries(
            np.where(frames["frame"][:, None] > 0, r, np.nan),
            ux,
            np.full(shape, 1e-8),
            np.where(frames["frame"][:, None] > 0, r[inside], np.nan),
            stress,
            np.full(stress.shape, 50.0),
        ),
        law=LawSeries(slip, ratio),
        instants=Instants(
            chosen,
            x,
            y,
            *(
                np.stack([one(i) for i in chosen]).astype(np.float32)
                for one in (
                    lambda i: np.interp(away, r, ux[i]),
                    lambda i: 1e-6 * np.sign(np.outer(y, x)) * i / 81,
                    lambda i: np.interp(away, r[inside], stress[i], right=0) * E / STATED_E,
                )
            ),
        ),
        noise=BoxNoise(
            np.array([10.0, 20.0, 40.0]),
            np.array([0.012, 0.006, 0.003]),
            np.array([0.011, 0.0055, 0.0027]),
            np.array([0.020, 0.009, 0.004]),
        ),
        search=searched(bright, P),
    )


def searched(picture: np.ndarray, P: float) -> BoxSearch:
    """A box of 20 px that has gone to the right by more than up; the later picture is one of the
    place to which it went.
    """
    ux, uy = 3.3 + P, -1.2
    tau = np.arange(-16.0, 17.0)
    c = np.exp(-((tau - ux) ** 2 + (tau[:, None] - uy) ** 2) / 20)
    later = np.roll(picture, (-1, 4), axis=(0, 1))
    cut = slice(86, 154), slice(126, 194)
    return BoxSearch(60, 20, 150, 110, 126, 86, picture[cut], later[cut], tau, tau, c, ux, uy)


def campaign(E: float = STATED_E) -> StudyResults:
    """Three loads on one block."""
    joint = Joint(
        E, 0.001 * E, LENGTH, 0.005e-6, MU, 0.001, 0.0, 0.001, LENGTH, 0.02e-6,
        roughness_length_m=1.5 * 0.595e-6, roughness_length_sd_m=0.2e-6,
    )  # fmt: skip
    runs = tuple(run_of(P, E) for P in reversed(LOADS))
    return StudyResults(
        runs=runs, joint=joint, made_with={"slipscope": "0.1.0", "preset": "finest"}
    )
