"""Settings, sessions, journals and imports spoiled at random: ``python benchmarks/fuzz.py [CASES]
[SEED]`` prints what became of each kind.

A case must end as read, or refused with a sentence (UserError, ConfigError). Whatever else is a
failure: another exception, a process that died, more than `LIMIT_S` seconds, more than
`LIMIT_BYTES` of memory. Each is named by its seed; ``--keep FOLDER`` keeps its files. The cases run
one by one in worker processes, so that none can take the count down with it. Linux and macOS.
"""

from __future__ import annotations

import argparse
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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/session"))

import cv2
import numpy as np
import typer
from session_material import CONTACT, OUTCOME, record
from spoiled import ask, spoil
from spoiled_inputs import spoil_journal, spoil_table
from spoiled_settings import VALUES, spoil_settings

from app.commands.inspect import info
from app.config import ConfigError, from_record, load, values_of
from app.errors import UserError
from app.exchange.frames import Sources
from app.exchange.importing import import_files
from app.session.fields import FieldsWriter, is_session, read_fields_file
from app.session.journal import journal_of
from app.session.repair import repair
from app.settings import Config

KEYS = [f"{table}.{key}" for table, values in values_of(Config()).items() for key in values]
LIMIT_S, LIMIT_BYTES = 10.0, 1 << 30
SHAPE = (64, 80)  # of the images that are imported


def settings_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """Settings from a file, from the command line, or from a session."""
    rng = random.Random(seed)
    content = spoil_settings(rng)
    path = folder / "case/bench.toml"
    path.write_bytes(content)
    text = content.decode("utf-8", "replace")
    ways: dict[str, Callable[[], object]] = {
        "settings file": lambda: load(path),
        "settings --set": lambda: load(
            None,
            [f"{rng.choice(KEYS)}={rng.choice(VALUES)}", *text.splitlines()[: rng.randint(0, 2)]],
        ),
        "settings of a session": lambda: from_record(text, "session"),
    }
    way = rng.choice(list(ways))
    return way, ways[way]


def session_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """A session, asked everything and shown by `slipscope info --verify`."""
    path = folder / "case/session.h5"
    how = spoil(folder / "whole.h5", path, seed)
    return f"session, {how}", lambda: (
        ask(path),
        info(path, as_json=True),
        info(path, as_json=False, verify=True),
    )


def repair_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """A session to be repaired, cut short with its journal or damaged without, and what came of it
    asked everything.
    """
    path, output = folder / "case/cut.h5", folder / "case/repaired.h5"
    if random.Random(seed).random() < 0.3:
        how = "repair without journal, " + spoil(folder / "whole.h5", path, seed)
    else:
        how = "repair by journal, " + spoil_journal(folder / "cut.h5", path, seed)
    return how, lambda: repair(path, output).output and ask(output)


def import_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """Images with tables of what they are and of forces, imported."""
    rng = random.Random(seed)
    images, which = (
        folder / "case/images",
        rng.choice(["metadata", "forces", "metadata and forces"]),
    )
    shutil.copytree(folder / "images", images)
    for name in ("metadata", "forces"):
        if name in which:
            (images / f"{name}.csv").write_bytes(
                spoil_table((images / f"{name}.csv").read_bytes(), rng)
            )
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


def fields_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """A file of displacement fields, as `slipscope invert` reads it."""
    path = folder / "case/fields.h5"
    how = spoil(folder / "whole-fields.h5", path, seed)
    return f"fields, {how}", lambda: (is_session(path), read_fields_file(path))


CASES = (
    session_case,
    settings_case,
    repair_case,
    session_case,
    settings_case,
    repair_case,
    session_case,
    fields_case,
    import_case,
)


def work(folder: Path) -> None:
    """Run the cases whose seeds come on standard input; for each a line of its kind, and one of
    outcome, traceback and peak memory.
    """
    # so that none takes the machine down
    resource.setrlimit(resource.RLIMIT_DATA, (4 * LIMIT_BYTES, resource.RLIM_INFINITY))
    answers, sys.stdout = sys.stdout, (folder / "output").open("w")
    make_whole(folder)
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        seed = int(line)
        outcome, thrown = "read", ""
        shutil.rmtree(folder / "case", ignore_errors=True)
        (folder / "case").mkdir()
        kind, case = CASES[seed % len(CASES)](folder, seed)
        print(kind, file=answers, flush=True)
        try:
            case()
        except (UserError, ConfigError) as error:
            outcome = "a sentence" if str(error) else "no sentence"
        except (Exception, typer.Exit):
            outcome, thrown = "traceback", traceback.format_exc(limit=-2)[-1500:]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
            1 if sys.platform == "darwin" else 1024
        )
        if peak > LIMIT_BYTES:
            outcome = "too much memory"
        print(json.dumps((outcome, thrown, peak)), file=answers, flush=True)


