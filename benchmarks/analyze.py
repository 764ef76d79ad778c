"""Six loads of a rough contact whose constants are not those of the settings, analysed together by
`slipscope analyze`: what it costs, and how far each result is from the truth of the world.

    python -m benchmarks analyze [--loads 0.1 0.2 0.3 0.5 1.0 1.4] [--preset finest]
        [--keep FOLDER]

Sessions of full resolution take about 0.5 GB each. With --keep they stay in FOLDER and are taken
again, with what is true of them beside them in truth.json; the results are FOLDER/results.h5.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from app.records.summary import Summary
from app.session.results import read_results
from benchmarks import simulated
from benchmarks.report import Report
from slipscope import Session

SUBJECT = "Six loads analysed together"
MEASURES = ("analysis", "app.evaluation", "app.study", "drivers.sim")
ROUGH = ("sim.law=elasto-plastic", "sim.pressure=greenwood-tripp")
# of the world, and not of the settings: within what the settings say of their uncertainty
HIDDEN = (
    "sim.friction=0.912",
    "sim.slip_length=0.86",
    'sim.errors=["camera.pixel 1.003", "sample.young_modulus 1.03", "sample.lens_radius 0.998",'
    ' "sample.roughness 0.95", "sample.lens_compliance 1.03", "forces.stiffness_shear 1.001",'
    ' "forces.stiffness_normal 0.999"]',
)
SPEED, FRAMES, JOBS = 4.85, 250, 2  # um/s, of a session, and processes
INNER = 0.7  # of a_H: rings within tell k


def measure(
    report: Report,
    *,
    loads: Sequence[float] = (0.1, 0.2, 0.3, 0.5, 1.0, 1.4),
    preset: str = "finest",
    keep: Path | None = None,
) -> int:
    """Make the sessions, analyse and compare; 1 if anything failed."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(exist_ok=True)
        truths = made(folder, loads)
        sessions = [folder / name for name in truths]
        results = folder / "results.h5"
        code, wall_s, memory = analysed(sessions, results, preset)
        report.table("Costs")
        report.add("sessions", len(sessions))
        report.add("images", sum(t["images"] for t in truths.values()))
        report.add("time", wall_s, "s", 120.0)
        report.add("largest memory of all processes", memory / 2**20, "MiB", 1536.0)
        if code:
            return 1
        compare(report, results, truths)
        return 0


def made(folder: Path, loads: Sequence[float]) -> dict[str, dict[str, Any]]:
    """Session -> what is true of it; those that are in the folder already are not made again."""
    kept = folder / "truth.json"
    truths = json.loads(kept.read_text()) if kept.exists() else {}
    wanted = [f"load-{P:g}.h5" for P in loads]
    for P, name in zip(loads, wanted, strict=True):
        if name in truths and (folder / name).exists():
            continue
        onset_um = 50 * (P / 0.5) + 50 * (P / 0.5) ** (2 / 3)
        travel_um = 1.7 * onset_um + 15
        divisor = max(42, round(1e3 * travel_um / SPEED / (FRAMES - 15)))
        settings = (
            *ROUGH,
            *HIDDEN,
            f"run.normal_force={P:g}",
            f"run.travel={travel_um:.0f}",
            f"camera.divisor={divisor}",
            "run.background_time=1",
            "recording.results=forces",
        )
        experiment = simulated.experiment(folder / name, settings, pace=None)
        outcome = experiment.outcome()
        if outcome.state != "done":
            raise SystemExit(f"{name}: {outcome.reason}")
        truths[name] = truth_of(experiment, folder / name)
        kept.write_text(json.dumps(truths, indent=1))
    return {name: truths[name] for name in wanted}


def truth_of(experiment: simulated.Experiment, path: Path) -> dict[str, Any]:
    """What an analysis of the session should give, SI units."""
    world = experiment.bench.world
    with Session(path) as session:
        phase = session.results["phase"]
        first = session.results["sample"][phase == "reference"][0]
        last = int(session.results["sample"][-1])
        images = len(session.frames.received)
    truth = world.truth(last)
    at_rest = world.state(simulated.middle_of_exposure(world, int(first)))
    r = np.linspace(0, 1.2 * at_rest.apparent_radius_m, 121)
    known = world.scenario
    return {
        "images": images,
        "normal_force": truth.state.normal_force_n,
        "mu": truth.state.friction,
        "mu_s": truth.mu_s,
        "apparent_radius": at_rest.apparent_radius_m,
        "hertz_radius": at_rest.hertz_radius_m,
        "length": known.sim.slip_length,
        "young_modulus": known.sample.young_modulus,
        "radius": r.tolist(),
        "pressure": truth.state.pressure(r).tolist(),
    }


