"""Signals that end the program: acted on at once, even while the main thread is held up."""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from app.system.threads import start_thread

ENDING = {
    "SIGINT": "Ctrl-C was pressed",
    "SIGTERM": "the program received the signal to end",
    "SIGHUP": "the terminal was closed",
    "SIGBREAK": "the console was closed",
}


@contextmanager
def acting_on_signals(act: Callable[[str], None]) -> Iterator[threading.Event]:
    """Call `act` with the reason, in a thread of its own, for each signal to end that comes.

    Their Python handlers do nothing: they wait for the main thread, which a window can hold up for
    seconds. Outside the main thread nothing is done, nor for a closed terminal after ``nohup``. The
    event that this gives is set once one has come.
    """
    has_come = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield has_come
        return
    known = {getattr(signal, name): why for name, why in ENDING.items() if hasattr(signal, name)}
    reasons = {
        number: why
        for number, why in known.items()
        if number.name != "SIGHUP" or signal.getsignal(number) is not signal.SIG_IGN
    }
    mine, theirs = socket.socketpair()
    theirs.setblocking(False)
    before = {number: signal.signal(number, lambda *_: None) for number in reasons}
    woken = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)

    def work() -> None:
        while data := mine.recv(16):
            for number in data:
                if number in reasons:
                    has_come.set()
                    act(reasons[signal.Signals(number)])

    thread = start_thread("signals", work)
    try:
        yield has_come
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        theirs.close()
        thread.join()
        mine.close()
