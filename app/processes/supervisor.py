"""The supervisor: a small process beside the bench that stops the stage if the bench does not.

The bench beats ten times a second: its newest sample, the travel of the stage, whether it drives.
The stage is stopped when the bench is gone or silent, drives on without forces, or is beyond its
limit: again as long as that has not helped. A bench that drives in silence is ended as well.
"""

from __future__ import annotations

import math
import os
import queue
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from app.processes.folder import write_stop_answer
from app.processes.starting import next_awake, payload, report_ready
from app.system.interrupting import ignore_signals_to_end
from app.system.stopping import failed, sent_from_outside
from app.system.threads import start_thread
from drivers.protocols import OutsideStopper

SILENT_S, TRIES = 0.8, 5
AGAIN_S, AGAIN_M = 2.0, 5e-6  # that a stage may go on after a stop, until it is stopped again


@dataclass(frozen=True, slots=True)
class Watch:
    """The way to the stage, the bench's process, its limits, the file that tells of a stop."""

    stopper: OutsideStopper
    bench: int
    age_s: float
    travel_m: float
    answer: Path


def main() -> None:
    """Watch until the bench says that it has ended, or must be stopped."""
    watch: Watch = payload()
    ignore_signals_to_end()
    beats: queue.SimpleQueue[str] = queue.SimpleQueue()
    start_thread("beats", _listen, beats)
    report_ready("watching")
    newest, drives = "", False
    stop_at, most_m = math.inf, watch.travel_m  # the next stop: when, and how far out
    while True:
        try:
            beat = next_awake(beats, SILENT_S)
        except queue.Empty:
            if not drives:
                _problem(watch)  # it may have begun to move just before it fell silent
            beat = "" if drives else beats.get()
        if beat in ("", "end"):
            break
        now, (sample, told_m, says) = time.monotonic(), beat.split()
        travel_m, drives = abs(float(told_m)), says == "1"
        if sample != newest or not drives:
            newest, stop_at = sample, now + watch.age_s
        if travel_m <= watch.travel_m:
            most_m = watch.travel_m
        if now > stop_at or travel_m > most_m:
            _stop(watch, and_kill=False)
            stop_at = max(stop_at, now + AGAIN_S)
            most_m = max(most_m, travel_m + AGAIN_M)
    if not beat:
        _stop(watch, and_kill=True)


def _listen(beats: queue.SimpleQueue[str]) -> None:
    with os.fdopen(sys.stdin.fileno(), "rb", 0, closefd=False) as lines:  # no lock at the exit
        for line in lines:
            beats.put(line.decode().strip())
    beats.put("")


def _stop(watch: Watch, *, and_kill: bool) -> None:
    problem = _problem(watch)
    if and_kill or problem:  # the port may be the bench's alone until it has ended
        with suppress(OSError):  # it may be gone
            os.kill(watch.bench, getattr(signal, "SIGKILL", signal.SIGTERM))
        for _ in range(TRIES):
            if not (problem := _problem(watch)):
                break
            time.sleep(0.05)
    with suppress(OSError):  # a folder that is gone, or full, is no end of the watch
        write_stop_answer(watch.answer, failed(problem) if problem else sent_from_outside())


def _problem(watch: Watch) -> str:
    """Stop the stage; why that has failed, empty if it has not."""
    try:
        watch.stopper.stop()
    except Exception as error:  # of a driver from anywhere
        return str(error)
    return ""
