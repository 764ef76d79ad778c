"""The settings of the three devices: one section per kind of device, from which each driver takes
what applies to it.

The names are those of the settings file; instances hold SI units.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

from analysis.options import Section, number_in, option, quantity

if TYPE_CHECKING:
    import numpy as np

MOST_AUXILIARY = 64
FORMATS = ("Mono8", "Mono10", "Mono12", "Mono12p", "Mono12Packed", "Mono16")


@dataclass(frozen=True, kw_only=True)
class DeviceSettings(Section):
    """What the settings of every device have beside their own.

    Attributes
    ----------
    options : Section
        The driver's own settings, an instance of the section that its class names as `Options`.
    """

    source: str = option(
        "sim", "Driver of the device (`slipscope doctor` lists them), or 'package.module:Class'"
    )
    options: Section = field(default_factory=Section)


class AuxiliaryChannel(NamedTuple):
    """An analog channel beside the two sensors: ``value = per_volt * volts + at_zero``, in its own
    unit; it is read from minus to plus `range_v` volts.
    """

    name: str
    channel: str
    unit: str
    per_volt: float = 1.0
    at_zero: float = 0.0
    range_v: float = 10.0


def _auxiliary(text: str) -> AuxiliaryChannel:
    name, channel, unit, *numbers = [*text.split(), *[""] * 3][: max(3, len(text.split()))]
    try:
        made = AuxiliaryChannel(name, channel, unit, *map(number_in, numbers))
        is_usable = (
            re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", name)
            and unit
            and all(map(math.isfinite, made[3:]))
            and made.per_volt
            and 0 < made.range_v <= 100
        )
    except (TypeError, ValueError):
        is_usable = False
    if not is_usable:
        raise ValueError(
            f"forces.auxiliary: '{text[:200]}' cannot be read; write NAME INPUT UNIT, then, if you"
            " like, UNIT per volt (not 0), UNIT at 0 V and the range in volts (more than 0 and at"
            " most 100), such as 'temperature ai2 degC 100 -50 5'"
        )
    return made


@dataclass(frozen=True, kw_only=True)
class ForceSettings(DeviceSettings):
    """The DAQ board and the two capacitive sensors."""

    device: str = option("Dev1", "Name of the board in NI MAX")
    server: str = option(
        "",
        "host:port of the NI gRPC device server with the board; empty: the board is in this"
        " computer",
    )
    certificate: str = option(
        "", "Certificate file (PEM) of the server; empty: unencrypted connection"
    )
    answer_time: float = option(
        2.0,
        "Time allowed for the server to answer a call; after that it counts as lost. The first"
        " call, which makes it load NI-DAQmx, is allowed five times as long",
        "s",
        ge=0.2,
        le=60,
    )
    channels: tuple[str, str] = option(
        ("ai0", "ai1"), "Analog inputs of the normal and the shear sensor"
    )
    auxiliary: tuple[str, ...] = option(
        (),
        "Further channels, each 'NAME INPUT UNIT', then units per volt, value at 0 V, range in"
        " volts: 'temperature ai2 degC 100 -50 5'",
    )
    wiring: str = option(
        "differential",
        "Wiring of the sensors: rse against the board's ground, nrse against AI SENSE",
        choices=("differential", "rse", "nrse"),
    )
    range: tuple[float, float] = option(
        (10.0, 10.0),
        "Input range of each sensor (normal, shear), from minus to plus this voltage",
        "V",
        gt=0,
        le=100,
    )
    buffer: float = option(
        10.0, "Capacity of the vendor library's buffer, in seconds of data", "s", ge=1, le=600
    )
    on_overflow: str = option(
        "end",
        "Reaction to lost samples: the run ends, or continues with a gap",
        choices=("end", "continue"),
    )
    trigger: str = option(
        "counter",
        "Source of the camera triggers: pulses of a counter, or a digital line clocked by the"
        " samples",
        choices=("counter", "digital"),
    )
    trigger_counter: str = option("ctr0", "Counter of the trigger pulses")
    trigger_terminal: str = option(
        "", "Output terminal of the pulses; empty: the counter's own (PFI12 for ctr0)"
    )
    trigger_line: str = option("port0/line0", "Line of the trigger, for trigger = 'digital'")
    exposure_counter: str = option(
        "",
        "Counter of the camera's exposures, e.g. 'ctr1', which confirms the number of each frame;"
        " empty: none",
    )
    exposure_terminal: str = option(
        "PFI3", "Terminal to which the camera's exposure output is wired"
    )
    exposure_edge: str = option(
        "rising",
        "Edge of the exposure output at the start of an exposure; falling with a pull-up if the"
        " camera's output conducts during the exposure",
        choices=("rising", "falling"),
    )
    sample_rate: int = option(
        1000,
        "Sampling rate; the sample clock is the time base of everything",
        "Hz",
        ge=100,
        le=100000,
    )
    block: int = option(50, "Number of samples read at a time", "samples", ge=1, le=10000)
    sensitivity_normal: float = option(
        300.0, "Displacement per volt of the normal sensor", "um/V", gt=0, le=10000
    )
    sensitivity_shear: float = option(
        22.0, "Displacement per volt of the shear sensor", "um/V", gt=0, le=10000
    )
    stiffness_normal: float = option(
        689.0, "Stiffness k_N of the normal cantilever", "N/m", gt=0, le=1e7
    )
    stiffness_shear: float = option(
        9579.0, "Stiffness K_T of the tangential cantilever", "N/m", gt=0, le=1e7
    )
    stiffness_uncertainty: tuple[float, float] = option(
        (5.0, 25.0), "Standard uncertainties of k_N and K_T", "N/m", ge=0
    )
    sign: tuple[int, int] = option(
        (1, 1),
        "1 or -1 (normal, shear); -1 if the sensor's voltage falls as its force grows",
        choices=(1, -1),
    )
    delay: float = option(
        0.0,
        "Delay of the readings of both sensors, for which results are corrected: the pure delay and"
        " the time constant of the low-pass in their conditioner, in sum; recorded readings and"
        " the forces of a frame stay as read",
        "ms",
        ge=0,
        le=1000,
    )
    zero: tuple[float, float] = option((0.0, 0.0), "Readings without force (normal, shear)", "V")
    coupling: tuple[tuple[float, float], tuple[float, float]] = option(
        ((1.0, 0.004), (0.008, 1.0)),
        "Cross-talk matrix: reading = coupling x (P, Q); its inverse corrects the readings",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        (a, b), (c, d) = self.coupling
        if abs(a * d - b * c) < 1e-6:
            raise ValueError(
                f"forces.coupling has no inverse; its determinant is {a * d - b * c:g}"
            )
        counters = self.trigger_counter, self.exposure_counter
        if self.trigger == "counter" and self.exposure_counter and counters[0] == counters[1]:
            raise ValueError(
                "forces.exposure_counter and forces.trigger_counter are both"
                f" {self.exposure_counter!r}; use two different counters"
            )
        if self.channels[0] == self.channels[1]:
            raise ValueError(
                f"forces.channels are both {self.channels[0]!r}; use an input for each sensor"
            )

        if len(self.auxiliary) > MOST_AUXILIARY:
            raise ValueError(
                f"forces.auxiliary has {len(self.auxiliary)} channels; {MOST_AUXILIARY} at most"
            )
        taken = list(self.channels)
        names: list[str] = []
        for text, found in zip(self.auxiliary, self.auxiliary_channels, strict=True):
            if found.channel in taken or found.name in names:
                raise ValueError(
                    f"forces.auxiliary: '{text}' has a name or an input that is taken already; use"
                    " each once"
                )
            taken.append(found.channel)
            names.append(found.name)

    @property
    def auxiliary_channels(self) -> tuple[AuxiliaryChannel, ...]:
        """The further channels, in order.

        Raises
        ------
        ValueError
            One cannot be read.
        """
        return tuple(map(_auxiliary, self.auxiliary))

    @property
    def sensitivity(self) -> tuple[float, float]:
        """Displacement per volt of the normal and the shear sensor, m/V, with their signs."""
        return self.sign[0] * self.sensitivity_normal, self.sign[1] * self.sensitivity_shear

    @property
    def stiffness(self) -> tuple[float, float]:
        """Stiffness of the normal and the tangential cantilever, N/m."""
        return self.stiffness_normal, self.stiffness_shear


@dataclass(frozen=True, kw_only=True)
class CameraSettings(DeviceSettings):
    """The triggered camera."""

    device: str = option(
        "",
        "Serial number or name of the camera (`slipscope cameras`); empty: the only one connected",
    )
    producer: str = option("", "GenTL producer (.cti) of the camera's vendor, for source = 'gentl'")
    folder: str = option("", "Folder of images, for source = 'folder'")
    pixel_format: str = option(
        "Mono8",
        "Pixel format; formats of more than 8 bits give 16-bit images on the format's own scale",
        choices=FORMATS,
    )
    offset: tuple[int, int] = option(
        (0, 0), "Top-left pixel (x, y) of the image on the sensor", "px", ge=0
    )
    gain: float = option(-1.0, "Gain; below 0: as set in the camera", "dB", ge=-1, le=60)
    trigger_line: str = option(
        "Line1",
        "Camera input that receives the triggers; empty: trigger and exposure as set in the camera",
    )
    exposure_line: str = option(
        "",
        "Camera output that is high during the exposure, for forces.exposure_counter; empty: not"
        " set",
    )
    divisor: int = option(
        125,
        "Samples per trigger: 125 is 8 frames/s at 1 kHz, 250 is 4",
        "samples",
        ge=1,
        le=1000000,
    )
    max_rate: float = option(
        24.0, "Highest trigger rate that the camera can follow", "frames/s", gt=0, le=10000
    )
    width: int = option(1600, "Image width", "px", ge=64, le=16384)
    height: int = option(1200, "Image height", "px", ge=64, le=16384)
    pixel: float = option(7.04, "Size of a pixel on the interface", "um", gt=0, le=1000)
    angle: float = option(
        0.0,
        "Direction of the drive in the image, from its rows (+x) downwards; a mirrored image"
        " needs no other setting",
        "degrees",
        ge=-180,
        le=180,
    )
    angle_from: str = option(
        "motion",
        "Whether that direction is measured from the block's motion (`angle` is used until the"
        " block moves) or given by `angle`",
        choices=("motion", "angle"),
    )
    fixed_pattern: str = option(
        "tell",
        "Treatment of features that stay in the image while the block moves (unequal pixels,"
        " dust). tell: report them, and remove marks for the search of the contact; undo: also"
        " remove marks from every image, and correct the pull of unequal pixels in u_x(r) and the"
        " results from it, which takes seconds at the reference; ignore: do not look for them",
        choices=("tell", "undo", "ignore"),
    )
    distortion: float = option(
        0.0,
        "Radial distortion of the lens, which is corrected: share by which the ideal position of"
        " an image corner is further out than the observed one",
        "%",
        ge=-5,
        le=5,
    )
    exposure: float = option(10.0, "Exposure time", "ms", gt=0, le=1000)
    readout: float = option(
        0.0,
        "Rolling shutter: time from the exposure of the top row of an image to that of the bottom"
        " row, by which displacements are corrected; negative: the bottom row comes first; 0:"
        " global shutter",
        "ms",
        ge=-1000,
        le=1000,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.source == "folder" and not self.folder:
            raise ValueError(
                "camera.folder must be the folder of the images that camera.source = 'folder'"
                ' plays; found ""'
            )
        if self.source == "gentl" and not self.producer:
            raise ValueError(
                "camera.producer must be the .cti file of the camera's vendor, for camera.source ="
                " 'gentl'; found \"\""
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of an image."""
        return self.height, self.width

    @property
    def full_scale(self) -> int:
        """The largest grey level of the pixel format."""
        bits = re.search(r"\d+", self.pixel_format)
        assert bits is not None
        return int(2 ** int(bits[0]) - 1)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Array type of the images."""
        import numpy as np  # the command line reads these settings and must start fast

        return np.dtype(np.uint8 if self.full_scale < 256 else np.uint16)

    def exposure_samples(self, sample_rate_hz: float) -> int:
        """Exposure time in whole samples, at least one."""
        return max(1, round(self.exposure * sample_rate_hz))


@dataclass(frozen=True, kw_only=True)
class ActuatorSettings(DeviceSettings):
    """The DC actuator that drives the block."""

    port: str = option("", "Serial port, 'COM3' or '/dev/ttyUSB0', or 'socket://host:port'")
    address: int = option(1, "Address of the controller on its line", ge=1, le=31)
    baud: int = option(0, "Baud rate of the line; 0: that of the model", "baud", ge=0, le=4000000)
    command_pause: float = option(
        10.0,
        "Pause after a command without an answer, during which the controller ignores input; a"
        " command that it seems to have missed is sent again with longer pauses, up to 150 ms",
        "ms",
        ge=1,
        le=150,
    )
    travel: tuple[float, float] = option(
        (0.0, 25.0),
        "Allowed positions; the stage is never sent beyond these two. The simulated stage has 0 to"
        " 25 mm whatever is written here",
        "mm",
    )
    max_velocity: float = option(
        1000.0, "Largest velocity at which the stage is ever driven", "um/s", gt=0, le=1e5
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.travel
        if not low < high:
            raise ValueError(
                "actuator.travel must be a least and a greatest position; found"
                f" {quantity(self, 'travel')}"
            )
        if self.source in ("smc100", "conex-cc") and not self.port:
            raise ValueError(
                'actuator.port must be the port that the actuator\'s controller is on; found ""'
            )
