"""Sessions, journals, settings, bench files, images, tables and folders, damaged at random and by
ill will, each given to a command. A case must end in a result or in a refusal: a sentence and an
exit code. Anything else is a failure: any other exception, a process that dies, more than 10 s or
more than 1 GiB of memory, a file that is written, removed or renamed elsewhere than in the folder
of the case, a socket, a program or code that is run. The cases run one by one in worker processes,
so that none can take the count down with it.

    python -m benchmarks fuzz [CASES] [SEED] [--keep FOLDER] [--longest SECONDS]

A failure is named by its seed; --keep FOLDER keeps its files. Linux and macOS.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import typer

from app.settings.config import ConfigError
from app.system.errors import UserError
from benchmarks.hostile import CASES, make_whole
from benchmarks.report import ROOT, Report

assert sys.platform != "win32", "it asks what a system of POSIX knows of a process"

SUBJECT = "Damaged input"
MEASURES = ("app.session",)
LIMIT_S, LIMIT_BYTES = 10.0, 1 << 30
WORKER = "import sys, pathlib, benchmarks.fuzz; benchmarks.fuzz.work(pathlib.Path(sys.argv[1]))"
# events of the interpreter by which something outside is changed, and which argument names it
_CHANGES = {
    "os.rename": (0, 1),
    "os.link": (1,),
    "os.symlink": (1,),
    **dict.fromkeys(("os.remove", "os.rmdir", "os.mkdir", "os.truncate", "os.chmod"), (0,)),
}
_OUTSIDE = (
    "socket.connect",
    "socket.bind",
    "socket.getaddrinfo",
    "socket.sendto",
    "urllib.Request",
)
_PROGRAMS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "pty.spawn")
_HARMLESS = ("app.session.vetting", "fc-list")  # what reads sessions from elsewhere; matplotlib's


class Watch:
    """What a case does outside of the folders in which it may write."""

    def __init__(self, folder: Path) -> None:
        self.seen: list[str] = []
        own = ("case", "state", "tmp", "../cache")
        self._own = tuple(os.path.abspath(folder / name) + os.sep for name in own)
        self._case = self._own[0]
        self._lasting = [path for path in folder.iterdir() if path.name not in (*own, "output")]
        self._before = self._look()
        sys.addaudithook(self._hear)

    def _look(self) -> dict[Path, tuple[int, ...]]:
        """State of all files that must stay as they are."""
        paths = [*self._lasting, *(p for path in self._lasting for p in path.rglob("*"))]
        looks = {path: path.stat() for path in paths}
        return {path: (s.st_ino, s.st_size, s.st_mtime_ns) for path, s in looks.items()}

    def take(self) -> list[str]:
        """What was seen since the last time."""
        seen, self.seen = self.seen, []
        changed = [path for path, state in self._look().items() if self._before.get(path) != state]
        return seen + [f"{path} was changed" for path in changed]

    def _hear(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = args
            writes = flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC)
            if writes and not isinstance(path, int) and not self._is_own(path):
                self.seen.append(f"open {path} {mode}")
        elif event in _CHANGES:
            for n in _CHANGES[event]:
                if not isinstance(args[n], int) and not self._is_own(args[n]):
                    self.seen.append(f"{event} {args[n]}")
        elif event in _OUTSIDE or (event in _PROGRAMS and not _is_harmless(args)):
            self.seen.append(f"{event} {args!r:.300}")
        elif event == "exec" and getattr(args[0], "co_filename", "").startswith(self._case):
            self.seen.append(f"{args[0].co_filename} was run")
        elif event == "ctypes.dlopen" and str(args[0]).startswith(self._case):
            self.seen.append(f"{args[0]} was loaded")

    def _is_own(self, path: Any) -> bool:
        text = os.path.abspath(os.fsdecode(path))
        is_kernel = Path(text).is_relative_to(ROOT) and "__pycache__" in text  # numba's
        return is_kernel or f"{text}/".startswith(self._own) or text == os.devnull


def _is_harmless(program: tuple[Any, ...]) -> bool:
    return any(name in map(str, program[1]) for name in _HARMLESS)


def work(folder: Path) -> None:
    """Run the cases whose seeds come on standard input; for each, a line of its kind and one of its
    outcome, traceback and peak memory.
    """
    # a case may ask for too much memory, but must not take the machine down
    resource.setrlimit(resource.RLIMIT_DATA, (4 * LIMIT_BYTES, resource.RLIM_INFINITY))
    answers, sys.stdout = sys.stdout, (folder / "output").open("w")
    make_whole(folder)
    with suppress(ImportError):
        import_module("harvesters.core")  # asks git for its own version, whoever loads it first
    os.chdir(folder / "case")
    watch = Watch(folder)
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        seed, outcome, thrown = int(line), "result", ""
        for path in (folder / "case").iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        kind, case = CASES[seed % len(CASES)](folder, seed)
        print(kind, file=answers, flush=True)
        watch.take()
        try:
            case()
        except (UserError, ConfigError) as error:
            outcome = "refused" if str(error) else "refused without a sentence"
        except (Exception, typer.Exit):
            outcome, thrown = "other exception", traceback.format_exc(limit=-2)[-1500:]
        if seen := watch.take():
            outcome, thrown = "touched something else", "\n".join(seen[:5])
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

    def __init__(self, folder: Path, keep: Path | None, longest: float) -> None:
        self._folder, self._keep, self._longest = folder, keep, longest
        self._start()

    def _start(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)
        for name in ("state", "tmp", "../cache"):
            (self._folder / name).mkdir(parents=True, exist_ok=True)
        own = {
            "PYTHONPATH": str(ROOT),
            "SLIPSCOPE_HOME": str(self._folder / "state"),
            "MPLCONFIGDIR": str(self._folder.with_name("cache")),  # of all workers
            "TMPDIR": str(self._folder / "tmp"),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        command = [sys.executable, "-P", "-c", WORKER, str(self._folder)]
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
        self._process = subprocess.Popen(
            command,
            stdin=pipe,
            stdout=pipe,
            stderr=nothing,
            text=True,
            env=os.environ | own,
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
        clock, began = threading.Timer(self._longest, self._process.kill), time.monotonic()
        clock.start()
        print(seed, file=self._questions, flush=True)
        kind, answer = self._answers.readline().strip(), self._answers.readline()
        clock.cancel()
        seconds = time.monotonic() - began
        how = f"killed after {seconds:.0f} s" if seconds >= self._longest else "process died"
        outcome = json.loads(answer) if answer.endswith("\n") else (how, "", 0)
        ended = Ended(seed, kind, *outcome, seconds)  # type: ignore[call-arg]
        if ended.is_failure:
            self.end()
            if self._keep:
                shutil.copytree(self._folder / "case", self._keep / str(seed))
            self._start()
        return ended


def run_all(seeds: range, workers: int, keep: Path | None, longest: float) -> list[Ended]:
    """How all cases ended, run by several workers."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as threads:
        made = [Worker(Path(folder) / str(n), keep, longest) for n in range(workers)]
        free: SimpleQueue[Worker] = SimpleQueue()
        for worker in made:
            free.put(worker)

        def case(seed: int) -> Ended:
            worker = free.get()
            try:
                ended = worker.case(seed)
            finally:
                free.put(worker)
            if ended.is_failure:
                print(f"\nseed {seed}: {ended.kind}: {ended.outcome}\n{ended.thrown}", flush=True)
            return ended

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
    longest: float = LIMIT_S,
) -> int:
    """Run the cases and count how they ended; 1 if one failed."""
    done = run_all(range(seed, seed + cases), workers, keep, longest)
    failures = [case for case in done if case.is_failure]
    report.add("cases", len(done))
    report.add("failures", len(failures), at_most=0)
    report.add("slowest case", max(case.seconds for case in done), "s", at_most=longest)
    report.add("largest memory", max(case.peak for case in done) >> 20, "MiB", at_most=1024)
    return int(bool(failures))
