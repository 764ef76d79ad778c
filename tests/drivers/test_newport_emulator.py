"""The emulated controller by itself: what its manual says it answers, how its stage moves, and what
can happen to its line.
"""

import contextlib
import socket
import time

import pytest
from free_stage import FreeStage
from processes.launched import wait_until
from worlds import scenario

from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine, garbled
from drivers.emulators.stages import WorldStage
from drivers.sim.world import World


class Clock:
    """Time that a test turns."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def controller(clock):
    return Controller(FreeStage(clock))


def told(controller, *commands):
    """The answer to the last of the commands."""
    return [controller.answer(f"1{command}".encode()).decode() for command in commands][-1]


def test_queries_echo_address_and_command(controller):
    assert told(controller, "TP") == "1TP12.5"
    assert told(controller, "TS") == "1TS000032"
    assert told(controller, "VA?") == "1VA1"
    assert told(controller, "VE").startswith("1VE SMC_CC")
    assert told(controller, "SR?") == "1SR25"


def test_setters_answer_nothing_and_other_addresses_are_not_heard(controller):
    assert told(controller, "VA0.5") == ""
    assert controller.answer(b"2TP") == b""
    assert controller.answer(b"2VA0.1") == b""
    assert told(controller, "VA?") == "1VA0.5"


@pytest.mark.parametrize(
    ("state", "command", "letter"),
    [
        (0x32, "XY1", "A"),
        (0x32, "PA", "C"),
        (0x32, "VA2", "C"),
        (0x32, "SL1", "C"),
        (0x32, "PA26", "G"),
        (0x0A, "PA1", "H"),
        (0x0A, "VA1", "H"),
        (0x14, "PA1", "I"),
        (0x3D, "PA1", "J"),
        (0x32, "OR", "K"),
        (0x32, "ST", "K"),
        (0x1E, "PA1", "L"),
        (0x1E, "OR", "E"),
        (0x28, "PA1", "M"),
        (0x28, "MM0", "M"),
    ],
)
def test_what_a_state_does_not_allow_is_kept_until_te_reads_it(controller, state, command, letter):
    controller.stage.move(20.0, 1.0, 20.0)
    controller.state = state
    assert told(controller, command, "TP", "TE") == f"1TE{letter}"
    assert told(controller, "TE") == "1TE@"


def test_a_stage_outside_its_soft_limits_does_not_move(controller):
    assert told(controller, "SR10", "PA5", "TE") == "1TEN"


def test_a_move_has_a_trapezoid_profile(controller, clock):
    # 2 s and 1 mm to speed up, 5.5 mm at 1 mm/s, 2 s and 1 mm to slow down
    told(controller, "AC0.5", "VA1", "PA20")
    for t, place in [
        (0, 12.5),
        (1, 12.75),
        (2, 13.5),
        (4.5, 16.0),
        (7.5, 19.0),
        (8.5, 19.75),
        (9.5, 20.0),
        (99, 20.0),
    ]:
        clock.now = t
        assert controller.stage.position() == pytest.approx(place, abs=1e-9)
        assert told(controller, "TS") == ("1TS000028" if t < 9.5 else "1TS000033")


def test_a_short_move_never_gets_to_its_velocity(controller, clock):
    told(controller, "AC0.5", "VA1", "PA12")  # back by 0.5 mm: 1 s and 0.25 mm each way
    for t, place in [(1, 12.25), (1.999, 12.0), (2.001, 12.0)]:
        clock.now = t
        assert controller.stage.position() == pytest.approx(place, abs=1e-6)


def test_st_slows_down_and_stands(controller, clock):
    told(controller, "AC0.5", "VA1", "PA20")
    clock.now = 4.5
    told(controller, "ST")
    clock.now = 5.5
    assert told(controller, "TS") == "1TS000028"
    clock.now = 6.5
    assert told(controller, "TS") == "1TS000033"
    assert controller.stage.position() == pytest.approx(17.0)


def test_an_end_switch_ends_the_move_and_the_reference(clock):
    controller = Controller(FreeStage(clock, ends=(12.0, 13.0)))
    told(controller, "PA20")
    clock.now = 0.1
    assert told(controller, "TS") == "1TS000028"
    clock.now = 1.0
    assert told(controller, "TS") == "1TS00020F"
    assert told(controller, "TS") == "1TS00000F"  # reading clears
    assert controller.stage.position() == 13.0


def test_a_stage_that_sticks_is_a_following_error_once_its_profile_is_too_far_ahead(clock):
    controller = Controller(FreeStage(clock, sticks_at=12.6))
    told(controller, "VA0.005", "PA13")
    clock.now = 21.0  # 5 um beyond, of the 10 um that are allowed
    assert told(controller, "TS") == "1TS000028"
    assert told(controller, "TP") == "1TP12.6"
    clock.now = 23.0
    assert told(controller, "TS") == "1TS00203D"
    assert told(controller, "MM1", "TS") == "1TS000034"


def test_after_power_on_it_counts_from_where_it_stands_until_it_is_homed(clock):
    controller = Controller(FreeStage(clock), is_referenced=False)
    assert told(controller, "TP") == "1TP0"
    assert told(controller, "OR", "TS") == "1TS00001E"
    clock.now = 60.0
    assert told(controller, "TS") == "1TS000032"
    assert told(controller, "TP") == "1TP0"
    assert controller.stage.position() == 0.0
    assert told(controller, "RS", "TS") == "1TS00000A"


def test_homing_can_fail_and_can_be_stopped(clock):
    controller = Controller(FreeStage(clock), is_referenced=False)
    assert told(controller, "OR", "ST", "TS") == "1TS00000B"
    controller.can_home = False
    told(controller, "OR")
    clock.now = 59.0
    assert told(controller, "TS") == "1TS00001E"
    clock.now = 61.0
    assert told(controller, "TS") == "1TS00400B"


def test_configuration_is_entered_and_left(controller):
    assert told(controller, "RS", "PW1", "TS") == "1TS000014"
    assert told(controller, "OH0.2", "OH?") == "1OH0.2"
    assert told(controller, "PW0", "TS") == "1TS00000C"


@pytest.mark.parametrize(("fault", "word"), [("end-of-run 100", "00020F"), ("stall 100", "00203D")])
def test_the_faults_of_the_world_are_those_of_its_stage(fault, word):
    world = World(scenario(press_time=3600.0, faults=(fault,)), pace=None)
    controller = Controller(WorldStage(world))
    told(controller, "VA0.1", "PA13")
    world.advance(900)
    assert told(controller, "TS") == "1TS000028"
    world.advance(200)
    told(controller, "TS")
    world.advance(2000)
    assert controller.stage.position() == pytest.approx(12.6, abs=1e-4)
    assert world.stage_m() == pytest.approx(100e-6)
    assert word[-2:] in told(controller, "TS")


def test_what_the_world_does_not_model_is_an_error_with_its_reason():
    world = World(scenario(press_time=0.0, press_samples=10), pace=None)
    world.advance(20)
    controller = Controller(WorldStage(world))
    assert told(controller, "PA12", "TE") == "1TEV"
    assert "a move back" in told(controller, "TBV")


# ------------------------------------------------------------------ the line


class Echo:
    """Answers what it was asked."""

    def answer(self, command):
        if command == b"pull":
            raise ConnectionError
        return command


class Client:
    """The near end, without any driver."""

    def __init__(self, line):
        host, port = line.start().removeprefix("socket://").split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=20.0)

    def ask(self, text):
        self.socket.sendall(text)
        return self.read()

    def read(self):
        got = b""
        while not got.endswith(b"\n"):
            piece = self.socket.recv(100)
            if not piece:
                return got
            got += piece
        return got


@pytest.fixture
def linked():
    """Makes a line to an echo, and a client at its near end."""
    with contextlib.ExitStack() as made:

        def link(**line):
            line = SerialLine(Echo(), "tcp", **line)
            made.callback(line.cut)
            client = Client(line)
            made.callback(client.socket.close)
            return line, client

        yield link


def test_commands_are_stamped_when_their_last_byte_is_in(linked):
    line, client = linked(byte_s=0.01)
    began = time.monotonic()
    assert client.ask(b"123456789\r\n") == b"123456789\r\n"
    assert line.arrivals[0][1] == b"123456789"
    assert line.arrivals[0][0] - began >= 0.11
    assert time.monotonic() - began >= 0.22


def test_a_command_is_heard_while_an_answer_is_on_its_way(linked):
    line, client = linked(think_s=2.0)
    client.socket.sendall(b"slow\r\n")
    client.socket.sendall(b"stop\r\n")
    assert client.read().startswith(b"slow")
    (slow, _), (stop, _) = line.arrivals[:2]
    assert stop - slow < 2.0


def test_noise_is_seen_and_nothing_else_is_changed():
    assert garbled(b"1TP12.5") != b"1TP12.5"
    assert bytes(b & 0x7F for b in garbled(b"1TP12.5")) == b"1TP12.5"


def test_a_mute_line_takes_commands_and_gives_no_answer(linked):
    line, client = linked()
    line.is_mute = True
    client.socket.sendall(b"one\r\n")
    wait_until(lambda: line.arrivals)
    line.is_mute = False
    assert client.ask(b"two\r\n") == b"two\r\n"


@pytest.mark.parametrize("by", ["device", "hand"])
def test_a_line_that_is_cut_is_closed(linked, by):
    line, client = linked()
    assert client.ask(b"there?\r\n")
    if by == "hand":
        line.cut()
    else:
        client.socket.sendall(b"pull\r\n")
    assert client.read() == b""


def test_all_callers_of_a_network_port_see_every_answer(linked):
    line, client = linked()
    assert client.ask(b"first\r\n")
    host, port = line.url.removeprefix("socket://").split(":")
    with socket.create_connection((host, int(port)), timeout=20.0) as second:
        second.sendall(b"second\r\n")
        assert second.recv(100) == b"second\r\n"
        assert client.read() == b"second\r\n"


def test_a_deaf_device_ignores_what_follows_a_command_in_the_same_transfer(linked):
    line, client = linked(deaf_s=0.05)
    assert client.ask(b"one\r\ntwo\r\n") == b"one\r\n"
    assert line.ignored == b"two\r\n"
    time.sleep(0.1)
    assert client.ask(b"three\r\n") == b"three\r\n"
