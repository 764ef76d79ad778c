"""A Newport driver on an emulated controller whose clock the test turns, and what tests do to the
two.
"""

import contextlib
import select
import threading

import pytest
from free_stage import FreeStage

from drivers.clock import SampleClock
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine
from drivers.errors import DeviceError, DeviceFault
from drivers.settings import ActuatorSettings
from drivers.stages import newport_line
from drivers.stages.newport_line import ANSWER_S, PATIENCE_S
from drivers.stages.newport_stage import ConexCc, Smc100

PATIENT_S = 60.0


class Told:
    """A controller that gives the answers it is told to, to some queries; `hold` keeps one back
    until it is let go.
    """

    def __init__(self, controller):
        self.controller = controller
        self.answers = {}
        self.held = None
        self.let_go = threading.Event()

    def hold(self, query):
        self.held = query

    def answer(self, command):
        query = command.decode()[1:]
        if query == self.held:
            self.held = None
            assert self.let_go.wait(PATIENT_S)
        if query in self.answers:
            answer = self.answers[query]
            if isinstance(answer, list):
                answer = answer.pop(0) if len(answer) > 1 else answer[0]
            return answer.encode("latin-1")
        return self.controller.answer(command)


class NewportBench:
    """Clock, stage, controller, line and driver; nothing is open."""

    def __init__(
        self, driver=Smc100, over="", *, stage=None, is_referenced=True, line=None, **settings
    ):
        self.now = 0.0
        self.stage = FreeStage(lambda: self.now, **(stage or {}))
        model = "conex-cc" if driver is ConexCc else "smc100"
        self.controller = Controller(self.stage, model, is_referenced=is_referenced)
        self.device = Told(self.controller)
        self.line = SerialLine(self.device, over, **(line or {}))
        self.settings = ActuatorSettings(port=self.line.start(), **settings)
        self.driver = driver(self.settings, SampleClock(1000.0))

    def opened(self):
        """The same, its driver open and ready for a move if it can be."""
        self.driver.open()
        with contextlib.suppress(DeviceFault):
            self.driver.make_ready()
        return self

    def pass_time(self, seconds):
        """Let the stage move on."""
        self.now += seconds

    def sent(self, name):
        """Commands of one name that have arrived."""
        return [
            command.decode()
            for _, command in list(self.line.arrivals)
            if command.decode()[1:].startswith(name)
        ]

    def end(self):
        """Close both ends."""
        self.device.let_go.set()
        self.line.cut()
        with contextlib.suppress(DeviceError):  # the line is dead by now
            self.driver.close()


class Aside:
    """Work in a thread of its own, its result or error and how long it took."""

    def __init__(self, work):
        self.error = None
        self.result = None
        self._work = work
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        try:
            self.result = self._work()
        except Exception as error:
            self.error = error

    def join(self):
        """Its result, or its error raised."""
        self._thread.join(PATIENT_S)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error
        return self.result


@contextlib.contextmanager
def patient():
    """Drivers wait for an answer as long as a busy computer may take."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(newport_line, "ANSWER_S", 3.0)
        patched.setattr(newport_line, "PATIENCE_S", 30.0)
        yield


def benches():
    """Make benches with patient drivers; all are ended. For a fixture."""
    made = []
    with patient():
        yield lambda *args, **kwargs: made.append(NewportBench(*args, **kwargs)) or made[-1]
        for each in made:
            each.end()


class WaitedTime:
    """Time as the driver of a line sees it: it passes while the driver sleeps, or waits in vain for
    the line, and nowhere else, however long that takes.
    """

    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds

    def watching(self, port):
        """The same port, whose waits count."""
        read = port.read_until

        def read_until(end):
            got = read(end)
            self.now += 0.0 if got.endswith(end) else port.timeout
            return got

        port.read_until = read_until
        return port

    def select(self, *files_and_seconds):
        """Wait until a port takes more."""
        ready = select.select(*files_and_seconds)
        self.now += 0.0 if any(ready) else files_and_seconds[-1]
        return ready


def waited_time(monkeypatch):
    """The time that drivers opened from now on wait, each as patient as it is in a laboratory. For
    a fixture.
    """
    time, claimed = WaitedTime(), newport_line._claimed
    monkeypatch.setattr(newport_line, "time", time)
    monkeypatch.setattr(newport_line, "select", time)
    monkeypatch.setattr(newport_line, "_claimed", lambda *a, **k: time.watching(claimed(*a, **k)))
    monkeypatch.setattr(newport_line, "ANSWER_S", ANSWER_S)
    monkeypatch.setattr(newport_line, "PATIENCE_S", PATIENCE_S)
    return time
