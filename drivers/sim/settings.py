"""What the simulated world is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drivers.sim.faults import Fault

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldSettings:
    """What the simulated world is made of. SI units; pairs are (normal, shear) or (x, y),
    `image_shape` is (rows, columns).

    `press_duration` is in samples, None for one second. `press_shift_px` is how far the block moves
    as a whole while it is pressed on, `contact_offset_px` where it touches, from the middle of the
    image. `full_well` is in electrons, 0 for no shot noise, and `read_noise` in grey levels.
    `count_exposures`: the board counts the camera's exposures beside the samples. `faults`: what
    goes wrong.
    """

    seed: int = 1
    normal_force_n: float = 0.5
    law: str = "cattaneo-mindlin"
    friction: float = 0.93
    friction_decay: float = 0.0
    slip_length_m: float = 0.8e-6
    table: tuple[Pair, ...] = ()
    young_modulus_pa: float = 3.43e6
    poisson: float = 0.5
    thickness_m: float = math.inf
    lens_radius_m: float = 128.8e-3
    roughness_m: float = 0.595e-6
    lens_compliance_m_per_n: float = 0.68e-6
    stiffness_n_per_m: Pair = (689.0, 9579.0)
    sensitivity_m_per_v: Pair = (300e-6, 22e-6)
    zero_v: Pair = (0.0, 0.0)
    coupling: tuple[Pair, Pair] = ((1.0, 0.004), (0.008, 1.0))
    force_noise_n: float = 1e-3
    adc_bits: int = 16
    adc_range_v: float = 10.0
    sample_rate_hz: float = 1000.0
    block_samples: int = 50
    exposure_samples: int = 10
    pixel_m: float = 7.04e-6
    image_shape: tuple[int, int] = (1200, 1600)
    press_sample: int = 1250
    press_duration: int | None = None
    press_shift_px: Pair = (3.3, -1.7)
    contact_offset_px: Pair = (6.4, -4.7)
    slow_actuator: bool = True
    drive_angle: float = 0.0
    stage_drift_m_s: float = 0.0
    image_drift_px_s: Pair = (0.0, 0.0)
    read_noise: float = 1.0
    full_well: float = 20000.0
    renderer: str = "fast"
    count_exposures: bool = False
    faults: tuple[Fault, ...] = ()

    @property
    def mu(self) -> float:
        """Friction coefficient under the normal force."""
        return float(self.friction * self.normal_force_n**-self.friction_decay)

    @property
    def drive(self) -> Pair:
        """Unit vector of the drive in the image, (x, y)."""
        return math.cos(self.drive_angle), math.sin(self.drive_angle)

    @property
    def contact_centre_px(self) -> Pair:
        """Where the block touches the lens, (x, y) in the image, as long as there is no shear."""
        rows, columns = self.image_shape
        return (columns - 1) / 2 + self.contact_offset_px[0], (
            rows - 1
        ) / 2 + self.contact_offset_px[1]

    @property
    def settled_sample(self) -> int:
        """Sample from which on the normal force is constant."""
        return self.press_sample + (
            round(self.sample_rate_hz) if self.press_duration is None else self.press_duration
        )

    @property
    def speed_factor(self) -> float:
        """True over asked velocity of the stage: 0.98 at 0.1 N down to 0.952 at 1.4 N, as in the
        paper's section 3.
        """
        return (
            float(np.interp(self.normal_force_n, [0.1, 1.4], [4.9, 4.76])) / 5
            if self.slow_actuator
            else 1.0
        )
