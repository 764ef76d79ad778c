"""What is written to the line of a Newport controller: all of it, each byte once, however late."""

import contextlib
import os
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from types import SimpleNamespace

import pytest
from newport_bench import waited_time
from processes.launched import wait_until

from drivers import turns
from drivers.errors import DeviceFault, DeviceTimeout
from drivers.stages import newport_line


@pytest.mark.skipif(os.name != "posix", reason="Windows itself counts what a port has taken")
def test_a_command_that_was_written_late_was_written(newport, monkeypatch):
    stage, write = newport(over="pty").opened(), os.write

    def late(file, sent):
        taken = write(file, sent)
        time.sleep(1.1 * newport_line.TAKES_S)  # other programs have their turns
        return taken

    stage.driver.move_to(13e-3)
    monkeypatch.setattr(os, "write", late)
    stage.driver.stop()
    monkeypatch.undo()
    wait_until(lambda: stage.sent("ST"))
    stage.pass_time(1.0)
    assert not stage.driver.is_moving()


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_an_answer_that_came_while_the_program_had_no_turn_is_read(newport, monkeypatch):
    stage, write, is_asked = newport(over="pty").opened(), os.write, threading.Event()

    def late(file, sent):
        taken = write(file, sent)
        if sent.endswith(b"TP\r\n"):
            is_asked.set()
            with line.clock._lock:  # no thread of the program has a turn
                time.sleep(1.1)
        return taken

    line, place = stage.driver._ready(), "([0-9.]+)"
    read, reads = line._port.read_until, count()

    def beside_another(end):
        if not next(reads):
            wait_until(lambda: line._turns._waiters or second.done())
        return read(end)

    monkeypatch.setattr(newport_line, "PATIENCE_S", 1.0)
    monkeypatch.setattr(newport_line, "ANSWER_S", 2.0)
    monkeypatch.setattr(os, "write", late)
    monkeypatch.setattr(line._port, "read_until", beside_another)
    with ThreadPoolExecutor() as others:
        # its time ended before it was sent: what has come is read all the same
        first = others.submit(line.ask, "TP", place, give_up=line.clock.read() - 1.0)
        assert is_asked.wait(60)
        # its second ends meanwhile: the program had no turn; it waits until the line is free
        second = others.submit(line.ask, "TP", place)
        assert (first.result(), second.result()) == ("12.5", "12.5")
    monkeypatch.undo()


def test_a_controller_has_that_time_again_in_which_the_program_had_no_turn(newport, monkeypatch):
    """An emulated controller has turns when its bench has: it was blamed for a busy computer."""
    stage = newport().opened()
    line, waits = stage.driver._ready(), [0.5, 0.5, 0.5]
    read = line._port.read_until

    def late(end):
        if not waits:
            return read(end)
        time.sleep(waits.pop())
        return b""

    monkeypatch.setattr(newport_line, "PATIENCE_S", 0.6)
    monkeypatch.setattr(newport_line, "ANSWER_S", 0.2)
    monkeypatch.setattr(line._port, "read_until", late)
    assert line.ask("TP", "([0-9.]+)") == "12.5"
    assert not waits


class DeafPort(SimpleNamespace):
    """That of a controller that needs 40 ms for an answer and hears nothing for 60 ms after a
    command without one; `now` is the time of the driver.
    """

    def __init__(self):
        self.commands, self.answer = [], b""
        self.now = self.deaf_until = self.due = 0.0
        self._socket, self.monotonic = self, lambda: self.now

    def sleep(self, seconds):
        self.now += seconds

    def send(self, sent):
        if self.now >= self.deaf_until and sent in (b"1TE\r\n", b"1VE\r\n"):
            self.due, self.answer = self.now + 0.04, sent.replace(b"\r", b"@\r")
        elif self.now >= self.deaf_until:
            self.commands.append(sent)
            self.deaf_until = self.now + 0.06
        return len(sent)

    def read_until(self, end):
        is_due = self.now <= self.due <= self.now + newport_line.READ_S
        self.now = self.due if is_due else self.now + newport_line.READ_S
        return self.answer * is_due

    def reset_input_buffer(self):
        self.due = -1.0


