"""Settings, sessions, journals, imports and field files damaged at random. A case must end in a
result or in a refusal with a sentence (UserError, ConfigError); any other exception, a process that
dies, more than 10 s or more than 1 GiB of memory is a failure. The cases run one by one in worker
processes, so that none can take the count down with it.

    python -m benchmarks fuzz [CASES] [SEED] [--keep FOLDER]

A failure is named by its seed; --keep FOLDER keeps its files. Linux and macOS.
"""

from __future__ import annotations

import json
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

import cv2
import numpy as np
import typer

from benchmarks.report import ROOT, Report

sys.path += [str(ROOT / "tests"), str(ROOT / "tests/session")]

from session_material import CONTACT, OUTCOME, copy_recording, record
from spoiled import ask, spoil
from spoiled_inputs import spoil_journal, spoil_table
from spoiled_settings import VALUES, spoil_settings

from analysis.options import options
from app.commands.inspect import info
from app.config import ConfigError, from_record, load, tables
from app.errors import UserError
from app.exchange.frames import Sources
from app.exchange.importing import import_files
from app.session.fields import FieldsWriter, is_session, read_fields_file
from app.session.repair import repair

SUBJECT = "Damaged input"
KEYS = [f"{table}.{key}" for table, kind in tables().items() for key in options(kind)]
LIMIT_S, LIMIT_BYTES = 10.0, 1 << 30
SHAPE = (64, 80)  # of the images that are imported
WORKER = "import sys, pathlib, benchmarks.fuzz; benchmarks.fuzz.work(pathlib.Path(sys.argv[1]))"
Case = tuple[str, Callable[[], object]]  # its kind, and what is done


def settings_case(folder: Path, seed: int) -> Case:
    """Settings from a file, from the command line, or from a session."""
    rng = random.Random(seed)
    content = spoil_settings(rng)
    path = folder / "case/bench.toml"
    path.write_bytes(content)
    text = content.decode("utf-8", "replace")
    override = f"{rng.choice(KEYS)}={rng.choice(VALUES)}"
    overrides = [override, *text.splitlines()[: rng.randint(0, 2)]]
    ways: dict[str, Callable[[], object]] = {
        "settings file": lambda: load(path),
        "settings --set": lambda: load(None, overrides),
        "settings of a session": lambda: from_record(text, "session"),
    }
    way = rng.choice(list(ways))
    return way, ways[way]


def session_case(folder: Path, seed: int) -> Case:
    """A session: everything in it is read, and `slipscope info --verify` shows it."""
    path = folder / "case/session.h5"
    how = spoil(folder / "whole.h5", path, seed)
    return f"session, {how}", lambda: (
        ask(path),
        info(path, as_json=True),
        info(path, as_json=False, verify=True),
    )


def repair_case(folder: Path, seed: int) -> Case:
    """The repair of a session, cut short with its journal or damaged without one; everything in the
    repaired session is read.
    """
    path, output = folder / "case/cut.h5", folder / "case/repaired.h5"
    if random.Random(seed).random() < 0.3:
        how = "repair without journal, " + spoil(folder / "whole.h5", path, seed)
    else:
        how = "repair by journal, " + spoil_journal(folder / "cut.h5", path, seed)
    return how, lambda: repair(path, output).output and ask(output)


def import_case(folder: Path, seed: int) -> Case:
    """An import of images with tables of metadata and forces."""
    rng = random.Random(seed)
    images, which = (
        folder / "case/images",
        rng.choice(["metadata", "forces", "metadata and forces"]),
    )
    shutil.copytree(folder / "images", images)
    for name in ("metadata", "forces"):
        if name in which:
            table = images / f"{name}.csv"
            table.write_bytes(spoil_table(table.read_bytes(), rng))
    sources = Sources(
        images=[images],
        pixel_um=7.04,
        rate_hz=rng.choice([1000, 1000, 1000, 100, 100_000]),
        divisor=rng.choice([None, 125]),
        reference=rng.choice([None, None, 1]),
        drive=rng.choice([None, 3]),
        overrides=("dic.box=20", "dic.step=10"),
    )
    return f"import, {which}", lambda: import_files(sources, folder / "case/imported.h5")


def fields_case(folder: Path, seed: int) -> Case:
    """A file of displacement fields, as `slipscope invert` reads it."""
    path = folder / "case/fields.h5"
    how = spoil(folder / "whole-fields.h5", path, seed)
    return f"fields, {how}", lambda: (is_session(path), read_fields_file(path))


CASES = (session_case, settings_case, repair_case) * 2 + (session_case, fields_case, import_case)


