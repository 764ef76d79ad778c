"""What a driver is told about its device: one plain structure per kind, in SI units.

A driver uses what applies to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceSettings:
    """The DAQ board.

    Attributes
    ----------
    sample_rate_hz, block_samples : float, int
    device : str
        Name that the board has in its vendor's configuration program.
    channels : (str, str)
        Analog inputs of the normal and the shear sensor.
    wiring : str
        "differential", "rse" (against the board's ground) or "nrse" (against AI SENSE).
    range_v : (float, float)
        Each input is read from minus to plus this.
    buffer_s : float
        Data that the vendor's library holds while nobody reads.
    server : str
        host:port of the computer that the board is in; empty: this one.
    certificate : str
        File (PEM) of the authority that vouches for the server; empty: a plain connection.
    trigger : str
        "counter": pulses of a counter, in ticks of the board's 20 MHz, started with the samples;
        "digital": a line clocked by the samples.
    trigger_counter, trigger_terminal, trigger_line : str
        Counter and the terminal its pulses come out of (empty: the counter's own), or the digital
        line.
    exposure_counter, exposure_terminal : str
        Counter of the camera's exposures on the sample clock (empty: none), and the terminal that
        the camera's exposure output is wired to.
    """

    sample_rate_hz: float = 1000.0
    block_samples: int = 50
    device: str = "Dev1"
    channels: tuple[str, str] = ("ai0", "ai1")
    wiring: str = "differential"
    range_v: tuple[float, float] = (10.0, 10.0)
    buffer_s: float = 10.0
    server: str = ""
    certificate: str = ""
    trigger: str = "counter"
    trigger_counter: str = "ctr0"
    trigger_terminal: str = ""
    trigger_line: str = "port0/line0"
    exposure_counter: str = ""
    exposure_terminal: str = "PFI3"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """The triggered camera.

    Attributes
    ----------
    shape : (rows, columns)
    exposure_s : float
    sample_rate_hz : float
        Of the DAQ board, whose samples the exposure is counted in.
    device : str
        Serial number or name of the camera; empty: the only one there is.
    pixel_format : str
        "Mono8", or one with more bits ("Mono10", "Mono12", "Mono12p", "Mono12Packed", "Mono16"),
        which gives 16-bit images on the format's own scale (0 to 4095 for 12 bit).
    offset_px : (x, y)
        Top-left pixel of the image on the sensor.
    gain_db : float or None
        None: as the camera is set.
    trigger_line, exposure_line : str
        Input of the trigger (empty: trigger and exposure stay as the camera is set); output that is
        high while the camera exposes (empty: not set).
    producer : str
        GenTL producer (.cti) of the camera's vendor.
    folder : str
        Folder of images, for the camera that plays them.
    """

    shape: tuple[int, int] = (1200, 1600)
    exposure_s: float = 0.01
    sample_rate_hz: float = 1000.0
    device: str = ""
    pixel_format: str = "Mono8"
    offset_px: tuple[int, int] = (0, 0)
    gain_db: float | None = None
    trigger_line: str = "Line1"
    exposure_line: str = ""
    producer: str = ""
    folder: str = ""

    @property
    def exposure_samples(self) -> int:
        """Exposure in whole samples, one at least."""
        return max(1, round(self.exposure_s * self.sample_rate_hz))


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorSettings:
    """The drive of the block.

    Attributes
    ----------
    port : str
        "COM3", "/dev/ttyUSB0", or "socket://host:port" for a serial line over the network.
    address : int
        Number of the controller on its line.
    baud : int
        Speed of the line; 0: that of the model.
    travel_limits_m : (float, float)
        No target outside is ever sent; they are also given to the controller as its soft limits.
    velocity_limit_m_s : float
    """

    port: str = ""
    address: int = 1
    baud: int = 0
    travel_limits_m: tuple[float, float] = (-math.inf, math.inf)
    velocity_limit_m_s: float = 1e-3