def analysed(sessions: Sequence[Path], results: Path, preset: str) -> tuple[int, float, int]:
    """Exit code of the command, its seconds, and the most bytes of all its processes."""
    began = time.monotonic()
    words = "analyze", *sessions, "-o", results, "--jobs", JOBS, "--preset", preset, "--overwrite"
    process = psutil.Popen([sys.executable, "-m", "app", *map(str, words)], stdout=subprocess.PIPE)
    largest = 0
    while process.poll() is None:
        largest = max(largest, memory_of(process))
        time.sleep(0.1)
    print(process.stdout.read().decode())
    return process.returncode, time.monotonic() - began, largest


def memory_of(process: psutil.Process) -> int:
    """Bytes that a process and its children have, what they share counted once for each."""
    total = 0
    try:
        for one in (process, *process.children(recursive=True)):
            total += one.memory_info().rss
    except psutil.Error:
        return 0  # one of them has just ended
    return total


def compare(report: Report, results: Path, truths: dict[str, dict[str, Any]]) -> None:
    """The results of each load and of all together against the truth."""
    found, moduli = read_results(results), []
    for run in found.runs:
        s, true = run.summary, truths[run.origin.session]
        report.table(f"{s.normal_force_n:.2g} N")
        for name, value, right, unit, at_most in (
            ("apparent radius a", s.apparent_radius_m, true["apparent_radius"], "um", 40),
            ("Q_s", s.static_force_n, true["mu_s"] * true["normal_force"], "%", 0.5),
            ("mu_s", s.mu_s, true["mu_s"], "%", 0.5),
            ("mu_d", s.mu_d, true["mu"], "%", None),
            ("mu of the local law", s.law_mu, true["mu"], "%", 1),
            ("L of the local law", s.law_length_m, true["length"], "%", 5),
            ("E", s.young_modulus_pa, true["young_modulus"], "%", None),
            ("k, median over the rings", stiffness_ratio(s, true), 1.0, "%", 5),
        ):
            error = 1e6 * (value - right) if unit == "um" else 100 * (value / right - 1)
            report.row(name, digits=2, error=(error, unit, at_most))
        moduli.append(s.young_modulus_pa)
    joint, true = found.joint, next(iter(truths.values()))
    flat = 100 * (np.array(moduli) / np.mean(moduli) - 1)
    report.table("All loads together")
    report.row("E(P) off its mean", digits=2, error=(np.abs(flat).max(), "%", 1))
    for name, value, sd, right, at_most in (
        ("E", joint.young_modulus_pa, joint.young_modulus_sd_pa, true["young_modulus"], 2),
        ("mu at 1 N", joint.mu, joint.mu_sd, true["mu"], 1),
        ("L", joint.length_m, joint.length_sd_m, true["length"], 5),
        ("L as p/k", joint.stiffness_length_m, joint.stiffness_length_sd_m, true["length"], 5),
    ):
        report.row(name, digits=2, error=(100 * (value / right - 1), "%", at_most))
        report.row(name, digits=2, stated=(100 * sd / value, "%"))
    for note in (note for run in found.runs for note in run.summary.notes):
        if not note.startswith(("onset: line", "local law: ")) or "does not" in note:
            print("note:", note)


def stiffness_ratio(s: Summary, true: dict[str, Any]) -> float:
    """Measured k over mu p/(mu L) of the world, the median over the inner rings."""
    r, k = (np.array(v) for v in (s.pressure_radius_m, s.interface_stiffness_pa_m))
    if len(k) != len(r):
        return math.nan
    right = np.interp(r, true["radius"], true["pressure"]) / true["length"]
    inner = (r < INNER * true["hertz_radius"]) & np.isfinite(k)
    return float(np.median(k[inner] / right[inner])) if inner.any() else math.nan
