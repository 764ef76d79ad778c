"""What every driver of a stage must do; see `drivers.contracts`."""

from __future__ import annotations

import math
import os
import pickle
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from drivers.answers import check_moves, check_position
from drivers.contract import (
    NEW,
    PATIENCE_S,
    BrokenContract,
    NotTried,
    WrongScale,
    contract,
    has_all_of,
    named,
    refused,
    that,
)
from drivers.errors import DeviceError, OutOfLimits
from drivers.protocols import Actuator

STOP_S = 1.0  # a stop takes less, whatever else the driver does
STOPS = 100  # most stops that are sent beside the queries of another thread

Pass = Callable[[float], None]


def _begun(actuator: Actuator) -> float:
    """Where a move of 1 mm at 100 um/s, which is under way now, began."""
    start = actuator.position_m()
    actuator.set_velocity(100e-6)
    actuator.move_to(start + 1e-3)
    return start


@contract("actuator", given=NEW)
def _it_is_an_actuator(actuator: Any) -> None:
    has_all_of(actuator, Actuator)
    low, high = actuator.travel_limits_m
    that(low < high, f"its travel is from {low} to {high} m")
    that(actuator.velocity_limit_m_s > 0, f"velocity_limit_m_s = {actuator.velocity_limit_m_s}")


@contract("actuator")
def _its_position_lies_within_its_travel(actuator: Actuator) -> None:
    check_moves(actuator.name, actuator.is_moving())
    place, (low, high) = actuator.position_m(), actuator.travel_limits_m
    place = check_position(actuator.name, place)
    if not low - 1e-3 <= place <= high + 1e-3:
        raise WrongScale(
            f"its position is {place:.6g} m and its travel {low:.6g} to {high:.6g} m; positions are"
            " in metres: check the scale of position_m(), and actuator.travel"
        )


@contract("actuator", moves=True)
def _it_moves_at_about_the_velocity_asked(actuator: Actuator, pass_time: Pass) -> None:
    start = actuator.position_m()
    actuator.set_velocity(50e-6)
    actuator.move_to(start + 1e-3)
    pass_time(2.0)
    gone = actuator.position_m() - start
    share = gone / 100e-6
    actuator.stop()
    pass_time(1.0)  # to come to rest before the next contract
    if not 0.5 < share < 2.0:
        raise WrongScale(
            f"it has gone {share * 100:.4g} um by position_m() after 2 s at 50 um/s, {share:.3g}"
            " times what was asked; check the scale and the sign of set_velocity(), move_to() and"
            " position_m(), which count in metres"
        )
    off_um = gone * 1e6 - 100.0
    that(abs(off_um) <= 10.0, f"it is {off_um:+.2f} um off where it should be")


@contract("actuator", moves=True)
def _a_move_ends_by_itself_at_its_target(actuator: Actuator, pass_time: Pass) -> None:
    start = actuator.position_m()
    that(not actuator.is_moving(), "it moves as soon as it is open")
    for target in (start + 200e-6, start - 100e-6):
        actuator.set_velocity(100e-6)
        actuator.move_to(target)
        that(actuator.is_moving(), "it does not move after move_to()")
        pass_time(0.5)
        that(actuator.is_moving(), "a move of 2 s or more ended within 0.5 s")
        pass_time(5.0)
        that(not actuator.is_moving(), "a move of 3 s or less did not end within 5.5 s")
        _is_at(actuator, target, 1e-6)


@contract("actuator", moves=True)
def _stop_ends_the_motion_now(actuator: Actuator, pass_time: Pass) -> None:
    actuator.stop()
    start = _begun(actuator)
    pass_time(1.0)
    actuator.stop()
    actuator.stop()
    stopped = actuator.position_m()
    that(start < stopped < start + 1e-3, f"it stopped after {(stopped - start) * 1e6:.1f} um")
    pass_time(1.0)
    that(not actuator.is_moving(), "it moves 1 s after stop()")
    _is_at(actuator, stopped, 1e-6)


