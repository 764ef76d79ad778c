"""The simulated loading experiment against what the simulated world knows: accuracy, losses, cost.

    python benchmarks/loading_experiment.py [--pace 1|max] [--set key=value]...

Prints, for each number that the project promises, what was measured, with machine and date. The world's truth is read after the run; the
analysis never sees it.
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

from app import config as settings
from app import live
from app.results import Phase
from app.session.reader import SessionReader


def main() -> None:
    """Run, compare, print."""
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--pace", default="1")
    ask.add_argument("--set", action="append", default=[])
    ask.add_argument("--keep", type=Path, help="keep the session here")
    asked = ask.parse_args()
    config = settings.load(None, asked.set)
    pace = None if asked.pace == "max" else float(asked.pace)
    live.prepare(lambda what, share: None)
    with tempfile.TemporaryDirectory() as folder:
        path = asked.keep or Path(folder) / "session.h5"
        bench = live.make_bench(config, pace)
        run = live.make_run(config, path, pace=pace, overwrite=True, bench=bench)
        run.start()
        outcome = run.wait()
        assert outcome is not None
        print(
            f"{platform.processor() or platform.machine()}, {platform.system()}, {datetime.date.today()}, pace {asked.pace}, {' '.join(asked.set)}"
        )
        print(f"{outcome.state}: {outcome.reason}")
        print(outcome.counts)
        print(outcome.resources)
        compare(path, bench.world, config)


def compare(path: Path, world, config: settings.Config) -> None:
    """Print the session's results beside the truth of the world it came from."""
    half = settings.exposure_samples(config) // 2
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
        inside = np.hypot(x + ux - centre[0], y + uy - centre[1]) < state.apparent_radius_m * 1e6 / pixel_um
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
    mu = config.sim.friction
    force = last.state.normal_force_n
    print(
        f"u_x over the contact: rms error {np.sqrt(squares / count):.4f} px = {np.sqrt(squares / count) * pixel_um * 1e3:.0f} nm (0.033 px asked);"
        f" worst frame {worst:.4f} px; {lost} of {total} points lost"
    )
    share, error, sd = np.array(stick).T
    asked_range = (share >= 0.3) & (share <= 0.9)
    print(
        f"c / a_H, c/a from 0.3 to 0.9: bias {error[asked_range].mean():+.4f}, scatter {error[asked_range].std():.4f},"
        f" worst {np.abs(error[asked_range]).max():.4f} (0.05 asked), stated sd {np.median(sd[asked_range]):.4f}; {asked_range.sum()} frames"
    )
    a_um, true_um = contact.apparent_radius_m * 1e6, world.truth(reference).state.apparent_radius_m * 1e6
    print(
        f"apparent radius: {a_um:.1f} +- {contact.apparent_radius_sd_m * 1e6:.1f} um, truth {true_um:.1f} um: {a_um - true_um:+.1f} um (45 asked)"
    )
    centre = np.array(world.truth(reference).state.lens_centre_m) / config.camera.pixel * 1e6
    print(f"centre: {contact.centre_px[0] - centre[0]:+.2f}, {contact.centre_px[1] - centre[1]:+.2f} px from the truth")
    print(
        f"Q_s: {summary.static_force_n:.5f} N, truth {mu * force:.5f}: {100 * (summary.static_force_n / (mu * force) - 1):+.2f} % (2 asked)"
    )
    print(f"mu_s: {summary.mu_s:.5f} +- {summary.mu_s_sd:.5f}, truth {mu}: {100 * (summary.mu_s / mu - 1):+.2f} % (2 asked)")
    print(f"mu_d: {summary.mu_d:.5f} in {summary.mu_d_range}, truth {mu}: {100 * (summary.mu_d / mu - 1):+.2f} %")
    drive = next(s for s in snapshots if s.phase is Phase.DRIVE)
    onset = (
        last.onset_sample - (drive.sample + config.camera.exposure / 2 - drive.time_s * config.forces.sample_rate)
    ) / config.forces.sample_rate
    print(f"t_s: {summary.onset_time_s:.3f} +- {summary.onset_time_sd_s:.3f} s, truth {onset:.3f} s")


def grid(config: settings.Config):
    """Box centres (x, y) of the run's DIC grid, px."""
    from analysis.dic import Grid

    cover = Grid.cover((config.camera.height, config.camera.width), config.dic.box, config.dic.step)
    return cover.x_px, cover.y_px


if __name__ == "__main__":
    main()
