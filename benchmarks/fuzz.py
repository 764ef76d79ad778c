"""Settings and sessions spoiled at random: ``python benchmarks/fuzz.py [CASES] [SEED] [--keep FOLDER]`` prints what became of each kind.

A case must end as read, or refused with a sentence (UserError, ConfigError). Whatever else is a failure: another exception, a process
that died, more than `LIMIT_S` seconds, more than `LIMIT_BYTES` of memory. Each is named by its seed; ``--keep`` keeps its file.
The cases run one by one in worker processes, so that none can take the count down with it. Linux and macOS.
"""

from __future__ import annotations

import argparse
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
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/session"))

import numpy as np
import typer
from session_material import CONTACT, OUTCOME, record
from spoiled import ask, spoil
from spoiled_settings import VALUES, spoil_settings

from app.commands.inspect import info
from app.config import ConfigError, from_record, load, options
from app.errors import UserError
from app.sections import Config
from app.session.fields import FieldsWriter, is_session, read_fields_file

KEYS = [f"{table}.{key}" for table, (kind, _) in options(Config).items() for key in options(kind)]
LIMIT_S, LIMIT_BYTES, WORKERS = 10.0, 1 << 30, 2


def settings_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """Settings from a file, from the command line, or from a session."""
    rng = random.Random(seed)
    content = spoil_settings(rng)
    path = folder / "case.toml"
    path.write_bytes(content)
    text = content.decode("utf-8", "replace")
    ways: dict[str, Callable[[], object]] = {
        "settings file": lambda: load(path),
        "settings --set": lambda: load(None, [f"{rng.choice(KEYS)}={rng.choice(VALUES)}", *text.splitlines()[: rng.randint(0, 2)]]),
        "settings of a session": lambda: from_record(text, "session"),
    }
    way = rng.choice(list(ways))
    return way, ways[way]


def session_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """A session, asked everything and shown by `slipscope info`."""
    path = folder / "case.h5"
    how = spoil(folder / "whole.h5", path, seed)
    return f"session, {how}", lambda: (ask(path), info(path, as_json=True), info(path, as_json=False))


def fields_case(folder: Path, seed: int) -> tuple[str, Callable[[], object]]:
    """A file of displacement fields, as `slipscope invert` reads it."""
    path = folder / "case-fields.h5"
    how = spoil(folder / "whole-fields.h5", path, seed)
    return f"fields, {how}", lambda: (is_session(path), read_fields_file(path))


CASES = (session_case, session_case, session_case, settings_case, settings_case, fields_case)


def work(folder: Path) -> None:
    """Run the cases whose seeds come on standard input; a line of kind, outcome and what else was thrown for each."""
    answers, sys.stdout = sys.stdout, (folder / "output").open("w")
    make_whole(folder)
    for line in sys.stdin:
        seed = int(line)
        outcome, thrown = "read", ""
        kind, case = CASES[seed % len(CASES)](folder, seed)
        print(kind, file=answers, flush=True)
        try:
            case()
        except (UserError, ConfigError) as error:
            outcome = "a sentence" if str(error) else "no sentence"
        except (Exception, typer.Exit):
            outcome, thrown = "traceback", traceback.format_exc(limit=-2)[-1500:]
        if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) > LIMIT_BYTES:
            outcome = "too much memory"
        print(repr((outcome, thrown)), file=answers, flush=True)


def make_whole(folder: Path) -> None:
    """The session and the fields that the cases spoil."""
    writer, _ = record(folder / "whole.h5")
    writer.write_contact(CONTACT)
    writer.finish(OUTCOME)
    writer.close()
    grid = np.arange(4.0)
    with FieldsWriter(folder / "whole-fields.h5", ["a.tif"], grid, grid, ["ok"], {"reference": "r.tif", "box": 20}, {"box": "px"}):
        pass


def outcomes(seeds: Iterator[int], keep: Path | None) -> Iterator[tuple[int, str, str, str]]:
    """Seed, kind, outcome and traceback of each case, from a worker that is replaced whenever it fails."""
    worker = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in seeds:
            if worker is None:
                (folder / "whole.h5").unlink(missing_ok=True)
                command = [sys.executable, __file__, "--worker", str(folder)]
                worker = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            assert worker.stdin
            assert worker.stdout
            worker.stdin.write(f"{seed}\n")
            worker.stdin.flush()
            kind = worker.stdout.readline().strip()
            clock = threading.Timer(LIMIT_S, worker.kill)
            clock.start()
            began = time.monotonic()
            answer = worker.stdout.readline()
            clock.cancel()
            hung = f"killed after {LIMIT_S:g} s" if time.monotonic() - began >= LIMIT_S else "process died"
            outcome, thrown = eval(answer) if answer.endswith("\n") else (hung, "")
            yield seed, kind, outcome, thrown
            if outcome not in {"read", "a sentence"}:
                worker.kill()
                worker.wait()
                worker = None
                if keep:
                    for case in folder.glob("case*"):
                        shutil.copy(case, keep / f"{seed}-{case.name}")
        if worker:
            worker.kill()
            worker.wait()


def main(cases: int, seed: int, keep: Path | None) -> int:
    """Run the cases, print the tally; 1 if one failed."""
    tally: Counter[tuple[str, str]] = Counter()
    failures: list[tuple[int, str, str, str]] = []
    seeds, lock = iter(range(seed, seed + cases)), threading.Lock()

    def shared() -> Iterator[int]:
        while True:
            with lock:
                number = next(seeds, None)
            if number is None:
                return
            yield number

    def count() -> None:
        for found in outcomes(shared(), keep):
            tally[found[1], found[2]] += 1
            if found[2] not in {"read", "a sentence"}:
                failures.append(found)

    began = time.monotonic()
    threads = [threading.Thread(target=count) for _ in range(WORKERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for (kind, outcome), number in sorted(tally.items()):
        print(f"{kind:32} {outcome:16} {number:6}")
    for failed, kind, outcome, thrown in failures[:20]:
        print(f"\nseed {failed}: {kind}: {outcome}\n{thrown}")
    print(f"{sum(tally.values())} cases from seed {seed} on in {time.monotonic() - began:.0f} s: {len(failures)} failures")
    return 1 if failures or sum(tally.values()) != cases else 0


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("cases", nargs="?", type=int, default=10_000)
    options.add_argument("seed", nargs="?", type=int, default=0)
    options.add_argument("--keep", type=Path)
    options.add_argument("--worker", type=Path)
    asked = options.parse_args()
    if asked.worker:
        work(asked.worker)
    else:
        sys.exit(main(asked.cases, asked.seed, asked.keep))
