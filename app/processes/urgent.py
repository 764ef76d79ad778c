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
from app.processes.calls import Gone, Silent
from app.processes.folder import (
    RunningBench,
    died,
    named,
    reachable,
    read_stop_answer,
    running,
    running_as,
)
from app.system.errors import UserError, spelled_out
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

    remedy = ""
    try:
        client = BenchClient(bench)
        answer = settled(client.stop_motion(), newest)
    except Gone:
        answer = client.supervisor_answer() or _unsupervised(bench)
    except Silent as error:
        answer, remedy = failed(f"bench: {error}"), f"; {client.why_silent()}"
    except Exception as error:
        LOG.error("%s could not be stopped", _named(bench), exc_info=error)
        answer = failed(f"bench: {error}")
    sentence = f"{answer.sentence} ({_named(bench)}){remedy}"
    return replace(answer, sentence=sentence, is_final=True)


def _unsupervised(bench: RunningBench) -> StopAnswer:
    """What is known of the stage of a bench that is gone, of which no supervisor says anything."""
    if bench.name not in {b.name for b in died()}:
        return not_connected("its process has just ended")
    return failed(f"bench: its process (number {bench.pid}) has ended, and so has its supervisor")


def _named(bench: RunningBench) -> str:
    does = f"which records {Path(bench.session).name}" if bench.session else "without a run"
    return f"{bench.title}, {does}"


def stop(name: str | None) -> tuple[list[str], bool]:
    """Stop the motion of the run that is named or, if none is, of every bench, with a run or
    without one; what became of each, in sentences, and whether one has failed, or its bench.

    Raises
    ------
    UserError
        None runs, or it is not clear which is meant.
    """
    benches = _meant(name)
    answers = stopped(benches)
    said, gone = [answer.sentence for answer in answers], {bench.name for bench in died()}
    runs = [one for one in zip(benches, answers, strict=True) if one[0].session]
    for bench, answer in runs:
        session = Path(bench.session).name
        if bench.name in gone:
            said.append(
                f"{bench.title}: `slipscope repair {bench.session} -o REPAIRED.h5` gives back what"
                " it recorded"
            )
        # nothing is saved of a run that does not begin
        elif len(runs) == 1 and answer.kind not in (Stop.FAILED, Stop.NOT_CONNECTED):
            said.append(f"{bench.title}: its run ends and saves {session}")
    is_whole = gone.isdisjoint(bench.name for bench in benches)
    return said, not is_whole or any(answer.has_failed for answer in answers)


def _meant(name: str | None) -> list[RunningBench]:
    """The benches to stop; whoever wants a stop without a name is asked nothing. Those that have
    died a short while ago where no other is meant.
    """
    if name is None and (benches := reachable()):
        return benches
    dead = [] if named(running(), name) else named(died(), name)
    return dead or [running_as(name, "stop")]


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
        print(
            *(f"slipscope: {spelled_out(sentence)}" for sentence in said),
            sep="\n",
            file=sys.stderr,
        )
    return code
