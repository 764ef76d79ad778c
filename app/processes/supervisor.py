"""The supervisor: a small process beside the bench that stops the stage if the bench does not.

The bench beats ten times a second: its newest sample, the travel of the stage, whether it drives.
The stage is stopped when the bench is gone, when it says nothing, when it drives on without
forces, and when the stage is beyond its limit. A bench that says nothing is ended before it can
move the stage again.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from app.processes.folder import tell
from app.processes.starting import payload, say_hello
from app.stopping import failed, sent_from_outside
from drivers.errors import DeviceError
from drivers.protocols import OutsideStopper

SILENT_S, TRIES = 0.8, 5


@dataclass(frozen=True, slots=True)
class Watch:
    """What is watched: the way to the stage, the bench's process, and its limits; and the file that
    says what became of a stop.
    """

    stopper: OutsideStopper
    bench: int
    age_s: float
    travel_m: float
    answer: Path


def main() -> None:
    """Watch until the bench says that it has ended, or must be stopped."""
    watch: Watch = payload()
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    beats: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(beats,), daemon=True).start()
    say_hello("watching")
    newest, since, is_stopped = -1, time.monotonic(), False
    while True:
        try:
            beat = beats.get(timeout=SILENT_S)
        except queue.Empty:
            beat = ""
        if beat == "end":
            return
        if not beat:
            _stop(watch, and_kill=True)
            return
        sample, travel, drives = beat.split()
        if int(sample) != newest or drives == "0":
            newest, since = int(sample), time.monotonic()
        is_silent = time.monotonic() - since > watch.age_s
        if (is_silent or abs(float(travel)) > watch.travel_m) and not is_stopped:
            _stop(watch, and_kill=False)
            is_stopped = True


def _listen(beats: queue.SimpleQueue[str]) -> None:
    pending = b""
    while said := os.read(sys.stdin.fileno(), 4096):
        *lines, pending = (pending + said).split(b"\n")
        for line in lines:
            beats.put(line.decode())
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
    tell(watch.answer, failed(problem) if problem else sent_from_outside())


def _problem(watch: Watch) -> str:
    """Stop the stage; why that has failed, empty if it has not."""
    try:
        watch.stopper.stop()
    except DeviceError as error:
        return str(error)
    return ""
