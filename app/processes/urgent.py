"""The stop that is asked for at a terminal, without anything that takes time to import: from Enter
to the stop of the stage pass some hundredths of a second instead of a second.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import psutil

from app.processes.calls import Caller, Gone
from app.processes.folder import RunningBench, known, running, running_as, told
from app.system.errors import UserError
from app.system.stopping import POLL_S, Stop, StopAnswer, failed, not_connected, settled

LOG = logging.getLogger(__name__)
SUPERVISED_S = 3.0  # until the supervisor of a bench that is gone has stopped its stage


class Called:
    """A bench, of which nothing is known but how to stop it."""

    def __init__(self, bench: RunningBench) -> None:
        self._call = Caller(bench.address, bytes.fromhex(bench.key))
        self._name = bench.name

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator, then end the run; what the actuator answered."""
        answer: StopAnswer = self._call("stop_motion")
        return answer

    def stop_answer(self) -> StopAnswer | None:
        """What became of the stop; None where nothing more can be asked."""
        try:
            answer: StopAnswer | None = self._call("stop_answer")
            return answer
        except Gone:
            return told(self._name)
        except TimeoutError:
            return None


def stopped(benches: Sequence[RunningBench]) -> list[StopAnswer]:
    """Stop the motion of benches, all at the same time; what became of each, once its position was
    read. Whatever goes wrong is an answer.
    """
    with ThreadPoolExecutor(max(1, len(benches)), "slipscope-stop") as threads:
        return list(threads.map(_stopped, benches))


def _stopped(bench: RunningBench) -> StopAnswer:
    try:
        called = Called(bench)
        answer = settled(called, called.stop_motion())
    except Gone:
        answer = _from_outside(bench) or not_connected("its process has just ended")
    except Exception as error:
        LOG.error("%s could not be stopped", _named(bench), exc_info=error)
        answer = failed(f"bench: {error}")
    return replace(answer, sentence=f"{answer.sentence} ({_named(bench)})", is_final=True)


def _from_outside(bench: RunningBench) -> StopAnswer | None:
    """What the supervisor of a bench that is gone says, for as long as it is at it."""
    give_up = time.monotonic() + SUPERVISED_S
    while (answer := told(bench.name)) is None and time.monotonic() < give_up:
        if not psutil.pid_exists(known(bench).supervisor_pid or -1):
            return told(bench.name)
        time.sleep(POLL_S)
    return answer


def _named(bench: RunningBench) -> str:
    return f"{bench.title}, which records {Path(bench.session).name}"


def stop(name: str | None) -> tuple[list[str], bool]:
    """Stop the motion of the run that is under way, or of every one if none is named; what became
    of each, in sentences, and whether one has failed.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    benches = running()
    if name is not None or len(benches) < 2:  # whoever wants a stop is asked nothing
        benches = [running_as(name, "stop")]
    answers = stopped(benches)
    said = [answer.sentence for answer in answers]
    # nothing is saved of a run that does not begin
    if len(benches) == 1 and answers[0].kind not in (Stop.FAILED, Stop.NOT_CONNECTED):
        said.append(f"{benches[0].title}: its run ends and saves {Path(benches[0].session).name}")
    return said, any(answer.kind is Stop.FAILED for answer in answers)


def at_once(arguments: Sequence[str]) -> int | None:
    """Do ``slipscope stop [NAME]`` if these arguments say no more than that; the exit code, or None
    where all commands have to be looked at.
    """
    if arguments[:1] != ["stop"] or len(arguments) > 2 or any(a[:1] == "-" for a in arguments):
        return None
    try:
        said, has_failed = stop(arguments[1] if len(arguments) > 1 else None)
    except UserError as error:
        said, code = [str(error)], 2
    except KeyboardInterrupt:
        said, code = ["stop: interrupted before the stage was read at rest; watch it"], 1
    except Exception:  # told by what looks at all commands
        return None
    else:
        code = int(has_failed)
    with suppress(OSError):  # nobody reads it
        print(*(f"slipscope: {sentence}" for sentence in said), sep="\n", file=sys.stderr)
    return code
