"""A Zaber stage on a serial port, by Zaber's ASCII protocol."""

import threading
from dataclasses import dataclass

from analysis.options import Section, option
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout
from drivers.motion import check_target, check_velocity

SPEED = 1.6384  # a velocity is written as microsteps a second, times this
ANSWER_S = 0.5


class ZaberStage:
    """Axis 1 of the device `actuator.address` on `actuator.port`."""

    name = "Zaber stage"

    @dataclass(frozen=True, kw_only=True)
    class Options(Section):
        """A Zaber stage."""

        microstep: float = option(
            0.047625, "Travel of a microstep, from the data sheet of the stage", "um", gt=0, le=100
        )

    def __init__(self, settings, clock):
        self.travel_limits_m, self.velocity_limit_m_s = settings.travel, settings.max_velocity
        self._step_m, self._settings = settings.options.microstep, settings
        self._line = None
        self._lock = threading.RLock()  # `stop` comes from any thread

    def open(self):
        import serial

        port, waits = self._settings.port, {"timeout": ANSWER_S, "write_timeout": ANSWER_S}
        try:
            self._line = serial.serial_for_url(port, self._settings.baud or 115200, **waits)
        except (OSError, ValueError) as error:
            what = f"port '{port}' cannot be opened ({error}); check actuator.port"
            raise DeviceNotFound(f"{self.name}: {what}") from error

    def describe(self):
        return f"device {self._ask('get deviceid')}, at {self.position_m() * 1e3:.4f} mm"

    def home(self):
        self._ask("home")

    def set_velocity(self, velocity_m_s):
        check_velocity(self.name, velocity_m_s, self.velocity_limit_m_s)
        self._ask(f"set maxspeed {max(1, round(velocity_m_s / self._step_m * SPEED))}")

    def move_to(self, position_m):
        check_target(self.name, position_m, self.travel_limits_m)
        self._ask(f"move abs {round(position_m / self._step_m)}")

    def position_m(self):
        return int(self._ask("get pos")) * self._step_m

    def is_moving(self):
        return self._reply("")[3] == "BUSY"

    def stop(self):
        self._ask("stop")

    def close(self):
        if self._line is not None:
            try:
                self.stop()
            finally:
                with self._lock:  # no other thread is in the middle of a question
                    self._line.close()
                    self._line = None

    def _ask(self, command):
        *_, flag, _, _, data = self._reply(command)
        if flag != "OK":
            raise DeviceFault(f"{self.name}: '{command}' was refused ({data}); see Zaber's manual")
        return data

    def _reply(self, command):
        """``@device axis OK|RJ IDLE|BUSY warning data``, in parts."""
        with self._lock:
            if self._line is None:
                raise DeviceFault(f"{self.name}: it is not open; open it first")
            try:
                self._line.read(self._line.in_waiting)  # what nobody has waited for
                self._line.write(f"/{self._settings.address} 1 {command}\n".encode())
                answer = self._line.readline().decode("ascii", "replace")
            except OSError as error:
                raise DeviceFault(f"{self.name}: its line is dead ({error}); check it") from error
        parts = answer.strip().split(" ", 5)
        if len(parts) != 6 or not answer.endswith("\n"):  # a piece
            raise DeviceTimeout(f"{self.name}: no answer to '{command}'; check cable and power")
        return parts