@contract("actuator", moves=True)
def _stop_returns_soon_from_any_thread_also_during_a_query(
    actuator: Actuator, pass_time: Pass
) -> None:
    _begun(actuator)
    pass_time(0.5)  # away from 0, which the answer to a stop may be taken for
    took_s = []
    for _ in range(3):
        began = time.monotonic()
        actuator.stop()
        took_s.append(time.monotonic() - began)
        if took_s[-1] < STOP_S:
            break
    that(took_s[-1] < STOP_S, f"stop() took {min(took_s):.1f} s, {STOP_S:g} s is the most")
    pass_time(0.5)
    stands = actuator.position_m()
    readings: list[float] = []
    problems: list[Exception] = []
    over = threading.Event()

    def query() -> None:
        try:
            while not over.is_set():
                readings.append(actuator.position_m())
                actuator.is_moving()
        except Exception as error:  # whatever a mixture of two answers leads to
            problems.append(error)

    asking = threading.Thread(target=query, name="contract", daemon=True)
    asking.start()
    try:
        for n in range(STOPS):
            if problems:
                break
            time.sleep(n % 5 * 1e-3)  # the two threads must not keep in step
            actuator.stop()
    except Exception as error:  # as above
        problems.append(error)
    over.set()
    asking.join(PATIENCE_S)
    beside = "with stop() and position_m() called from two threads"
    cure = "came; it needs a lock around a question and its answer"
    if problems:
        raise BrokenContract(f"{beside}, {named(problems[0])} {cure}")
    for place in readings:
        is_there = abs(place - stands) <= 5e-6
        that(is_there, f"{beside}, a position of {place * 1e3:.6g} mm {cure}")
    that(not asking.is_alive(), f"{beside}, position_m() did not return")


@contract("actuator", moves=True, given=NEW)
def _a_move_ends_at_its_target_although_the_program_dies(
    actuator: Actuator, pass_time: Pass, dying_move: Callable[[float, float], None]
) -> None:
    actuator.open()
    actuator.stop()  # what a broken contract before this one may have left moving
    pass_time(0.5)
    start = actuator.position_m()
    actuator.close()
    target = start + 200e-6
    dying_move(target, 100e-6)
    pass_time(4.0)
    actuator.open()
    moves, place = actuator.is_moving(), actuator.position_m()
    actuator.stop()
    beyond = f"its program was killed in a move of 2 s, and 4 s later it {'moves' * moves}"
    beyond += f"{'stands' * (not moves)} {(place - target) * 1e6:+.1f} um from the target"
    that(not moves and start - 1e-6 <= place <= target + 1e-6, beyond)
    actuator.close()


@contract("actuator", given=NEW)
def _another_process_can_stop_it(
    actuator: Actuator, pass_time: Pass, may_move: Callable[[], bool]
) -> None:
    if not hasattr(actuator, "stopper"):
        raise NotTried(
            "it has no stopper(), so that no supervisor stops the stage if the program dies or"
            " hangs; a move then ends at its target only"
        )
    actuator.open()
    outside = pickle.loads(pickle.dumps(actuator.stopper()))
    if may_move():
        start = _begun(actuator)
        outside.stop()
        pass_time(1.0)
        # the first answers may be those that the other process was given
        moves = [actuator.is_moving() for _ in range(3)]
        that(not moves[-1], "it moves 1 s after the stop() of its stopper()")
        gone = actuator.position_m() - start
        that(gone < 0.9e-3, f"it went {gone * 1e6:.1f} um of 1000 after the stop of its stopper()")
    actuator.close()


