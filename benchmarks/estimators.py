"""Bias, scatter, coverage and speed of the estimates of c, of the local law and of Young's modulus,
on displacements whose truth is known.

    python benchmarks/estimators.py [stick peak law speed] [--runs 40] [--loads 0.1 0.5 1.4]

stick   c by the live fit, Cattaneo and Mindlin's world: bias +- scatter in units of a for c/a from
0.2 to 0.95, share within 1 sd peak    c by the live fit and by the maximum of the inverted stress,
elasto-plastic world, corrected to the maximum of the true stress law     mu, L, E (fit of the
loading), mu, L (master curve) and E (balance of forces): bias +- scatter in per cent, coverage
speed   medians, milliseconds

Fields of 158 x 118 points, pitch 70.4 um, means over boxes of two pitches that share noise; force
noise 1 mN. The truth of the elasto-plastic world is that of tests/friction/elasto_plastic_world.py.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from friction import elasto_plastic_world as world  # noqa: E402

from analysis.contact.rings import Rings  # noqa: E402
from analysis.friction.local_law import displacement_in_rings, fit_local_law  # noqa: E402
from analysis.friction.master_curve import master_curve  # noqa: E402
from analysis.friction.modulus import balance_modulus  # noqa: E402
from analysis.friction.stick import fit_stick_radius  # noqa: E402
from analysis.friction.stress_peak import calibrate, stress_peak  # noqa: E402
from analysis.inversion.axisymmetric import AxisymmetricInversion  # noqa: E402
from analysis.mechanics import cattaneo_mindlin  # noqa: E402
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact  # noqa: E402

SHARES = (0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95)
NOISES = (50e-9, 232e-9)
FRAMES = 60


@cache
def inversion(P: float) -> AxisymmetricInversion:
    a = world.hertz_radius(P)
    mask = a + np.sqrt(world.R * 0.595e-6) + 2 * world.PITCH
    return AxisymmetricInversion(
        world.X, world.Y, world.PITCH, mask, world.E, world.NU, edge=a, box=world.BOX
    )


def live(rings: Rings, P: float) -> tuple[float, float]:
    fit = fit_stick_radius(
        rings.radius,
        rings.mean,
        rings.standard_error,
        world.hertz_radius(P),
        box=world.BOX,
        width=world.PITCH,
    )
    return fit.stick_radius, fit.stick_radius_sd


def peak(rings: Rings, P: float) -> tuple[float, float]:
    solved = inversion(P).solve(rings)
    found = stress_peak(
        solved.radius, solved.sigma, solved.covariance, reach=0.1 * world.hertz_radius(P)
    )
    return found.radius, found.radius_sd


def samples(clean: Rings, sd: float, shared: bool, runs: int) -> list[Rings]:
    mean, error = world.ring_noise(128, shared=shared)
    return [
        Rings(clean.radius, clean.mean + sd * m, sd * e, clean.count)
        for m, e in zip(mean[:runs], error, strict=False)
    ]


def line(name: str, errors: np.ndarray, stated: np.ndarray) -> None:
    """Bias and scatter of each column, coverage of all."""
    cells = " ".join(f"{np.nanmean(e):+.4f}+-{np.nanstd(e):.4f}" for e in errors)
    known = np.isfinite(errors)
    print(f"{name:42s} {cells}  {np.mean(np.abs(errors) < stated, where=known):.2f}", flush=True)


def stick(loads: list[float], runs: int) -> None:
    print(f"live c, Cattaneo-Mindlin   c/a = {SHARES}; share within 1 sd")
    for P in loads:
        a, clean = world.hertz_radius(P), []
        for share in SHARES:
            g = cattaneo_mindlin.radial_displacement(
                world.DENSE, world.MU * P * (1 - share**3), world.MU, P, a, world.E, world.NU
            )
            clean.append(world.State(P, 30e-6, 0.0, a, np.zeros_like, *g).rings())
        for sd in NOISES:
            for shared in (False, True):
                found = (
                    np.array(
                        [[live(ring, P) for ring in samples(c, sd, shared, runs)] for c in clean]
                    )
                    / a
                )
                errors = found[..., 0] - np.array(SHARES)[:, None]
                line(
                    f"{P} N, {sd * 1e9:.0f} nm, {'shared by boxes' if shared else 'white'}",
                    errors,
                    found[..., 1],
                )


def peaks(loads: list[float], runs: int) -> None:
    for P in loads:
        a, run = world.hertz_radius(P), world.drive(P, FRAMES)
        loading = AxisymmetricLoading(
            SphereContact(P, world.E, world.NU, world.R, world.MU, world.L)
        )
        states = [
            loading.at_force(world.MU * P * (1 - share**3)) for share in np.linspace(0.2, 0.99, 30)
        ]
        model = [
            displacement_in_rings(state, run.radius, world.BOX, world.PITCH) for state in states
        ]
        chosen = np.flatnonzero((run.peak > 0.25 * a) & (run.peak < 0.95 * a))[:: FRAMES // 12]
        truth = run.peak[chosen]
        print(f"c of the largest stress, {P} N   c/a = {np.round(truth / a, 2)}; share within 1 sd")
        for sd in NOISES:
            mean, error = world.ring_noise(128, shared=True)
            typical = sd * np.sqrt(np.mean(error**2, axis=0))
            for name, estimate in (("live", live), ("peak", peak)):

                def of(
                    u: np.ndarray, estimate: Callable = estimate, typical: np.ndarray = typical
                ) -> float:
                    return estimate(Rings(run.radius, u, typical, run.count), P)[0]  # noqa: B023

                calibration = calibrate(
                    of, model, [state.peak_radius for state in states], sd * mean[-30:]
                )
                plain = np.array([[of(run.ux[i] + sd * m) for m in mean[:runs]] for i in chosen])
                found = np.array([[calibration.corrected(v) for v in row] for row in plain])
                line(
                    f"{name}, {sd * 1e9:.0f} nm, as it is",
                    (plain - truth[:, None]) / a,
                    np.full(plain.shape, np.nan),
                )
                line(
                    f"{name}, {sd * 1e9:.0f} nm, corrected",
                    (found[..., 0] - truth[:, None]) / a,
                    found[..., 1] / a,
                )


def law(loads: list[float], runs: int) -> None:
    print(
        "per cent: fit mu, L, E | master curve mu, L | balance E: bias +- scatter, share within 1"
        " sd"
    )
    true = np.array([world.MU, world.L, world.E, world.MU, world.L, world.E])
    for P in loads:
        run, a = world.drive(P, FRAMES), world.hertz_radius(P)
        n = len(run.radius)
        for sd in NOISES:
            rows = []
            for seed in range(runs):
                ux, error, Q = run.measured(sd, seed)
                fit = fit_local_law(
                    run.radius,
                    ux,
                    error,
                    P,
                    Q,
                    E=1.1 * world.E,
                    nu=world.NU,
                    R=world.R,
                    box=world.BOX,
                    width=world.PITCH,
                )
                solved = [
                    inversion(P).solve(Rings(run.radius, u, e, run.count))
                    for u, e in zip(ux, error, strict=True)
                ]
                sigma, sigma_sd = (
                    np.array([getattr(s, name)[:n] for s in solved])
                    for name in ("sigma", "sigma_sd")
                )
                curve = master_curve(run.radius, ux, error, sigma, sigma_sd, P, a)
                balance = balance_modulus(
                    [s.Q for s in solved], [s.Q_sd for s in solved], Q, world.E
                )
                rows.append(
                    [
                        (fit.mu, fit.L, fit.E, curve.mu, curve.L, balance.E),
                        (fit.mu_sd, fit.L_sd, fit.E_sd, curve.mu_sd, curve.L_sd, balance.E_sd),
                    ]
                )
            values, stated = np.moveaxis(np.array(rows), 1, 0)
            error = 100 * (values / true - 1)
            within = (np.abs(error) < 100 * stated / true).mean(axis=0)
            cells = "  ".join(
                f"{e.mean():+.3f}+-{e.std():.3f} ({w:.2f})"
                for e, w in zip(error.T, within, strict=True)
            )
            print(f"{P} N, {sd * 1e9:.0f} nm: {cells}", flush=True)


def speed(*_: object) -> None:
    P = 0.5
    run = world.drive(P, FRAMES)
    ux, error, Q = run.measured(50e-9, 0)
    rings, a = Rings(run.radius, ux[20], error[20], run.count), world.hertz_radius(P)
    solved = inversion(P).solve(rings)
    tasks: dict[str, tuple[int, Callable[[], object]]] = {
        "live c": (300, lambda: live(rings, P)),
        "maximum of the stress": (
            300,
            lambda: stress_peak(solved.radius, solved.sigma, solved.covariance, reach=0.1 * a),
        ),
        f"local law, {FRAMES} frames": (
            3,
            lambda: fit_local_law(
                run.radius,
                ux,
                error,
                P,
                Q,
                E=3e6,
                nu=world.NU,
                R=world.R,
                box=world.BOX,
                width=world.PITCH,
            ),
        ),
    }
    for name, (times, task) in tasks.items():
        spent = []
        for _ in range(times):
            start = time.perf_counter()
            task()
            spent.append(time.perf_counter() - start)
        print(f"{name:28s} {1e3 * np.median(spent):10.3f} ms")


def main() -> None:
    sections = {"stick": stick, "peak": peaks, "law": law, "speed": speed}
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sections", nargs="*", choices=[[], *sections])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--loads", type=float, nargs="+", default=[0.1, 0.5, 1.4])
    asked = parser.parse_args()
    for name in asked.sections or sections:
        sections[name](asked.loads, asked.runs)


if __name__ == "__main__":
    main()
