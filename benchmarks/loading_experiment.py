"""The simulated loading experiment against what the simulated world knows: accuracy, losses, cost.

    python benchmarks/loading_experiment.py [--pace 1|max] [--set key=value]...

Prints, for each number that the project promises, what was measured, with machine and date. The
world's truth is read after the run; the analysis never sees it.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from analysis.dic import Grid
from app import config as settings
from app import live
from app.results import Phase
from app.session.reader import SessionReader


def main() -> None:
    """Run, compare, print."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("--pace", default="1")
    ask.add_argument("--set", action="append", default=[])
    ask.add_argument("--keep", type=Path, help="keep the session here")
    asked = ask.parse_args()
    config = settings.load(None, asked.set)
    pace = None if asked.pace == "max" else float(asked.pace)
    live.prepare(config, lambda what: None)
    with tempfile.TemporaryDirectory() as folder:
        path = asked.keep or Path(folder) / "session.h5"
        bench = live.make_bench(config, pace)
        run = live.make_run(config, path, pace=pace, overwrite=True, bench=bench)
        run.start()
        outcome = run.wait()
        assert outcome is not None
        print(
            f"{platform.machine()}, {platform.system()}, {datetime.date.today()}, pace"
            f" {asked.pace}, {' '.join(asked.set)}"
        )
        print(f"{outcome.state}: {outcome.reason}")
        print(outcome.counts)
        print(outcome.resources)
        compare(path, bench.world, config)


def compare(path: Path, world, config: settings.Config) -> None:
    """Print the session's results beside the truth of the world it came from."""
    half = config.exposure_samples // 2
    pixel_um = config.camera.pixel
    with SessionReader(path) as session:
        snapshots = list(session.snapshots())
        contact, summary = session.contact(), session.summary()
        reference = next(e for e in session.events() if e.kind == "reference").sample + half
    x, y = np.meshgrid(*grid(config))
    squares, count, worst, stick = 0.0, 0, 0.0, []
    lost = total = 0
    for snapshot in (s for s in snapshots if s.phase is Phase.DRIVE):
        truth = world.truth(snapshot.sample + half)
        ux, uy = truth.displacement_px(x, y, reference)
        state = truth.state
        centre = np.array(state.lens_centre_m) / config.camera.pixel * 1e6
        inside = (
            np.hypot(x + ux - centre[0], y + uy - centre[1])
            < state.apparent_radius_m * 1e6 / pixel_um
        )
        error = (snapshot.ux_px - ux)[inside]
        good = np.isfinite(error)
        lost, total = lost + int((~good).sum()), total + good.size
        squares, count = squares + float((error[good] ** 2).sum()), count + int(good.sum())
        worst = max(worst, float(np.sqrt(np.mean(error[good] ** 2))))
        share = state.stick_radius_m / state.hertz_radius_m
        if 0.2 <= share <= 0.95:
            stick.append(
                (
                    share,
                    (snapshot.stick_radius_m - state.stick_radius_m) / state.hertz_radius_m,
                    snapshot.stick_radius_sd_m / state.hertz_radius_m,
                )
            )
    last = world.truth(snapshots[-1].sample)
    mu = last.state.friction
    force = last.state.normal_force_n
    rms = np.sqrt(squares / count)
    row(
        "u_x over the contact, rms error",
        f"{rms:.4f} px = {rms * pixel_um * 1e3:.0f} nm",
        "0.033 px",
    )
    row("  worst frame; points lost", f"{worst:.4f} px; {lost} of {total}")
    share, error, sd = np.array(stick).T
    chosen = (share >= 0.3) & (share <= 0.9)
    row(
        "c, as a share of a_H, c/a 0.3 to 0.9",
        f"bias {error[chosen].mean():+.4f}, scatter {error[chosen].std():.4f}, worst"
        f" {np.abs(error[chosen]).max():.4f}",
        "0.05",
    )
    row("  stated sd (median); frames", f"{np.median(sd[chosen]):.4f}; {chosen.sum()}")
    at_rest = world.truth(reference).state
    a_um, true_um = contact.apparent_radius_m * 1e6, at_rest.apparent_radius_m * 1e6
    row(
        "apparent radius",
        f"{a_um:.1f} +- {contact.apparent_radius_sd_m * 1e6:.1f} um, truth {true_um:.1f} um:"
        f" {a_um - true_um:+.1f} um",
        "45 um",
    )
    dx, dy = (
        np.array(contact.centre_px) - np.array(at_rest.lens_centre_m) / config.camera.pixel * 1e6
    )
    row("  centre", f"{dx:+.2f}, {dy:+.2f} px from the truth")
    for name, found, true, asked in (
        ("Q_s (N)", summary.static_force_n, last.mu_s * force, "2 %"),
        ("mu_s", summary.mu_s, last.mu_s, "0.5 %"),
        ("mu_d", summary.mu_d, mu, ""),
    ):
        row(name, f"{found:.5f}, truth {true:.5f}: {100 * (found / true - 1):+.2f} %", asked)
    if last.onset_sample is None:
        row("t_s (s)", "the contact never slid; drive it further with --set run.travel=400")
        return
    traction(snapshots, world, half, reference)
    for name, found, sd, true, asked in (
        ("mu of the local law", summary.law_mu, summary.law_mu_sd, mu, "1 %"),
        (
            "L of the local law (um)",
            summary.law_length_m * 1e6,
            summary.law_length_sd_m * 1e6,
            config.sim.slip_length,
            "8 %",
        ),
        (
            "E (MPa)",
            summary.young_modulus_pa * 1e-6,
            summary.young_modulus_sd_pa * 1e-6,
            config.sample.young_modulus,
            "1.5 %",
        ),
    ):
        row(
            name,
            f"{found:.4f} +- {sd:.4f}, truth {true:.4f}: {100 * (found / true - 1):+.2f} %",
            asked,
        )
    drive = next(s for s in snapshots if s.phase is Phase.DRIVE)
    rate = config.forces.sample_rate
    onset = (
        last.onset_sample - (drive.sample + config.exposure_samples / 2 - drive.time_s * rate)
    ) / rate
    row(
        "t_s (s)", f"{summary.onset_time_s:.3f} +- {summary.onset_time_sd_s:.3f}, truth {onset:.3f}"
    )


