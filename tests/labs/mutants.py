"""The stage of a lab with one mistake each, which `slipscope check-driver` must find."""

import threading
import time
from contextlib import nullcontext, suppress

import numpy as np
import serial
from labs.zaber import ZaberStage

from drivers.errors import DeviceError


class NoLock(ZaberStage):
    """A question and its answer can be torn apart by those of another thread."""

    def __init__(self, settings, clock):
        super().__init__(settings, clock)
        self._lock = nullcontext()


class Mixed(ZaberStage):
    """It takes the answer to a stop for a position, 0, of which nobody is told."""

    _stops = False

    def stop(self):
        self._stops = True
        super().stop()
        self._stops = False

    def position_m(self):
        return 0.0 if self._stops else super().position_m()


class Jog(ZaberStage):
    """A move without an end, which a thread stops at the target."""

    def move_to(self, position_m):
        here = self.position_m()
        super().move_to(self.travel_limits_m[position_m > here])
        threading.Thread(
            target=self._stop_at, args=(position_m, position_m > here), daemon=True
        ).start()

    def _stop_at(self, position_m, is_forward):
        with suppress(DeviceError):  # it may be closed meanwhile
            while (self.position_m() < position_m) == is_forward:
                time.sleep(0.001)
            self.stop()


class SlowStop(ZaberStage):
    """It waits before it stops."""

    def stop(self):
        time.sleep(3.0)
        super().stop()


class OpenError(ZaberStage):
    """The error of a dead line is not its own."""

    def _reply(self, command):
        try:
            return super()._reply(command)
        except Exception as error:
            raise error.__cause__ or error from None


class SilentStop(ZaberStage):
    """It says nothing of a stop that cannot be sent."""

    def stop(self):
        with suppress(DeviceError):
            super().stop()


class KeptPort(ZaberStage):
    """It keeps its port where it cannot be stopped."""

    def close(self):
        if self._line is not None:
            self.stop()
            self._line.close()
            self._line = None


class Millimetres(ZaberStage):
    """Its positions are in millimetres."""

    def position_m(self):
        return super().position_m() * 1e3


class ListedPlace(ZaberStage):
    """Its position is an array of one."""

    def position_m(self):
        return np.array([super().position_m()])


class NumberedMoves(ZaberStage):
    """It says 0 for that it stands."""

    def is_moving(self):
        return int(super().is_moving())


class Nanometres(ZaberStage):
    """Its readings alone are a thousandth of what they should be."""

    def position_m(self):
        return super().position_m() * 1e-3


class Fast(ZaberStage):
    """Its velocities are ten times what was asked."""

    def set_velocity(self, velocity_m_s):
        super().set_velocity(velocity_m_s)
        self._ask(f"set maxspeed {round(velocity_m_s / self._step_m * 1.6384 * 10)}")


class Stopper:
    """A way of its own to the port, as a supervisor uses it."""

    def __init__(self, port, command=b"/1 1 stop\n"):
        self.port, self.command = port, command

    def stop(self):
        with serial.serial_for_url(self.port) as way:
            way.write(self.command)
            way.flush()


class Supervised(ZaberStage):
    """It can be stopped from another process."""

    def stopper(self):
        return Stopper(self._settings.port)


class DeafStopper(ZaberStage):
    """Its way from outside stops nothing."""

    def stopper(self):
        return Stopper(self._settings.port, b"/1 1 get pos\n")


class UnsentStopper(ZaberStage):
    """Its way from outside cannot be given to another process."""

    def stopper(self):
        return threading.Lock()
