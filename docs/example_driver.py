"""A complete driver as an example: a stepper on a microcontroller that understands lines of text
(tests/drivers/test_example_driver.py).

Its protocol: ``M <um> <um/s>`` moves to a position, ``P`` answers the position in um, ``B`` answers
1 while it moves, ``S`` stops.
"""

from __future__ import annotations

import re
import threading
from typing import Any

from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.motion import check_target, check_velocity
from drivers.settings import ActuatorSettings


class TextStage:
    """The stage on the serial port of the settings."""

    name = "text stage"

    def __init__(self, settings: ActuatorSettings, clock: SampleClock) -> None:
        del clock  # a stage needs no samples
        self.travel_limits_m, self.velocity_limit_m_s = settings.travel, settings.max_velocity
        self._port, self._baud = settings.port, settings.baud or 115200
        self._line: Any = None
        self._lock = threading.RLock()  # `stop` comes from any thread
        self._velocity = 10e-6

    def open(self) -> None:
        """Claim the port; nothing moves."""
        import serial  # here and nowhere else: the program also runs where it is not installed

        waits = {"timeout": 0.5, "write_timeout": 0.5}
        try:
            self._line = serial.serial_for_url(self._port, baudrate=self._baud, **waits)
        except (OSError, ValueError) as error:
            what = f"port '{self._port}' cannot be opened ({error})"
            raise DeviceNotFound(f"{self.name}: {what}; check actuator.port") from error

    def describe(self) -> str:
        """Its position."""
        return f"at {self.position_m() * 1e6:.1f} um"

    def home(self) -> None:
        """This stage has no origin."""
        raise DeviceFault(f"{self.name}: it has no origin to search; move it by hand")

    def set_velocity(self, velocity_m_s: float) -> None:
        """Set the speed of later moves."""
        check_velocity(self.name, velocity_m_s, self.velocity_limit_m_s)
        self._send("")
        self._velocity = velocity_m_s

    def move_to(self, position_m: float) -> None:
        """Start a bounded move."""
        check_target(self.name, position_m, self.travel_limits_m)
        self._send(f"M {position_m * 1e6:.3f} {self._velocity * 1e6:.3f}")

    def position_m(self) -> float:
        """Present position."""
        return float(self._send("P", r"-?\d+\.\d+")) * 1e-6

    def is_moving(self) -> bool:
        """Whether it moves."""
        return self._send("B", "[01]") == "1"

    def stop(self) -> None:
        """End any motion now."""
        self._send("S")

    def close(self) -> None:
        """Stop, and let go of the port."""
        if self._line is not None:
            try:
                self.stop()
            finally:
                with self._lock:  # no other thread is in the middle of a question
                    self._line.close()
                    self._line = None

    def _send(self, command: str, form: str = "") -> str:
        """Send a command; its answer, a line of that form, where it has one."""
        with self._lock:
            if self._line is None:
                raise DeviceFault(f"{self.name}: it is not open; open it first")
            try:
                self._line.read(self._line.in_waiting)  # what came too late answers nothing
                self._line.write(f"{command}\n".encode() if command else b"")
                answer = self._line.readline().decode("ascii", "replace") if form else ""
            except OSError as error:
                raise DeviceFault(f"{self.name}: its line is dead ({error}); check it") from error
        if form and not re.fullmatch(form + r"\r?\n", answer):  # readline may give a piece
            what = f"no answer to '{command}' came within 0.5 s, but {answer!r}"
            raise DeviceTimeout(f"{self.name}: {what}; check its cable and power")
        return answer.strip()