def make_whole(folder: Path) -> None:
    """What the cases spoil: a session, one that was cut short, fields, images and tables of an
    import.
    """
    writer, _ = record(folder / "whole.h5")
    writer.write_contact(CONTACT)
    shutil.copy(folder / "whole.h5", folder / "cut.h5")
    shutil.copy(journal_of(folder / "whole.h5"), journal_of(folder / "cut.h5"))
    writer.finish(OUTCOME)
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
    (folder / "images/forces.csv").write_text(
        "\n".join(["sample,time_s,P_N,Q_N", *forces]), encoding="utf-8"
    )
    grid = np.arange(4.0)
    with FieldsWriter(
        folder / "whole-fields.h5",
        ["a.tif"],
        grid,
        grid,
        ["ok"],
        {"reference": "r.tif", "box": 20},
        {"box": "px"},
    ):
        pass


@dataclass(frozen=True, slots=True)
class Case:
    """What became of one."""

    seed: int
    kind: str
    outcome: str
    thrown: str
    seconds: float
    peak: int  # bytes, of its worker until then

    @property
    def is_failure(self) -> bool:
        """Whether it was neither read nor refused."""
        return self.outcome not in {"read", "a sentence"}


def outcomes(seeds: Iterator[int], keep: Path | None) -> Iterator[Case]:
    """What became of each case, from a worker that is replaced whenever it fails."""
    worker = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in seeds:
            if worker is None:
                command = [sys.executable, __file__, "--worker", str(folder)]
                (folder / "whole.h5").unlink(missing_ok=True)
                worker = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    text=True,
                )
                assert worker.stdout
                worker.stdout.readline()  # ready
            assert worker.stdin
            assert worker.stdout
            clock = threading.Timer(LIMIT_S, worker.kill)
            clock.start()
            began = time.monotonic()
            worker.stdin.write(f"{seed}\n")
            worker.stdin.flush()
            kind = worker.stdout.readline().strip()
            answer = worker.stdout.readline()
            clock.cancel()
            seconds = time.monotonic() - began
            hung = f"killed after {LIMIT_S:g} s" if seconds >= LIMIT_S else "process died"
            case = Case(
                seed,
                kind,
                *(json.loads(answer)[:2] if answer.endswith("\n") else (hung, "")),
                seconds,
                _peak(answer),
            )
            yield case
            if case.is_failure:
                worker.kill()
                worker.wait()
                worker = None
                if keep:
                    shutil.copytree(folder / "case", keep / str(case.seed))
        if worker:
            worker.kill()
            worker.wait()


def _peak(answer: str) -> int:
    return int(json.loads(answer)[2]) if answer.endswith("\n") else 0


def main(cases: int, seed: int, workers: int, keep: Path | None) -> int:
    """Run the cases, print the tally; 1 if one failed."""
    done: list[Case] = []
    seeds, lock = iter(range(seed, seed + cases)), threading.Lock()

    def shared() -> Iterator[int]:
        while True:
            with lock:
                number = next(seeds, None)
            if number is None:
                return
            yield number

    began = time.monotonic()
    threads = [
        threading.Thread(target=lambda: done.extend(outcomes(shared(), keep)))
        for _ in range(workers)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for (kind, outcome), number in sorted(
        Counter((case.kind, case.outcome) for case in done).items()
    ):
        print(f"{kind:40} {outcome:16} {number:6}")
    failures = [case for case in done if case.is_failure]
    for case in failures[:20]:
        print(f"\nseed {case.seed}: {case.kind}: {case.outcome}\n{case.thrown}")
    slowest = max(done, key=lambda case: case.seconds)
    print(
        f"slowest: seed {slowest.seed}, {slowest.kind}, {slowest.seconds:.2f} s; memory:"
        f" {max(c.peak for c in done) >> 20} MiB at most"
    )
    print(
        f"{len(done)} cases from seed {seed} on in {time.monotonic() - began:.0f} s:"
        f" {len(failures)} failures"
    )
    return 1 if failures or len(done) != cases else 0


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("cases", nargs="?", type=int, default=10_000)
    options.add_argument("seed", nargs="?", type=int, default=0)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--keep", type=Path)
    options.add_argument("--worker", type=Path)
    asked = options.parse_args()
    if asked.worker:
        work(asked.worker)
    else:
        sys.exit(main(asked.cases, asked.seed, asked.workers, asked.keep))