@contract("actuator", given=NEW)
def _a_dead_line_is_a_device_error(actuator: Actuator, cut: Callable[[], None]) -> None:
    actuator.open()
    actuator.position_m()
    cut()
    for what in ("position_m", "is_moving", "stop"):
        try:
            with refused(DeviceError, f"{what}() with its line cut"):
                getattr(actuator, what)()
        except BrokenContract:
            raise
        except Exception as error:
            found = f"{what}() with its line cut raises {named(error)}"
            raise BrokenContract(f"{found}; a driver raises DeviceError only") from error
    try:
        with suppress(DeviceError):
            actuator.close()
        actuator.close()
    except Exception as error:
        found = f"close() with its line cut raises {named(error)}"
        cure = "the first lets go of the port, even if stop() fails, and a second does nothing"
        raise BrokenContract(f"{found}; {cure}") from error


def cut_line(device: object) -> None:
    """Let the line of a device that is open die, as if its cable were pulled out.

    Raises
    ------
    NotTried
        It is neither a serial port nor a socket that the driver holds, or the operating system has
        no way.
    """
    found = _lines(device, 2) if os.name == "posix" else set()
    if not found:
        raise NotTried(
            "its line cannot be cut from here; pull its cable out in a run on which nothing"
            " depends, and see that the run ends with a sentence of the driver's own"
        )
    near, far = socket.socketpair()
    far.close()
    with near:
        for number in found:
            os.dup2(near.fileno(), number)


def _lines(holder: object, depth: int) -> set[int]:
    """Numbers of the open files of what can be written to, within an object."""
    found: set[int] = set()
    for held in vars(holder).values() if hasattr(holder, "__dict__") else ():
        if hasattr(held, "fileno") and (hasattr(held, "write") or hasattr(held, "send")):
            try:
                found.add(int(held.fileno()))
            except Exception:  # it is closed, or is no file at all
                continue
        elif depth > 1:
            found |= _lines(held, depth - 1)
    return {number for number in found if number > 2}


@contract("actuator", moves=True)
def _what_is_out_of_limits_changes_nothing(actuator: Actuator, pass_time: Pass) -> None:
    low, high = actuator.travel_limits_m
    start = actuator.position_m()
    for target in (low - 1e-3, high + 1e-3, math.nan):
        with refused(OutOfLimits, f"a move to {target * 1e3:g} mm"):
            actuator.move_to(target)
        that(not actuator.is_moving(), f"it moves after a refused move to {target * 1e3:g} mm")
    actuator.set_velocity(20e-6)  # at which a late answer shifts it little
    for velocity in (0.0, -1e-6, 2 * actuator.velocity_limit_m_s, math.nan):
        with refused(OutOfLimits, f"a velocity of {velocity * 1e6:g} um/s"):
            actuator.set_velocity(velocity)
    actuator.move_to(start + 100e-6)
    pass_time(0.5)
    _is_at(actuator, start + 10e-6, 5e-6)


@contract("actuator", given=NEW)
def _moves_out_of_order_are_a_device_error(actuator: Actuator) -> None:
    with refused(DeviceError, "move_to() before open()"):
        actuator.move_to(0.0)
    with refused(DeviceError, "set_velocity() before open()"):
        actuator.set_velocity(1e-6)
    with refused(DeviceError, "position_m() before open()"):
        actuator.position_m()


@contract("actuator", moves=True, given=NEW)
def _close_stops_and_may_come_at_any_time_and_twice(actuator: Actuator, pass_time: Pass) -> None:
    actuator.close()
    actuator.open()
    actuator.set_velocity(10e-6)
    start, began = actuator.position_m(), time.monotonic()
    actuator.move_to(start + 1e-3)
    actuator.close()
    gone = 10e-6 * (time.monotonic() - began)
    actuator.close()
    pass_time(1.0)
    actuator.open()
    _is_at(actuator, start, 1e-6 + gone)
    actuator.close()


def _is_at(actuator: Actuator, expected_m: float, tolerance_m: float) -> None:
    off_m = actuator.position_m() - expected_m
    that(abs(off_m) <= tolerance_m, f"it is {off_m * 1e6:+.2f} um off where it should be")