def traction(snapshots, world, half: int, reference: int) -> None:
    """Print how far the inverted shear traction, its force and D are from the truth."""
    found = [s for s in snapshots if s.phase is Phase.DRIVE and s.stress_pa.size]
    if not found:
        return
    lines = []
    for snapshot in found:
        state, at_rest = world.state(snapshot.sample + half), world.state(reference)
        peak = 1.5 * state.friction * state.normal_force_n / np.pi / state.hertz_radius_m**2
        error = (snapshot.stress_pa - state.traction(snapshot.stress_radius_m)) / peak
        far = state.block_m - state.lens_m - at_rest.block_m + at_rest.lens_m
        lines.append(
            (
                state.shear_force_n / (state.friction * state.normal_force_n),
                np.sqrt(np.mean(error**2)),
                snapshot.stress_force_n / state.shear_force_n - 1,
                (snapshot.stress_force_n - state.shear_force_n) / snapshot.stress_force_sd_n,
                snapshot.block_m - far,
                snapshot.block_sd_m,
            )
        )
    share, profile, force, score, far, _ = np.array(lines).T
    for low, high in ((0.25, 0.35), (0.55, 0.65), (0.85, 0.95), (0.99, 1.1)):
        at = (share > low) & (share < high)
        if at.any():
            row(
                f"sigma(r) at Q/(mu P) {low:.2f} to {high:.2f}",
                f"rms error {np.sqrt(np.mean(profile[at] ** 2)):.4f} mu p0, integral/Q"
                f" {100 * force[at].mean():+.2f} %"
                f" (scatter {100 * force[at].std():.2f} %, {np.sqrt(np.mean(score[at] ** 2)):.1f}"
                f" sd), D {1e9 * far[at].mean():+.0f} nm",
                "0.014, 0.2 %, 50 nm",
            )


def row(what: str, found: str, asked: str = "") -> None:
    """Print one line: what was measured, and what was asked of it."""
    print(f"{what:38s} {found}" + (f"  ({asked} asked)" if asked else ""))


def grid(config: settings.Config):
    """Box centres (x, y) of the run's DIC grid, px."""
    cover = Grid.cover((config.camera.height, config.camera.width), config.dic.box, config.dic.step)
    return cover.x_px, cover.y_px


if __name__ == "__main__":
    main()
