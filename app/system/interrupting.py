"""Ctrl-C and the signal to end: a command that only computes is over soon, whatever it is at."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from app.system.threads import start_thread

GRACE_S = 1.0  # that a command has to end in good order
TELLS_S = 0.3  # that are left to say why: a pipe that nobody reads takes nothing
SHOW_CURSOR = "\r\x1b[K\x1b[?25h"  # a progress bar has hidden it
REASONS = {
    getattr(signal, name): reason
    for name, reason in (
        ("SIGINT", "Ctrl-C"),
        ("SIGTERM", "the signal to end"),
        ("SIGHUP", "a closed terminal"),
        ("SIGBREAK", "a closed console"),
    )
    if hasattr(signal, name)
}  # to begin a sentence
HEARD: list[str] = []  # of them, those for which this process was interrupted, oldest first


def heed_signal_to_end() -> None:
    """From now on SIGTERM, and that the terminal is closed, do in this process what Ctrl-C does.

    `HEARD` has the reason: compiled code may lose the interrupt, and raise another error for it.
    """

    def interrupt(number: int, _: Any) -> NoReturn:
        HEARD.append(REASONS[signal.Signals(number)])
        raise KeyboardInterrupt(HEARD[-1])

    for number in REASONS:
        # nohup has SIGHUP ignored
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, interrupt)


def ignore_signals_to_end() -> None:
    """From now on they do nothing: a second one as the interpreter ends changes no exit code."""
    for number in REASONS:
        signal.signal(number, signal.SIG_IGN)


def reason_of(interrupt: BaseException) -> str:
    """What has interrupted the program, to begin a sentence."""
    return str(interrupt) or "Ctrl-C"


@contextmanager
def ending_soon(tell: Callable[[str], None]) -> Iterator[None]:
    """End this process a second after Ctrl-C or the signal to end, should the block, or what comes
    after it, not be over: a function of a library may hear nothing for minutes, and threads are
    waited for.

    Files that are not finished are removed, and processes that this one has started are ended.
    `tell` is told the reason, unless the block was left by then. Outside the main thread nothing
    is done.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    import psutil  # a command that is only being completed has no time for it

    from app.system.outputs import remove_unfinished

    mine, theirs = socket.socketpair()
    theirs.setblocking(False)
    has_come, is_left = threading.Event(), threading.Event()

    def say_why(number: int) -> None:
        with suppress(Exception):
            if not is_left.is_set():
                tell(REASONS[signal.Signals(number)])
            if sys.stderr.isatty():
                os.write(sys.stderr.fileno(), SHOW_CURSOR.encode())
            for stream in (sys.stderr, sys.stdout):
                stream.flush()

    def watch() -> None:
        while not REASONS.keys() & (numbers := mine.recv(1)):  # it hears of every signal
            if not numbers:
                return
        has_come.set()
        try:
            until = time.monotonic() + GRACE_S
            with suppress(TimeoutError):
                while (left_s := until - time.monotonic()) > 0:
                    mine.settimeout(left_s)
                    if REASONS.keys() >= set(mine.recv(1)):  # a second one is not waited for
                        break
            with suppress(psutil.Error):
                for process in psutil.Process().children(recursive=True):
                    with suppress(psutil.Error):  # it has just ended
                        process.kill()
            remove_unfinished()
            start_thread("teller", say_why, *numbers).join(TELLS_S)
        finally:
            os._exit(1)

    before = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
    thread = start_thread("interrupt", watch)
    try:
        yield
    finally:
        is_left.set()
        if not has_come.is_set():
            signal.set_wakeup_fd(before)
            theirs.shutdown(socket.SHUT_WR)  # a process that was forked may have it, too
            theirs.close()
            if not has_come.is_set():  # nor just now
                thread.join()
                mine.close()