def make_whole(folder: Path) -> None:
    """Write what the cases damage: a session, one cut short, fields, images and tables to
    import.
    """
    writer, _ = record(folder / "whole.h5")
    writer.append(CONTACT)
    copy_recording(folder / "whole.h5", folder / "cut.h5")
    writer.append(OUTCOME)
    writer.close()
    (folder / "images").mkdir(exist_ok=True)
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, SHAPE, np.uint8), (0, 0), 1.5)
    rows = ["sample,phase,stage_um,file"]
    for n, phase in enumerate(["background", "reference", "drive", "drive", "drive", "end"]):
        cv2.imwrite(str(folder / f"images/{n}.png"), np.roll(image, n, axis=1))
        rows.append(f"{125 * n},{phase},{2.5 * n},{n}.png")
    (folder / "images/metadata.csv").write_text("\n".join(rows), encoding="utf-8")
    forces = [f"{n},{n / 1000},{0.03},{max(0.0, n - 250) * 1e-4}" for n in range(800)]
    text = "\n".join(["sample,time_s,P_N,Q_N", *forces])
    (folder / "images/forces.csv").write_text(text, encoding="utf-8")
    axis = np.arange(4.0)
    settings, units = {"reference": "r.tif", "box": 20}, {"box": "px"}
    fields = folder / "whole-fields.h5"
    FieldsWriter(fields, ["a.tif"], axis, axis, ["ok"], settings, units).close()


def work(folder: Path) -> None:
    """Run the cases whose seeds come on standard input; for each, a line of its kind and one of its
    outcome, traceback and peak memory.
    """
    # a case may ask for too much memory, but must not take the machine down
    resource.setrlimit(resource.RLIMIT_DATA, (4 * LIMIT_BYTES, resource.RLIM_INFINITY))
    answers, sys.stdout = sys.stdout, (folder / "output").open("w")
    make_whole(folder)
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        seed, outcome, thrown = int(line), "result", ""
        shutil.rmtree(folder / "case", ignore_errors=True)
        (folder / "case").mkdir()
        kind, case = CASES[seed % len(CASES)](folder, seed)
        print(kind, file=answers, flush=True)
        try:
            case()
        except (UserError, ConfigError) as error:
            outcome = "refused" if str(error) else "refused without a sentence"
        except (Exception, typer.Exit):
            outcome, thrown = "other exception", traceback.format_exc(limit=-2)[-1500:]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        peak *= 1 if sys.platform == "darwin" else 1024
        if peak > LIMIT_BYTES:
            outcome = "too much memory"
        print(json.dumps((outcome, thrown, peak)), file=answers, flush=True)


@dataclass(frozen=True, slots=True)
class Ended:
    """How one case ended."""

    seed: int
    kind: str
    outcome: str
    thrown: str
    peak: int  # bytes, the largest of its worker until then
    seconds: float

    @property
    def is_failure(self) -> bool:
        """Whether there was neither a result nor a refusal."""
        return self.outcome not in {"result", "refused"}


class Worker:
    """A process that runs cases in a folder of its own, and is replaced after each failure."""

    def __init__(self, folder: Path, keep: Path | None) -> None:
        self._folder, self._keep = folder, keep
        self._start()

    def _start(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        self._folder.mkdir()
        command = [sys.executable, "-c", WORKER, str(self._folder)]
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=nothing, text=True, cwd=ROOT
        )
        assert self._process.stdin
        assert self._process.stdout
        self._questions, self._answers = self._process.stdin, self._process.stdout
        self._answers.readline()  # ready

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.communicate()

    def case(self, seed: int) -> Ended:
        """Run a case; the process is killed if it takes too long."""
        clock, began = threading.Timer(LIMIT_S, self._process.kill), time.monotonic()
        clock.start()
        print(seed, file=self._questions, flush=True)
        kind, answer = self._answers.readline().strip(), self._answers.readline()
        clock.cancel()
        seconds = time.monotonic() - began
        how = f"killed after {LIMIT_S:g} s" if seconds >= LIMIT_S else "process died"
        outcome = json.loads(answer) if answer.endswith("\n") else (how, "", 0)
        ended = Ended(seed, kind, *outcome, seconds)
        if ended.is_failure:
            self.end()
            if self._keep:
                shutil.copytree(self._folder / "case", self._keep / str(seed))
            self._start()
        return ended


def run_all(seeds: range, workers: int, keep: Path | None) -> list[Ended]:
    """How all cases ended, run by several workers."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as threads:
        made = [Worker(Path(folder) / str(n), keep) for n in range(workers)]
        free: SimpleQueue[Worker] = SimpleQueue()
        for worker in made:
            free.put(worker)

        def case(seed: int) -> Ended:
            worker = free.get()
            try:
                return worker.case(seed)
            finally:
                free.put(worker)

        done = list(threads.map(case, seeds))
        for worker in made:
            worker.end()
    return done


def measure(
    report: Report,
    cases: int = 10_000,
    seed: int = 0,
    *,
    workers: int = 2,
    keep: Path | None = None,
) -> int:
    """Run the cases and count how they ended; 1 if one failed."""
    done = run_all(range(seed, seed + cases), workers, keep)
    failures = [case for case in done if case.is_failure]
    for case in failures[:20]:
        print(f"\nseed {case.seed}: {case.kind}: {case.outcome}\n{case.thrown}")
    report.add("cases", len(done))
    report.add("failures", len(failures), at_most=0)
    report.add("slowest case", max(case.seconds for case in done), "s", at_most=LIMIT_S)
    report.add("largest memory", max(case.peak for case in done) >> 20, "MiB", at_most=1024)
    report.table("Cases by kind")
    kinds = Counter((case.kind.partition(",")[0], case.outcome) for case in done)
    for (kind, outcome), number in sorted(kinds.items()):
        report.add(kind, number, column=outcome)
    return int(bool(failures))
