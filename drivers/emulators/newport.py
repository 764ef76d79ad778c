"""An emulated SMC100CC or CONEX-CC: the state machine of the controller, and the real driver
connected to it.

States, errors and commands are those of the manuals that `drivers.stages.newport_stage` names. What
the manuals leave open, the emulation decides against the driver: an error stays in the memory until
TE reads it, ST is an error if nothing moves, PA is refused in motion.
"""

from __future__ import annotations

import dataclasses
import re

from drivers.clock import SampleClock
from drivers.emulators.serial_line import SerialLine, garbled
from drivers.emulators.stages import ENCODER_MM, FOLLOWING_ERROR, WorldStage
from drivers.errors import OutOfLimits
from drivers.settings import ActuatorSettings
from drivers.sim.world import World
from drivers.stages.newport_stage import ConexCc, NewportStage, Smc100

HOMING_TIMEOUT = 0x40
VERSIONS = {"smc100": "SMC_CC - Controller-driver version  3. 1. 2", "conex-cc": "CONEX-CC 2.0.1"}

_LETTERS = {
    **dict.fromkeys(range(0x0A, 0x12), "H"),
    0x14: "I",
    0x1E: "L",
    0x28: "M",
    **dict.fromkeys(range(0x32, 0x39), "K"),
}
# state -> the refusal of commands that it does not allow
_LETTERS |= dict.fromkeys(range(0x3C, 0x40), "J")
_ALLOWED = {
    "AC": "IJK", "FE": "IJK", "MM": "JK", "OH": "I", "OR": "H", "OT": "I", "PA": "K", "PR": "K",
    "PW": "HI", "SL": "IJK", "SR": "IJK", "ST": "LM", "SU": "I", "VA": "IJKM", "ZX": "I",
}  # fmt: skip
_RANGES = {"SL": (-1e12, 0.0), "SR": (0.0, 1e12), "MM": (0, 1), "PW": (0, 1)}


class Controller:
    """The state machine of a controller: its answers, and the effect of commands on the stage."""

    def __init__(
        self,
        stage: WorldStage,
        model: str = "smc100",
        address: int = 1,
        *,
        is_referenced: bool = True,
    ) -> None:
        self.stage = stage
        self.state, self.errors = (0x32 if is_referenced else 0x0A), 0
        self.can_home = True
        self.parameters = {
            "AC": 20.0,
            "FE": 0.01,
            "OH": 0.5,
            "OT": 60.0,
            "SL": 0.0,
            "SR": 25.0,
            "SU": ENCODER_MM,
            "VA": 1.0,
            "ZX": 3.0,
        }
        self._fastest = self.parameters["VA"]
        self._address, self._version = address, VERSIONS[model]
        self._origin = 0.0 if is_referenced else stage.position()
        self._memory, self._reason, self._homing_since = "@", "", 0.0

    def answer(self, command: bytes) -> bytes:
        """The answer to a line; empty if the protocol has none."""
        match = re.fullmatch(r"(\d*)([A-Za-z]{2})(.*)", command.decode("ascii", "replace"))
        if match is None:
            self._memory = "A"
            return b""
        address, name, value = match[1], match[2].upper(), match[3].strip()
        if address not in (str(self._address), "") or (not address and name != "ST"):
            return b""
        self._settle()
        answer = self._answer(name, value)
        if answer is not None:
            return f"{address}{name}{answer}".encode()
        self._memory = self._act(name, value) or self._memory
        return b""

    def _answer(self, name: str, value: str) -> str | None:
        """The answer to a query; None if the command is not a query."""
        if name == "TE":
            letter, self._memory = self._memory, "@"
            return letter
        if name == "TS":
            errors, self.errors = self.errors, 0
            return f"{errors:04X}{self.state:02X}"
        if name in ("TP", "TH"):
            return f"{self.stage.position() - self._origin:.10g}"
        if name == "TB":
            return f"{value} {self._reason}".rstrip()
        if name == "VE":
            return " " + self._version
        if name == "ID":
            return "EMULATED_25MM"
        return f"{self.parameters[name]:.10g}" if value == "?" and name in self.parameters else None

    def _act(self, name: str, value: str) -> str:
        """Do a command; the letter of its error, empty if there is none."""
        if name == "RS":
            self.stage.halt(self.parameters["AC"])
            self.state, self._origin = 0x0A, self.stage.position()
            return ""
        if name not in _ALLOWED:
            return "A"
        letter = _LETTERS[self.state]
        if letter not in _ALLOWED[name]:
            return "E" if name == "OR" and letter == "L" else letter
        if name == "ST":
            self.stage.halt(self.parameters["AC"])
            self.state = 0x0B if letter == "L" else self.state
            return ""
        if name == "OR":
            return self._drive(0.0, "OH", 0x1E)
        try:
            number = float(value)
        except ValueError:
            return "C"
        low, high = _RANGES.get(
            name,
            (-1e12, 1e12)
            if name in ("PA", "PR")
            else (1e-6, self._fastest if name == "VA" else 1e12),
        )
        if not low <= number <= high:
            return "C"
        if name in ("PA", "PR"):
            return self._move(number + (self.stage.position() if name == "PR" else 0.0))
        if name == "MM":
            self.state = (0x34 if letter == "J" else self.state) if number else 0x3C
        elif name == "PW":
            self.state = 0x14 if number else 0x0C
        else:
            self.parameters[name] = number
        return ""

    def _move(self, target: float) -> str:
        low, high = self.parameters["SL"], self.parameters["SR"]
        if not low <= self.stage.position() <= high:
            return "N"
        return self._drive(target, "VA", 0x28) if low <= target <= high else "G"

    def _drive(self, target: float, speed: str, state: int) -> str:
        try:
            self.stage.move(target, self.parameters[speed], self.parameters["AC"])
        except OutOfLimits as error:  # of the stage of the simulated world
            self._reason = str(error)
            return "V"
        self.state, self._homing_since = state, self.stage.time()
        return ""

    def _settle(self) -> None:
        """Update the state after the motion so far."""
        letter = _LETTERS[self.state]
        if letter == "M":
            errors = self.stage.errors(self.parameters["FE"])
            if errors or not self.stage.is_moving():
                self.errors |= errors
                self.state = {0: 0x33, FOLLOWING_ERROR: 0x3D}.get(errors, 0x0F)
            if errors:
                self.stage.halt(1e12)
        elif letter == "L" and not self.can_home:
            if self.stage.time() - self._homing_since > self.parameters["OT"]:
                self.errors |= HOMING_TIMEOUT
                self.state = 0x0B
        elif letter == "L" and not self.stage.is_moving():
            self.state, self._origin = 0x32, 0.0


