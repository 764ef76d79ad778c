"""The line to a Newport controller: opening it, noise on it, its death, and a stop that goes out
past everything else.
"""

import contextlib
import errno
import os
import sys
import threading
import time

import pytest
from newport_bench import PATIENT_S, Aside, waited_time
from processes.launched import wait_until

from drivers.clock import SampleClock
from drivers.emulators.serial_line import SerialLine, garbled
from drivers.errors import DeviceError, DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.settings import ActuatorSettings
from drivers.stages import newport_line
from drivers.stages.newport_stage import ConexCc, Smc100, find
from drivers.stages.port_lock import lock_file

WIRES = ["pty", "tcp"] if os.name == "posix" else ["tcp"]


@pytest.fixture
def waited(newport, monkeypatch):
    return waited_time(monkeypatch)


@pytest.fixture
def seconds(waited):
    """How long a driver waits in something that fails, and its error."""

    def of(work):
        began = waited.now
        with pytest.raises(DeviceError) as caught:
            work()
        return waited.now - began, caught.value

    return of


# ------------------------------------------------------------------ opening


@pytest.mark.parametrize("wire", WIRES)
def test_a_port_belongs_to_one_program(newport_open, wire):
    stage = newport_open(over=wire)
    second = Smc100(stage.settings, SampleClock(1000.0))
    before = len(stage.line.arrivals)
    with pytest.raises(DeviceFault, match=r"another program has .* open"):
        second.open()
    second.close()
    assert len(stage.line.arrivals) == before
    assert not stage.driver.is_moving()
    stage.driver.close()
    wait_until(lambda: opens(second))
    second.close()


def test_a_port_of_the_network_is_its_host_by_any_name_and_its_number():
    here = lock_file("socket://127.0.0.1:4001")
    assert lock_file("socket://localhost:4001") == here
    assert lock_file("socket://127.0.0.1:4002") != here  # of a server with several lines


def opens(driver):
    """Whether it opens now; the far end may still be saying goodbye to another."""
    try:
        driver.open()
    except DeviceFault:
        return False
    return True


@pytest.mark.parametrize(
    "port", ["no-such-port", "", "nonsense://here", "socket://127.0.0.1:1", "socket://nonsense"]
)
def test_a_port_that_is_not_there_is_told_with_those_that_are(port):
    with pytest.raises(
        DeviceNotFound,
        match=rf"SMC100: the port '{port}' cannot be opened .*serial ports of this computer: ",
    ):
        Smc100(ActuatorSettings(port=port), SampleClock(1000.0)).open()


