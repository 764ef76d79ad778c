"""A Zaber controller at the far end of a serial line, as its protocol manual describes it."""

from free_stage import FreeStage

MICROSTEP_MM = 0.047625e-3
ACCELERATION = 100.0  # mm/s2


class ZaberEmulator:
    """Device 1 with one axis; only its stage is shared with the tests."""

    def __init__(self, clock):
        self.stage = FreeStage(clock)
        self.speed = 1.0  # mm/s
        self.commands = []

    def answer(self, command):
        self.commands.append(command)
        device, axis, *words = command.decode().lstrip("/").split()
        if (device, axis) != ("1", "1"):
            return b""
        data, flag = "0", "OK"
        match words:
            case []:
                pass
            case ["get", "deviceid"]:
                data = "50081"
            case ["get", "pos"]:
                data = str(round(self.stage.position() / MICROSTEP_MM))
            case ["set", "maxspeed", speed] if int(speed) > 0:
                self.speed = int(speed) * MICROSTEP_MM / 1.6384
            case ["move", "abs", target]:
                self.stage.move(int(target) * MICROSTEP_MM, self.speed, ACCELERATION)
            case ["stop"]:
                self.stage.halt(ACCELERATION)
            case _:
                data, flag = "BADCOMMAND", "RJ"
        state = "BUSY" if self.stage.is_moving() else "IDLE"
        return f"@01 1 {flag} {state} -- {data}".encode()
