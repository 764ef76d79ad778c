"""The stop that is asked for at a terminal, without anything that takes time to import: from Enter
to the stop of the stage pass some hundredths of a second instead of a second.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from app.processes.bench_client import BenchClient
from app.processes.calls import Gone
from app.processes.folder import (
    RunningBench,
    reachable,
    read_stop_answer,
    running_as,
)
from app.system.errors import UserError
from app.system.stopping import Stop, StopAnswer, failed, not_connected, settled

LOG = logging.getLogger(__name__)


def stopped(benches: Sequence[RunningBench]) -> list[StopAnswer]:
    """Stop the motion of benches, all at the same time; what became of each, once its position was
    read. Whatever goes wrong is an answer.
    """
    with ThreadPoolExecutor(max(1, len(benches)), "slipscope-stop") as threads:
        return list(threads.map(_stopped, benches))


def _stopped(bench: RunningBench) -> StopAnswer:
    def newest() -> StopAnswer | None:
        try:
            answer: StopAnswer | None = client.orders("stop_answer")
        except Gone:
            return read_stop_answer(bench.name)
        except TimeoutError:
            return None
        return answer

    try:
        client = BenchClient(bench)
        answer = settled(client.stop_motion(), newest)
    except Gone:
        answer = client.supervisor_answer() or not_connected("its process has just ended")
    except Exception as error:
        LOG.error("%s could not be stopped", _named(bench), exc_info=error)
        answer = failed(f"bench: {error}")
    return replace(answer, sentence=f"{answer.sentence} ({_named(bench)})", is_final=True)


def _named(bench: RunningBench) -> str:
    does = f"which records {Path(bench.session).name}" if bench.session else "without a run"
    return f"{bench.title}, {does}"


def stop(name: str | None) -> tuple[list[str], bool]:
    """Stop the motion of the run that is named or, if none is, of every bench, with a run or
    without one; what became of each, in sentences, and whether one has failed.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    # whoever wants a stop is asked nothing
    benches = reachable() if name is None else [running_as(name, "stop")]
    answers = stopped(benches)
    said = [answer.sentence for answer in answers]
    if not said:
        running_as(name, "stop")  # raises
    runs = [one for one in zip(benches, answers, strict=True) if one[0].session]
    # nothing is saved of a run that does not begin
    if len(runs) == 1 and runs[0][1].kind not in (Stop.FAILED, Stop.NOT_CONNECTED):
        bench = runs[0][0]
        said.append(f"{bench.title}: its run ends and saves {Path(bench.session).name}")
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