class _Faulty:
    """A controller that the faults of the world silence or slow down, on a line that they cut or
    disturb.

    Attributes
    ----------
    line : SerialLine or None
        That it is connected to.
    """

    def __init__(self, controller: Controller, world: World) -> None:
        self.line: SerialLine | None = None
        self._controller, self._world = controller, world
        self._answers = self._garbled = 0

    def connect(self, line: SerialLine) -> None:
        """Use this line from now on."""
        self.line = line
        self._disturb(self._world.now)

    def _disturb(self, now: int) -> None:
        if self.line is None:
            return
        faults = self._world.faults
        if faults.since("mute-controller", now):
            self.line.is_mute = True
        if slow := faults.since("slow-controller", now):
            self.line.think_s = slow.amount * 1e-3
        if deaf := faults.since("deaf-controller", now):
            self.line.deaf_s = deaf.amount * 1e-3

    def answer(self, command: bytes) -> bytes:
        faults, now = self._world.faults, self._world.now
        if faults.since("unplugged", now):
            raise ConnectionError
        self._disturb(now)
        answer, noise = self._controller.answer(command), faults.since("noisy-line", now)
        if not answer or noise is None:
            return answer
        self._answers += 1
        if self._answers % 3 or self._garbled >= noise.amount:
            return answer
        self._garbled += 1
        return garbled(answer)


class _Emulated(NewportStage):
    """A driver that opens both ends of its line."""

    _model: str

    def __init__(self, settings: ActuatorSettings, clock: SampleClock, world: World) -> None:
        super().__init__(settings, clock)
        self._world = world
        self._device: _Faulty | None = None
        self._far_end: SerialLine | None = None

    def open(self) -> None:
        """Switch the emulated controller on (the first time), and open the line to it."""
        if self._far_end is not None:
            return
        if self._device is None:
            stage = WorldStage(self._world)
            self._device = _Faulty(
                Controller(stage, self._model, self._settings.address), self._world
            )
        self._far_end = SerialLine(self._device)
        self._device.connect(self._far_end)
        self._settings = dataclasses.replace(self._settings, port=self._far_end.start())
        try:
            super().open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Stop, and let go of both ends of the line."""
        try:
            super().close()
        finally:
            line, self._far_end = self._far_end, None
            if line is not None:
                line.cut()


class EmulatedSmc100(_Emulated, Smc100):
    """The driver of the SMC100CC on an emulated one, which drives the simulated stage."""

    name = "emulated SMC100"
    _model = "smc100"


class EmulatedConexCc(_Emulated, ConexCc):
    """The driver of the CONEX-CC on an emulated one, which drives the simulated stage."""

    name = "emulated CONEX-CC"
    _model = "conex-cc"
