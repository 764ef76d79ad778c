"""Deliberate breaks of the program, one at a time, and whether the tests catch each.

    python -m tests.mutants                 # all of them, beside one another on all cores
    python -m tests.mutants supervisor dic  # those whose file or sentence holds one of these words
    python -m tests.mutants --sample 100    # so many of them, drawn at random
    python -m tests.mutants --quick         # without the slow tests, as `pytest` itself
    python -m tests.mutants --list

Each break stands in one of the files `*.toml` of this folder: what it does to the program, the
file, the text before and after, and the narrowest tests that should fail. It is made in a copy of
the program, never in this folder, in which its tests must pass before the first break. Exit code
0: all but the known survivors were caught.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import Queue

ROOT = Path(__file__).parents[2]
PARTS = ("analysis", "app", "drivers", "slipscope", "tests", "docs", "benchmarks")
PARTS += ("pyproject.toml", "README.md")
LONGEST_S = 900.0  # of the tests of one break; what stands still is caught as well
SOUND_S = 7200.0  # of the tests of all breaks, before the first


@dataclass(frozen=True, slots=True)
class Break:
    """One mistake that a programmer could make."""

    what: str  # the mistake, in words
    file: str  # relative to the root
    before: str  # occurs once in the file
    after: str
    tests: list[str]  # arguments of pytest
    survives: str = ""  # why no test can catch it, where it is known that none does

    def place(self) -> str:
        """The file and the line where it begins."""
        text = (ROOT / self.file).read_text(encoding="utf-8")
        return f"{self.file}:{text[: text.index(self.before)].count(chr(10)) + 1}"


def breaks() -> list[Break]:
    """All of the list, in the order of their files."""
    found = []
    for path in sorted(Path(__file__).parent.glob("*.toml")):
        found += [Break(**one) for one in tomllib.loads(path.read_text("utf-8"))["break"]]
    return found


def copy_to(folder: Path) -> None:
    """What the tests need of this checkout."""
    ignored = shutil.ignore_patterns("__pycache__", ".*_cache", ".hypothesis")
    for name in PARTS:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / name, ignore=ignored)
        else:
            shutil.copy(source, folder / name)


def run_tests(
    folder: Path, arguments: list[str], is_quick: bool, longest_s: float = LONGEST_S
) -> tuple[int, str]:
    """Exit code of pytest in a copy, and the lines that name the failures (or the last line)."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    command += [] if is_quick else ["-m", "not long"]
    # each copy keeps its compiled modules, for the next break leaves nearly all of them as they are
    kept = {"PYTHONDONTWRITEBYTECODE": "", "PATIENCE_MS": "20000"}
    environment = os.environ | kept | {"PYTHONPATH": str(folder)}
    try:
        done = subprocess.run(
            [*command, *arguments],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=longest_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return 1, f"no end within {longest_s:.0f} s"
    lines = done.stdout.splitlines() or done.stderr.splitlines() or [""]
    named = [line for line in lines if line.startswith(("FAILED ", "ERROR "))]
    return done.returncode, "\n".join(named or lines[-1:])  # the logs before have errors, too


def try_break(one: Break, copies: Queue[Path], is_quick: bool) -> tuple[int, str, float]:
    """Exit code of its tests, the first failure, and how long it took in seconds."""
    folder, began = copies.get(), time.monotonic()
    path = folder / one.file
    sound = path.read_text(encoding="utf-8")
    try:
        if sound.count(one.before) != 1:
            return 4, f"the text before occurs {sound.count(one.before)} times", 0.0
        path.write_text(sound.replace(one.before, one.after), encoding="utf-8")
        code, failure = run_tests(folder, ["-x", "-n", "0", *one.tests], is_quick)
        return code, failure, time.monotonic() - began
    finally:
        path.write_text(sound, encoding="utf-8")
        copies.put(folder)


def main() -> int:
    """Try them, and print what became of each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("words", nargs="*", help="only breaks whose place or sentence holds one")
    parser.add_argument("--quick", action="store_true", help="leave the slow tests out")
    parser.add_argument("--list", action="store_true", help="print them and do nothing")
    parser.add_argument("--sample", type=int, metavar="N", help="N of them, drawn at random")
    parser.add_argument("--seed", type=int, default=0, help="of the draw (default 0)")
    parser.add_argument("-j", type=int, default=os.cpu_count() or 1, help="how many at a time")
    chosen = parser.parse_args()
    some = [one for one in breaks() if not chosen.words
            or any(word in f"{one.file} {one.what}" for word in chosen.words)]  # fmt: skip
    if chosen.sample is not None:
        some = random.Random(chosen.seed).sample(some, min(chosen.sample, len(some)))
    if chosen.list:
        print(*(f"{one.place()}  {one.what}" for one in some), sep="\n")
        return 0
    if not some:
        parser.error(f"no break's place or sentence holds {' or '.join(chosen.words)}")
    counts = {"caught": 0, "SURVIVED": 0, "known": 0, "DID NOT RUN": 0}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        copies: Queue[Path] = Queue()
        for number in range(chosen.j):
            copy_to(Path(folder) / str(number))
            copies.put(Path(folder) / str(number))
        tests = sorted({test for one in some for test in one.tests})
        code, failures = run_tests(copies.queue[0], [*tests, "-n", f"{chosen.j}"],
                                   chosen.quick, SOUND_S)  # fmt: skip
        if code:  # they would seem to catch each break
            print(f"these tests fail without a break:\n{failures}")
            return 1
        with ThreadPoolExecutor(chosen.j) as pool:
            trials = {pool.submit(try_break, one, copies, chosen.quick): one for one in some}
            for trial in as_completed(trials):
                one, (code, failure, taken_s) = trials[trial], trial.result()
                # 2: what the tests compute as they are collected fails; each break can be parsed
                caught = {0: "known" if one.survives else "SURVIVED", 1: "caught", 2: "caught"}
                verdict = caught.get(code, "DID NOT RUN")
                counts[verdict] += 1
                reason = one.survives if verdict == "known" else failure
                print(f"{verdict:11s} {taken_s:5.0f} s  {one.file}: {one.what}", flush=True)
                print(f"{'':19s}  {reason}", flush=True)
    print(f"{len(some)} breaks: " + ", ".join(f"{n} {word}" for word, n in counts.items()))
    return int(bool(counts["SURVIVED"] or counts["DID NOT RUN"]))


if __name__ == "__main__":
    sys.exit(main())
