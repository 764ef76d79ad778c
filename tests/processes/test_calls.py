"""Calls between processes: whoever says nothing holds up nobody else, and every wait has an end."""

import gc
import math
import os
import socket
import struct
import sys
import threading
import time
from contextlib import closing, contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Listener

import pytest

from app.processes import calls
from app.processes.calls import ENDS, Caller, Gone, Server, Silent, asked_at

KEY = b"k" * 32
PATIENT_S = 30.0

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the mute ones are sockets")


@pytest.fixture
def server(short_path):
    made = Server(short_path, KEY, lambda: {"twice": lambda x: 2 * x, "sleep": time.sleep})
    yield made
    made.close()


@contextmanager
def mute(address):
    """A connection that says nothing."""
    with closing(socket.socket(socket.AF_UNIX)) as line:
        line.connect(address)
        yield line


def answered(call):
    """What a call gives, or its exception; None where neither comes."""
    got = []

    def run():
        try:
            got.append(call())
        except Exception as error:
            got.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENT_S)
    return got[0] if got else None


def test_a_connection_that_says_nothing_blocks_no_other_caller(server):
    with mute(server.address), mute(server.address):
        caller = Caller(server.address, KEY)  # kept: it is connected for as long as it lives
        assert answered(lambda: caller("twice", 4, answer_s=20.0)) == 8
        assert server.connections == 1  # the mute ones keep no bench from ending


def test_a_connection_that_says_nothing_is_let_go(server, monkeypatch):
    monkeypatch.setattr(calls, "SHAKES_S", 0.05)
    with mute(server.address) as line:
        line.settimeout(PATIENT_S)
        while line.recv(64):  # the challenge, then the end
            pass


@pytest.mark.parametrize("backlog", [8, 0])
def test_a_process_that_answers_nothing_is_silent_and_no_caller_waits_for_ever(short_path, backlog):
    with closing(socket.socket(socket.AF_UNIX)) as listener:
        listener.bind(str(short_path / "calls"))
        listener.listen(backlog)
        for _ in range(3):  # with no backlog the later ones cannot even connect
            caller = Caller(str(short_path / "calls"), KEY)
            error = answered(lambda caller=caller: caller("stop_motion", answer_s=0.1))
            assert isinstance(error, Silent), error
            assert "stop_motion: no answer within 0.1 s" in str(error)
            error = answered(lambda caller=caller: caller("stop_motion", answer_s=0.1))
            assert isinstance(error, Silent), error


def test_an_answer_that_breaks_off_is_silence(short_path):
    with Listener(str(short_path / "calls"), authkey=KEY) as listener:
        caller = Caller(listener.address, KEY)
        with listener.accept() as line:
            threading.Thread(target=line.recv, daemon=True).start()
            header = struct.pack("!i", 1000) + b"only the beginning"
            threading.Timer(0.1, os.write, (line.fileno(), header)).start()
            error = answered(lambda: caller("image", answer_s=1.0))
            assert isinstance(error, Silent), error


def test_a_caller_waits_no_longer_for_its_turn_than_for_an_answer(server):
    caller = Caller(server.address, KEY)
    busy = threading.Thread(
        target=answered, args=(lambda: caller("sleep", 60.0, answer_s=60.0),), daemon=True
    )
    busy.start()
    while not caller._lock.locked():
        time.sleep(0.01)
    error = answered(lambda: caller("twice", 1, answer_s=0.1))
    assert isinstance(error, Silent), error


def test_a_caller_is_let_go_without_a_wait_for_the_call_under_way(server):
    caller, ended = Caller(server.address, KEY), []
    busy = threading.Thread(
        target=lambda: ended.append(caller("sleep", 1.0, answer_s=60.0)), daemon=True
    )
    busy.start()
    while not caller._lock.locked():
        time.sleep(0.01)
    caller.close(waits=False)
    assert caller._lock.locked()
    busy.join(PATIENT_S)
    assert ended == [None]  # its answer comes all the same
    give_up = time.monotonic() + PATIENT_S
    while server.connections and time.monotonic() < give_up:
        time.sleep(0.01)
    assert server.connections == 0  # which keep a bench from ending
    assert isinstance(answered(lambda: caller("twice", 1)), Gone)


def test_a_late_answer_is_nobodys(server):
    caller = Caller(server.address, KEY)
    assert isinstance(answered(lambda: caller("sleep", 0.5, answer_s=0.1)), Silent)
    assert caller("twice", 2, answer_s=20.0) == 4


def test_the_connection_is_made_before_the_first_call(server):
    caller = Caller(server.address, KEY)
    give_up = time.monotonic() + PATIENT_S
    while not server.connections:
        assert time.monotonic() < give_up
        time.sleep(0.01)
    caller.close()


def test_who_does_not_know_the_key_is_turned_away_and_the_next_is_answered(server):
    error = answered(lambda: Caller(server.address, b"x" * 32)("twice", 1, answer_s=20.0))
    assert isinstance(error, Gone), error
    assert Caller(server.address, KEY)("twice", 1, answer_s=20.0) == 2


def test_a_process_that_is_gone_is_told_at_each_call(short_path):
    caller = Caller(str(short_path / "nobody"), KEY)
    for _ in range(2):
        error = answered(lambda: caller("twice", 1, answer_s=20.0))
        assert isinstance(error, Gone), error


def test_a_process_that_ends_between_two_calls_leaves_nothing_that_python_complains_of(short_path):
    with Listener(str(short_path / "calls"), authkey=KEY) as listener:
        caller = Caller(listener.address, KEY)
        listener.accept().close()
        complaints = []
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(sys, "unraisablehook", complaints.append)
            error = answered(lambda: caller("twice", b"x" * 10_000_000, answer_s=20.0))
            assert isinstance(error, Gone), error
            del error
            gc.collect()
        assert not complaints


def test_a_call_whose_caller_has_given_up_is_not_carried_out_unless_it_ends_something():
    """As a process finds it that was suspended meanwhile."""
    here, there = Pipe()
    done = []
    methods = {name: lambda name=name: done.append((name, asked_at())) for name in ("move", *ENDS)}
    served = threading.Thread(target=calls.answer_calls, args=(there, methods), daemon=True)
    served.start()
    now = time.monotonic()
    for name, give_up in (("move", now - 1e-3), *((name, now - 60) for name in ENDS)):
        here.send((name, (), now - 90, give_up))
        is_result, result = here.recv()
        assert is_result == (name in ENDS)
        assert is_result or "came too late and was not carried out" in str(result)
    assert done == [(name, now - 90) for name in ENDS]
    here.send(("move", (), now, now + 60))
    assert here.recv() == (True, None)
    assert done[-1] == ("move", now)
    assert asked_at() == math.inf
    here.close()
    served.join(PATIENT_S)