def test_a_controller_that_is_slow_and_deaf_is_found_and_its_pause_kept(monkeypatch):
    port = DeafPort()
    monkeypatch.setattr(newport_line, "_claimed", lambda *_, **__: port)
    monkeypatch.setattr(newport_line, "time", port)
    line = newport_line.NewportLine("SMC100", "COM3", 1, 57600)
    line.clock = SimpleNamespace(read=lambda longest_s=0.0: port.now)
    assert line.tell("VA0.1") == "@"
    assert port.now < 0.8
    assert line.pause_s == 0.15
    assert port.commands == [b"1VA0.1\r\n"] * 3
    line.tell("VA0.2")
    assert port.commands[3:] == [b"1VA0.2\r\n"]


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("over", "comes", "each_s", "within_s"),
    [
        ("pty", b"1TS000033\r\n", 0.005, 30),
        ("pty", b"x", 0.005, 30),
        ("", b"\xff", 0.04, 5),  # as of a line without a shield: it took ten seconds
    ],
)
def test_a_line_on_which_others_talk_does_not_keep_a_query_waiting(
    newport_open, monkeypatch, over, comes, each_s, within_s
):
    line = newport_open(over=over).driver._ready()
    monkeypatch.setattr(newport_line, "PATIENCE_S", 0.6)
    monkeypatch.setattr(newport_line, "ANSWER_S", 0.2)
    monkeypatch.setattr(line._port, "read_until", lambda end: (time.sleep(each_s), comes)[1])
    began = time.monotonic()
    with pytest.raises(DeviceFault, match=r"the line .* is noisy"):
        line.ask("TP", "([0-9.]+)")
    assert time.monotonic() - began < within_s
    monkeypatch.undo()


def test_a_controller_that_answers_too_late_is_not_called_noisy_alone(newport):
    stage = newport().opened()
    stage.device.answers["TP"] = stage.device.answers["TE"] = "1TS000028"  # to the query before
    told = "is noisy or slow: the last answer, to another query, was '1TS000028'; check what holds"
    with pytest.raises(DeviceFault, match=told):
        stage.driver.position_m()
    with pytest.raises(DeviceFault, match=told):
        stage.driver.set_velocity(10e-6)
    stage.device.answers["TP"] = "1TP\xf5"
    with pytest.raises(DeviceFault, match="is noisy: the last answer was"):
        stage.driver.position_m()


class Hesitant:
    """A socket that takes two bytes at a time, and none of them at each other time."""

    def __init__(self):
        self.taken, self._pair, self._waits = b"", socket.socketpair(), False

    def fileno(self):
        return self._pair[0].fileno()

    def send(self, sent):
        self._waits = not self._waits
        if self._waits:
            raise BlockingIOError
        self.taken += sent[:2]
        return len(sent[:2])

    def close(self):
        for end in self._pair:
            end.close()


def test_a_port_that_takes_a_command_in_parts_gets_each_byte_once_or_is_dead():
    with contextlib.closing(Hesitant()) as port:
        port._socket = port
        newport_line.write_whole(port, b"1ST\r\n")
        assert port.taken == b"1ST\r\n"
        with pytest.raises(TimeoutError, match="it did not take all of it"):
            newport_line.write_whole(port, b"1PA12.5\r\n" * 2)
        assert port.taken == b"1ST\r\n1PA12."


class HeldUp:
    """A way to a port whose controller takes nothing, as after XOFF."""

    is_closed = False

    def __init__(self, looks):
        self._looks = iter(looks)  # what waits at each look

    @property
    def out_waiting(self):
        return next(self._looks)

    def close(self):
        self.is_closed = True


def test_a_stop_from_outside_that_is_held_up_is_not_called_sent(monkeypatch):
    way, written = HeldUp([5, 5, 5, 5, 5, 5, 5, 0]), []
    monkeypatch.setattr(newport_line, "_claimed", lambda *_, **__: way)
    monkeypatch.setattr(newport_line, "time", SimpleNamespace(sleep=lambda _: None))
    monkeypatch.setattr(newport_line, "write_whole", lambda _, sent: written.append(sent))
    stopper = newport_line.OutsideStop("SMC100", "COM3", 57600, 1)
    with pytest.raises(DeviceFault, match=r"holds up what is sent to it \(XOFF\)") as caught:
        stopper.stop()
    assert way.is_closed
    said = str(caught.value)
    assert said.startswith("SMC100: 'ST' was written to COM3, and the controller has not taken it")
    assert "watch the stage" in said
    assert "dead" not in said
    stopper.stop()  # taken in the last of the waits
    assert written == [b"1ST\r\n"] * 6


def test_who_waits_for_the_line_looks_at_the_clock_before_it_stops_counting(newport, monkeypatch):
    line, waits = newport().opened().driver._ready(), []

    def waited(is_free, patience_s):
        waits.append(patience_s)
        return is_free()

    monkeypatch.setattr(line._turns, "wait_for", waited)
    with line._turn(line.clock.read() + 1.0):
        late = line._turn(line.clock.read() + 0.3)
        with pytest.raises(DeviceTimeout, match="no answer to 'an earlier query'"), late:
            pass
    assert len(waits) > 1
    assert max(waits) <= turns.LONGEST_S / 2


@pytest.mark.parametrize(("came", "asked"), [(5, 2), (-1, 1)])
def test_an_answer_whose_digits_did_not_all_come_in_time_is_asked_for_again(
    newport, monkeypatch, came, asked
):
    waited_time(monkeypatch)
    stage = newport().opened()
    send, lengths = stage.line._wire.send, [came]
    stage.line._wire.send = lambda answer: send(answer[: lengths.pop() if lengths else None])
    assert stage.driver.position_m() == pytest.approx(12.5e-3)  # and not 12 mm
    assert len(stage.sent("TP")) == asked
