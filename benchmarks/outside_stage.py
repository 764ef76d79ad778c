"""A stage on an emulated SMC100 in a process of its own, which notes when the command to stop
arrives: ``python -m benchmarks.outside_stage [BYTE_S] [THINK_S]``. It prints its address, then the
time (``time.monotonic``) of each stop, and ends with its standard input.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time

from benchmarks.report import ROOT
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine
from tests.free_stage import FreeStage


class OutsideStage:
    """The process, and the stops that it has noted."""

    def __init__(self, byte_s: float = 0.0, think_s: float = 0.0) -> None:
        command = [sys.executable, "-m", "benchmarks.outside_stage", str(byte_s), str(think_s)]
        self._process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        self.port = self._process.stdout.readline().strip()
        self.stops: list[float] = []
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def settings(self) -> list[str]:
        """Of a bench that drives this stage."""
        return ["actuator.source=smc100", f"actuator.port={self.port}"]

    def first_after(self, moment: float, patience_s: float = 5.0) -> float | None:
        """Time of the first stop after that moment; None if none comes."""
        while time.monotonic() - moment < patience_s:
            found = [when for when in self.stops if when > moment]
            if found:
                return found[0]
            time.sleep(0.001)
        return None

    def end(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.stops.append(float(line))


def main() -> None:
    """Emulate until the standard input ends."""
    byte_s, think_s = (float(word) for word in (*sys.argv[1:], "0", "0")[:2])
    controller = Controller(FreeStage(), "smc100", is_referenced=True)
    line = SerialLine(controller, byte_s=byte_s, think_s=think_s)
    print(line.start(), flush=True)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    seen = 0
    while not ended.wait(0.002):
        arrivals = list(line.arrivals[seen:])
        seen += len(arrivals)
        for when, command in arrivals:
            if command == b"1ST":
                print(when, flush=True)


if __name__ == "__main__":
    main()