def test_a_port_that_one_may_not_use_says_who_may(monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    if os.name != "posix":
        return
    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(DeviceFault, match="become a member of its group"):
        Smc100(ActuatorSettings(port="/dev/ttyS0"), SampleClock(1000.0)).open()


def test_without_pyserial_it_says_what_to_install(monkeypatch):
    for module in ("serial", "serial.tools", "serial.tools.list_ports"):
        monkeypatch.setitem(sys.modules, module, None)
    for ask in (Smc100(ActuatorSettings(port="COM3"), SampleClock(1000.0)).open, find):
        with pytest.raises(DeviceNotFound, match=r'pip install "pyserial>=3\.5"'):
            ask()


def test_a_port_with_nothing_behind_it_is_known_within_a_second(newport, seconds):
    stage = newport()
    stage.line.is_mute = True
    took, error = seconds(stage.driver.open)
    assert took < 1.0
    assert isinstance(error, DeviceTimeout)
    assert "check that the controller is on" in str(error)


@pytest.mark.parametrize(
    ("driver", "answer", "sentence"),
    [
        (Smc100, "1VE CONEX-CC 2.0.1", "'CONEX-CC 2.0.1'; use the driver of the CONEX-CC"),
        (
            ConexCc,
            "1VE SMC_CC - Controller-driver version  3. 1. 2",
            "use the driver of the SMC100",
        ),
        (
            Smc100,
            "ESP301 Version 3.0.1 6/1/99",
            "'ESP301 Version 3.0.1 6/1/99'; only SMC100CC and CONEX-CC are known",
        ),
        (Smc100, "\xff\xfe\xf0", "check port and baud"),
    ],
)
def test_another_device_on_the_port_is_told_as_what_it_says_it_is(
    newport, driver, answer, sentence
):
    stage = newport(driver)
    stage.device.answers["VE"] = answer
    with pytest.raises(DeviceNotFound) as caught:
        stage.driver.open()
    assert sentence in str(caught.value)
    with pytest.raises(DeviceFault, match="open it first"):
        stage.driver.is_moving()


# ------------------------------------------------------------------ noise


def test_damaged_answers_are_asked_for_again(newport_open):
    stage = newport_open()
    stage.device.answers["TP"] = ["1TP12\xf5", "?P12.5", "1TP12.5"]
    assert stage.driver.position_m() == pytest.approx(12.5e-3)
    assert len(stage.sent("TP")) == 3


def test_a_damaged_answer_makes_no_pause_longer(newport_open):
    stage = newport_open()
    pause_s = stage.driver._line.pause_s
    stage.device.answers["TE"] = ["1TE@", "?T\xf5", "1TE@"]
    stage.driver.set_velocity(10e-6)
    assert stage.sent("VA0.01") == ["1VA0.01"] * 2
    assert stage.driver._line.pause_s == pause_s


def test_late_answers_to_other_queries_are_passed_over(newport_open):
    stage = newport_open()
    stage.device.answers["TP"] = "1TS000028\r\n1TE@\r\n1TP12.25"
    assert stage.driver.position_m() == pytest.approx(12.25e-3)
    assert len(stage.sent("TP")) == 1


def test_an_answer_to_an_earlier_question_is_not_taken_for_that_to_the_present_one(newport_open):
    stage = newport_open()
    stage.device.answers["TP"] = ["1TP1\r\n1TP2", "1TP3"]
    assert stage.driver.position_m() == pytest.approx(1e-3)
    wait_until(lambda: stage.driver._line._port.in_waiting)
    assert stage.driver.position_m() == pytest.approx(3e-3)


def test_a_line_that_is_nothing_but_noise_is_a_fault(newport_open, seconds):
    stage = newport_open()
    stage.line.noise = garbled
    took, error = seconds(stage.driver.position_m)
    assert took < 1.0
    assert "'TP' was sent 3 times, the line" in str(error)
    stage.line.noise = lambda answer: answer
    assert stage.driver.position_m() == pytest.approx(12.5e-3)


def test_a_move_whose_acceptance_is_damaged_is_sent_again_and_moves_once(newport_open):
    stage = newport_open()
    stage.device.answers["TE"] = ["1TE@", "1T\xc5@", "1TE@", "1TEM"]
    stage.driver.move_to(13e-3)
    assert stage.sent("PA") == ["1PA13", "1PA13"]
    assert stage.driver.is_moving()
    assert stage.driver._line.pause_s == 0.01  # noise is not silence


def test_a_move_about_which_nothing_is_known_is_stopped(newport_open):
    stage = newport_open()
    stage.device.answers["TE"] = ["1TE@", "?"]
    with pytest.raises(DeviceFault, match="is noisy"):
        stage.driver.move_to(13e-3)
    stage.pass_time(1.0)
    wait_until(lambda: stage.sent("ST"))
    assert not stage.driver.is_moving()


# ------------------------------------------------------------------ a dead line


@pytest.mark.parametrize("wire", WIRES)
@pytest.mark.parametrize(
    "what", ["is_moving", "position_m", "stop", "describe", "move_to", "set_velocity", "home"]
)
def test_a_line_that_is_cut_during_a_move_is_a_fault_within_a_second(
    newport_open, seconds, wire, what
):
    stage = newport_open(over=wire)
    stage.driver.move_to(13e-3)
    stage.line.cut()
    arguments = {"move_to": [13e-3], "set_velocity": [1e-5]}.get(what, [])
    took, error = seconds(lambda: getattr(stage.driver, what)(*arguments))
    assert took < 1.0
    assert isinstance(error, DeviceFault)
    assert "is dead" in str(error)
    assert "a move under way ends by itself at its target" in str(error)


@pytest.mark.parametrize("wire", WIRES)
def test_a_line_that_is_cut_while_an_answer_is_awaited_is_a_fault_within_a_second(
    newport_open, seconds, monkeypatch, wire
):
    stage = newport_open(over=wire)
    for patience in ("ANSWER_S", "PATIENCE_S"):  # it is not given up before it is cut
        monkeypatch.setattr(newport_line, patience, 1e4)
    stage.line.is_mute = True
    waiting = Aside(stage.driver.position_m)
    wait_until(lambda: stage.sent("TP"))
    stage.line.cut()
    took, error = seconds(waiting.join)
    assert took < 1.0
    assert isinstance(error, DeviceFault)


@pytest.mark.parametrize("what", ["is_moving", "stop", "move_to"])
def test_a_controller_that_falls_silent_is_known_within_a_second_even_from_two_threads(
    newport_open, seconds, what
):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.line.is_mute = True
    arguments = {"move_to": [13e-3]}.get(what, [])
    other = Aside(stage.driver.position_m)
    took, error = seconds(lambda: getattr(stage.driver, what)(*arguments))
    assert took < 1.0
    assert isinstance(error, DeviceTimeout)
    with pytest.raises(DeviceTimeout):
        other.join()


@pytest.mark.skipif(os.name != "posix", reason="the flow of a network port is never held")
def test_a_line_that_is_held_by_xoff_is_known_within_a_second(newport_open, seconds):
    stage = newport_open(over="pty")
    stage.line.noise = lambda answer: b"\x13" + answer
    # the line may be held before the query is seen to be out
    with contextlib.suppress(DeviceFault):
        stage.driver.position_m()
    took, error = seconds(lambda: [stage.driver.stop() for _ in range(2)])
    assert took < 1.0
    assert isinstance(error, DeviceFault | DeviceTimeout)


def test_closing_a_dead_line_tells_once_that_the_stage_may_still_move(newport_open):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.line.cut()
    with pytest.raises(DeviceFault, match="ends by itself at its target"):
        stage.driver.close()
    stage.driver.close()
    again = newport_open()
    again.driver.move_to(13e-3)
    again.line.cut()
    with pytest.raises(DeviceFault):
        again.driver.stop()
    again.driver.close()


# ------------------------------------------------------------------ stop


@pytest.mark.parametrize("wire", WIRES)
def test_a_stop_goes_out_while_an_answer_is_awaited(newport_open, wire):
    stage = newport_open(over=wire)
    stage.driver.move_to(13e-3)
    stage.line.think_s = 2.0
    waiting = Aside(stage.driver.position_m)
    wait_until(lambda: stage.sent("TP"))
    stage.line.think_s = 0.0
    stage.driver.stop()
    waiting.join()
    arrived = {command: when for when, command in stage.line.arrivals}
    assert arrived[b"1ST"] - arrived[b"1TP"] < 2.0
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


def test_a_stop_comes_before_the_queries_that_wait(newport_open, monkeypatch):
    monkeypatch.setattr(newport_line, "ANSWER_S", 30.0)  # the one under way is not asked again
    stage = newport_open()
    stage.driver.move_to(13e-3)
    stage.device.hold("TP")
    before = len(stage.sent("TP"))
    waiting = [Aside(stage.driver.position_m) for _ in range(4)]
    wait_until(lambda: len(stage.sent("TP")) > before)
    stopping = Aside(stage.driver.stop)
    wait_until(lambda: stage.driver._line._urgent)
    stage.device.let_go.set()
    stopping.join()
    for each in waiting:
        each.join()
    commands = [command for _, command in stage.line.arrivals]
    stopped = commands.index(b"1ST")
    once_or_twice = commands[stopped:].count(b"1ST")  # again if it may not have listened
    following = [b"1TP", *[b"1ST"] * once_or_twice, b"1TS"]
    assert commands[stopped - 1 : stopped + 1 + once_or_twice] == following
    assert commands[stopped:].count(b"1TP") == 3


def test_no_byte_of_a_stop_comes_between_those_of_another_command(newport_open, monkeypatch):
    stage = newport_open()
    stage.driver.move_to(13e-3)
    write = newport_line.write_whole
    wrote, is_half, is_second = [], threading.Event(), threading.Event()

    def slowly(port, sent):
        if is_half.is_set():
            is_second.set()
        wrote.append(sent[:2])
        write(port, sent[:2])
        if not is_half.is_set():
            is_half.set()
            is_second.wait(0.5)  # long enough for one that waits for nothing
        wrote.append(sent[2:])
        write(port, sent[2:])

    monkeypatch.setattr(newport_line, "write_whole", slowly)
    asking = Aside(stage.driver.position_m)
    assert is_half.wait(PATIENT_S)
    stage.driver.stop()
    asking.join()
    assert wrote[:4] == [b"1T", b"P\r\n", b"1S", b"T\r\n"]
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


def test_a_stop_that_may_come_too_early_is_sent_again_once_the_controller_listens(
    waited, newport_open, monkeypatch
):
    line = newport_open().driver._line
    sent, write = [], newport_line.write_whole
    monkeypatch.setattr(
        newport_line,
        "write_whole",
        lambda port, part: (sent.append((waited.now, part)), write(port, part)),
    )
    line._clear_at = listens_at = waited.now + 0.1  # after a command sent with a long pause
    line.stop()
    assert [part for _, part in sent] == [b"1ST\r\n"] * 2
    assert sent[0][0] < listens_at <= sent[1][0]
    line._clear_at = 0.0
    line.stop()
    assert len(sent) == 3


def test_a_move_that_a_stop_overtakes_is_never_sent(newport_open):
    stage = newport_open()
    stage.device.hold("TE")
    moving = Aside(lambda: stage.driver.move_to(13e-3))
    wait_until(lambda: stage.driver._line._is_taken)
    stopping = Aside(stage.driver.stop)
    wait_until(lambda: stage.driver._line.stops)
    stage.device.let_go.set()
    stopping.join()
    moving.join()
    assert not stage.sent("PA")
    assert not stage.driver.is_moving()
    stage.driver.move_to(13e-3)
    assert stage.driver.is_moving()


def test_a_stop_on_a_line_as_slow_as_57600_baud_takes_one_round_trip(newport_open):
    stage = newport_open(line={"byte_s": 10 / 57600})
    stage.driver.move_to(13e-3)
    polling = Aside(lambda: [stage.driver.position_m() for _ in range(300)])
    began = time.monotonic()
    stage.driver.stop()
    polling.join()
    when = next(when for when, command in stage.line.arrivals if command == b"1ST")
    assert when - began < 1.0  # less than all those queries take
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


@pytest.mark.parametrize("held", ["TE", "VA0.01"])
def test_a_velocity_during_which_a_stop_comes_is_not_blamed_for_it(newport_open, held):
    stage = newport_open()
    stage.device.hold(held)
    setting = Aside(lambda: stage.driver.set_velocity(10e-6))
    wait_until(lambda: stage.device.held is None)
    stopping = Aside(stage.driver.stop)  # refused, for nothing moves
    wait_until(lambda: stage.driver._line.stops)
    stage.device.let_go.set()
    stopping.join()
    setting.join()
    assert stage.controller.parameters["VA"] == pytest.approx(0.01)


def test_a_strict_controller_takes_every_command_sent_apart(newport):
    # characters after a command's end in the same transfer are ignored: SMC100 manual, 6.3
    stage = newport(line={"deaf_s": 0.004, "byte_s": 10 / 57600}).opened()
    stage.driver.set_velocity(10e-6)
    stage.driver.move_to(13e-3)
    assert stage.driver.is_moving()
    assert stage.controller.parameters["VA"] == pytest.approx(0.01)
    polling = Aside(lambda: [stage.driver.position_m() for _ in range(20)])
    stage.driver.stop()
    polling.join()
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()
    assert all(command[:1] == b"1" for _, command in stage.line.arrivals)


@pytest.mark.parametrize("deaf_ms", [15, 30, 60, 100])
def test_a_controller_that_needs_long_to_interpret_a_command_is_used(newport, monkeypatch, deaf_ms):
    monkeypatch.setattr(newport_line, "ANSWER_S", 1.0)  # a busy computer may be late
    stage = newport(line={"deaf_s": deaf_ms * 1e-3, "byte_s": 10 / 57600})
    stage.driver.open()
    stage.driver.make_ready()
    for velocity in (1, 2, 3, 4, 5, 10):
        stage.driver.set_velocity(velocity * 1e-6)
    stage.driver.move_to(13e-3)
    assert stage.driver.is_moving()
    assert stage.controller.parameters["VA"] == pytest.approx(0.01)
    # the pause that was found is kept: of 9 commands two at most, at two longer ones, came again
    assert len(stage.sent("SL0") + stage.sent("SR25") + stage.sent("VA0") + stage.sent("PA")) <= 11
    stage.driver.stop()
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


def test_the_pause_of_the_settings_is_that_of_the_first_sending(newport):
    stage = newport(line={"deaf_s": 0.02}, command_pause=0.15).opened()
    stage.driver.set_velocity(10e-6)
    assert stage.sent("VA0.01") == ["1VA0.01"]
    assert not stage.line.ignored


def test_a_controller_deaf_for_longer_than_can_be_waited_is_told_with_the_setting(newport, seconds):
    stage = newport(line={"deaf_s": PATIENT_S})
    stage.driver.open()
    took, error = seconds(stage.driver.make_ready)
    assert took < 1.0
    assert isinstance(error, DeviceTimeout)
    assert "gave no answer to 'SL0' within 0.6 s" in str(error)
    assert "raise actuator.command_pause if it needs longer" in str(error)


def test_repetitions_with_their_pauses_fit_in_what_a_query_may_take():
    for first_s in (0.001, 0.01, 0.05, 0.15):
        used_s, sent = 0.0, 0
        for pause_s in newport_line.pauses_s(first_s):
            if used_s + pause_s + newport_line.LEAST_ANSWER_S <= newport_line.PATIENCE_S:
                used_s, sent = used_s + pause_s + newport_line.LEAST_ANSWER_S, sent + 1
        assert sent >= 2, first_s
        assert sent == 3 or first_s > 0.01, first_s


def test_stopping_before_open_and_after_close_does_nothing(newport):
    stage = newport()
    stage.driver.stop()
    stage.driver.open()
    stage.driver.close()
    stage.driver.stop()
    assert not stage.sent("ST")


def test_a_line_of_its_own_baud(newport):
    stage = newport(ConexCc, over=WIRES[0], baud=115200)
    stage.driver.open()
    assert stage.driver._line._port.baudrate == 115200
    assert SerialLine(stage.device).url == ""
