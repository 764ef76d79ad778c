"""`slipscope check-driver`: tries a driver of somebody's own against every contract of its kind."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from app.acquisition.watchdog import STEP_PATIENCE_S, Patience
from app.bench_checks.doctor import Checked, as_data, problem
from app.cli.terminal import DONE, FAILED, print_json, print_line
from app.processes.dying_move import MOVES, new_device
from app.processes.starting import start_process, wait_until_ready
from app.processes.stoppable import stoppable
from app.runs.live import make_bench
from app.settings.config import load
from app.settings.sections import Config
from app.system.errors import UserError, in_full
from drivers.contracts import (
    CONTRACTS,
    TRAIN,
    BrokenContract,
    Contract,
    NotTried,
    WrongScale,
    cut_line,
)
from drivers.errors import DeviceError
from drivers.sources import Driver, NeverMade, driver

READ_TIMEOUT_S = 5.0
Wrap = Callable[[Any], Any]
METHODS = {"actuator": "move_to", "forces": "backlog", "camera": "read"}  # the first that is there


def check_driver(
    source: str,
    overrides: Sequence[str],
    *,
    move: bool,
    as_json: bool,
    pass_time: Callable[[float], None] = time.sleep,
) -> int:
    """Print one line for each contract; the exit code, 1 if one is broken.

    Raises
    ------
    UserError
        The source names no driver whose device could be tried by itself.
    """
    kind = kind_of(source)
    config = load(None, [f"{kind}.source={source}", *overrides])
    findings: list[Checked] = []
    with ExitStack() as stack:
        wrap: Wrap = _as_it_is
        if move and kind == "actuator":
            wrap = stack.enter_context(stoppable(config, "check-driver"))
        for finding in check(kind, config, move=move, pass_time=pass_time, wrap=wrap):
            findings.append(finding)
            if not as_json:
                word = "ok    " if finding.is_fine else "BROKEN" if finding.needed else "left  "
                print_line(f"{word} {finding.label}{': ' * bool(finding.found)}{finding.value}")
    broken = sum(finding.needed and not finding.is_fine for finding in findings)
    left = sum(not finding.needed for finding in findings)
    if as_json:
        contracts = [as_data(finding) for finding in findings]
        print_json({"kind": kind, "keeps_all": not (broken or left), "contracts": contracts})
    else:
        text = f"{source}: {len(findings)} contracts of the {kind}, {broken} broken"
        print_line(text + f", {left} not tried" * bool(left))
    return FAILED if broken else DONE


def kind_of(source: str) -> str:
    """The kind of device that a class ``package.module:Class`` drives, by its methods.

    Raises
    ------
    UserError
        It is none.
    """
    if ":" not in source:
        raise UserError(f"check-driver: '{source}' is no class; give it as package.module:Class")
    made = Driver("check-driver", source).driver_class
    for kind, method in METHODS.items():
        if hasattr(made, method):
            return kind
    raise UserError(
        f"check-driver: '{source}' has none of the methods {', '.join(METHODS.values())}, so that"
        " it is no driver; see drivers/protocols.py"
    )


def _as_it_is(device: Any) -> Any:
    return device


def check(
    kind: str,
    config: Config,
    *,
    move: bool,
    pass_time: Callable[[float], None],
    only: Sequence[str] = (),
    wrap: Wrap = _as_it_is,
) -> Iterator[Checked]:
    """A finding for each contract of the kind, or for those that are named, as they are tried, each
    with a device of its own, which `wrap` may make do more.
    """
    source = getattr(config, kind).source
    if (nature := driver(kind, source).nature) != "real":
        raise UserError(
            f"check-driver: '{source}' is {nature}, which cannot be tried by itself; give the"
            " driver of a device"
        )
    must_not = "" if move else "the stage would move by up to 1 mm both ways; allow it with --move"
    patience = Patience()
    for contract in CONTRACTS[kind]:
        if only and str(contract) not in only:
            continue
        if patience.given_up:
            found = "not tried, the driver does not return from a call; mend that first"
            yield Checked(str(contract), found, False)
            continue
        if contract.moves and must_not:
            yield Checked(str(contract), f"not tried, {must_not}", False)
            continue
        means = {"pass_time": pass_time, "may_move": partial(bool, not must_not)}
        try:
            yield _finding(contract, config, means, wrap, patience)
        except NeverMade as error:
            yield problem(str(contract), str(error), needed=True)
            patience.given_up.add(source)
        except WrongScale as error:
            yield problem(str(contract), str(error), needed=True)
            must_not = must_not or f"{contract} is broken; mend that first"


def _finding(
    contract: Contract, config: Config, means: dict[str, Any], wrap: Wrap, patience: Patience
) -> Checked:
    def tried() -> None:
        device, more = _made(contract.kind, config, stack)
        stack.callback(_let_go, device)
        contract.check(wrap(device), **means, **more)

    source = getattr(config, contract.kind).source
    with ExitStack() as stack:
        try:
            if error := patience.aside(source, partial(_raised, tried), STEP_PATIENCE_S):
                raise error
        except (WrongScale, NeverMade):
            raise
        except NotTried as error:
            return Checked(str(contract), f"not tried: {error}", False)
        except (BrokenContract, DeviceError) as error:
            return problem(str(contract), str(error), needed=True)
        except Exception as error:  # of a driver that is being written
            what = f"{in_full(error)}; a driver raises DeviceError only"
            return problem(str(contract), what, needed=True)
    return Checked(str(contract), "", needed=True)


def _made(kind: str, config: Config, stack: ExitStack) -> tuple[Any, dict[str, Any]]:
    """A new device, and the clock that a camera sees: that of the bench's forces."""
    if kind != "camera":
        device = new_device(kind, config)
        return device, {"cut": lambda: cut_line(device), "dying_move": partial(_dying_move, config)}
    bench = make_bench(config, 1.0)
    stack.callback(_let_go, bench.forces)
    passed = 0

    def run_until(sample: int) -> None:
        nonlocal passed
        if not passed:
            bench.forces.open()
            bench.forces.start(TRAIN)
        while passed < sample:
            passed = bench.forces.read(READ_TIMEOUT_S).end

    return bench.camera, {"run_until": run_until, "end_clock": bench.forces.stop}


def _dying_move(config: Config, target_m: float, velocity_m_s: float) -> None:
    """Send the stage off from another process, and kill that while it moves."""
    process = start_process("app.processes.dying_move", (config, target_m, velocity_m_s))
    try:
        if (hello := wait_until_ready(process)) != MOVES:
            raise BrokenContract(f"in a process of its own, {hello}")
    finally:
        process.kill()
        process.wait()  # and no longer: what a driver has started may hold the pipes
        for pipe in filter(None, (process.stdin, process.stdout)):
            with suppress(OSError):
                pipe.close()


def _raised(check: Callable[[], None]) -> BaseException | None:
    """What a check raises; None where it raises nothing."""
    try:
        check()
    except BaseException as error:
        return error
    return None


def _let_go(device: Any) -> None:
    with suppress(Exception):  # what is wrong with it has been found
        Patience().aside("close", device.close)
