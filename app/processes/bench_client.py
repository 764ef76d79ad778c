"""The way to a bench in another process, without anything that takes time to import: a stop waits
for nothing.
"""

from __future__ import annotations

import sys
import time
from typing import Any

from app.processes.calls import ANSWER_S, Caller, Silent
from app.processes.folder import RunningBench, read_stop_answer, refreshed
from app.system.stopping import StopAnswer

POLL_S = 0.1
SUPERVISED_S = 3.0  # a supervisor stops the stage of a dead bench within it


class BenchClient:
    """A bench in another process, of which nothing is known but how to stop it.

    Attributes
    ----------
    bench : RunningBench
    orders : Caller
        Calls its methods on a connection on which nothing is asked that only reads.
    """

    def __init__(self, bench: RunningBench) -> None:
        self.bench = bench
        self.orders = self.new_caller()

    def new_caller(self) -> Caller:
        """A further connection: what is called on it waits for nothing on the others."""
        return Caller(self.bench.address, bytes.fromhex(self.bench.key))

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator; what it answered.

        Raises
        ------
        Gone, Silent
        """
        answer: StopAnswer = self.orders("stop_motion")
        return answer

    def answered(
        self, caller: Caller, name: str, *arguments: Any, answer_s: float = ANSWER_S
    ) -> Any:
        """What a method answers on a connection.

        Raises
        ------
        Gone
        Silent
            With why it may not answer, and what the operator can do.
        """
        try:
            return caller(name, *arguments, answer_s=answer_s)
        except Silent as error:
            raise Silent(f"{self.bench.title}: {error}; {self.why_silent()}") from None

    def why_silent(self) -> str:
        """Why it does not answer although its process is there, and what the operator can do."""
        bench = refreshed(self.bench)
        pid = bench.pid
        found, kill = "has no turn on this computer, or hangs: ", f"kill -KILL {pid}"
        if sys.platform == "win32":
            kill = f"taskkill /F /PID {pid}"
        elif bench.is_suspended:
            found = f"is suspended: kill -CONT {pid} resumes it and its run, "
        stops = ""
        if bench.has_supervisor:
            stops = ", upon which its supervisor stops the stage"
        return f"its process (number {pid}) {found}{kill} ends it{stops}"

    def supervisor_answer(self) -> StopAnswer | None:
        """What the supervisor of a bench that is gone says, for as long as it is at it."""
        give_up, name = time.monotonic() + SUPERVISED_S, self.bench.name
        while (answer := read_stop_answer(name)) is None and time.monotonic() < give_up:
            if not refreshed(self.bench).has_supervisor:
                return read_stop_answer(name)
            time.sleep(POLL_S)
        return answer
