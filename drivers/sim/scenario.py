"""What one simulated world is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from analysis.arrays import F64, I64
from analysis.settings import Sample
from drivers.settings import CameraSettings, ForceSettings
from drivers.sim.faults import Fault, parse
from drivers.sim.settings import ADDED, SimSettings, parse_error

Pair = tuple[float, float]
ADC_BITS = 16
PRESS_SHIFT_PX = (3.3, -1.7)
"""How far the block moves as a whole, (x, y), while it is pressed on."""


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """The settings of the bench that the world stands for, and what an operator does there.

    Attributes
    ----------
    sim, sample, forces, camera
        Sections of the settings.
    normal_force : float
        That the contact is pressed to, newtons.
    loads : tuple of (int, float)
        What it is pressed to, or released to, later on: the sample on which that begins, and
        newtons; in order, one settled before the next. Such a contact is not driven.
    press_samples : int, optional
        How long each pressing takes; None: one second.
    longest_hold : float
        For how long the stage will be held at most, seconds.
    weights : tuple of (int, float, float)
        What hangs on the sensors beside: the sample from which, and the newtons on the normal and
        the shear sensor, in order.
    """

    sim: SimSettings = field(default_factory=SimSettings)
    sample: Sample = field(default_factory=Sample)
    forces: ForceSettings = field(default_factory=ForceSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    normal_force: float = 0.5
    loads: tuple[tuple[int, float], ...] = ()
    press_samples: int | None = None
    longest_hold: float = 0.0
    weights: tuple[tuple[int, float, float], ...] = ()

    @classmethod
    def of(
        cls,
        *,
        sim: SimSettings,
        sample: Sample,
        forces: ForceSettings,
        camera: CameraSettings,
        normal_force: float,
        **operator: Any,
    ) -> Scenario:
        """The world behind a bench's settings, with the errors that `sim.errors` puts into them,
        and what the operator does: others of the attributes.
        """
        sections: dict[str, Any] = {"sample": sample, "forces": forces, "camera": camera}
        for text in sim.errors:
            section, name, value = parse_error(text)
            given = sections[section]
            if f"{section}.{name}" in ADDED:
                sections[section] = _misread(given, name, value)
            else:
                sections[section] = replace(given, **{name: value * getattr(given, name)})
        return cls(sim=sim, normal_force=normal_force, **sections, **operator)

    @property
    def mu(self) -> float:
        """Friction coefficient under the normal force."""
        return float(self.sim.friction * self.normal_force**-self.sim.friction_decay)

    @property
    def drive(self) -> Pair:
        """Unit vector of the drive in the image, (x, y)."""
        return math.cos(self.sim.drive_angle), math.sin(self.sim.drive_angle)

    @property
    def roughness(self) -> float:
        """Of the pressure, metres; 0: Hertz's."""
        return self.sample.roughness if self.sim.pressure == "greenwood-tripp" else 0.0

    @property
    def depth(self) -> float:
        """Thickness of the block in metres, infinite for a half-space."""
        return self.sim.thickness or math.inf

    @property
    def series_compliance(self) -> float:
        """Of the tangential cantilever and the lens holder together, metres per newton."""
        return self.sample.lens_compliance + 1 / self.forces.stiffness_shear

    @property
    def volts_per_step(self) -> float:
        """Resolution of the simulated board."""
        return 2 * max(self.forces.range) / (1 << ADC_BITS)

    @property
    def contact_centre_px(self) -> Pair:
        """Where the block touches the lens while there is no shear, (x, y) in the image."""
        rows, columns = self.camera.shape
        x, y = self.sim.contact_offset
        return (columns - 1) / 2 + x, (rows - 1) / 2 + y

    @cached_property
    def exposure_samples(self) -> int:
        """Exposure of the camera in samples."""
        return self.camera.exposure_samples(self.forces.sample_rate)

    @cached_property
    def frame_samples(self) -> int:
        """From the start of an exposure to the end of that of the last row."""
        return self.exposure_samples + math.ceil(self.readout_samples)

    @property
    def readout_samples(self) -> float:
        """From the exposure of the first row of an image to that of the last."""
        return abs(self.sim.readout) * self.forces.sample_rate

    @cached_property
    def press_sample(self) -> int:
        """Sample on which the pressing begins."""
        return round(self.sim.press_time * self.forces.sample_rate)

    @cached_property
    def settled_sample(self) -> int:
        """Sample from which on the normal force is constant, but for `loads`."""
        lasts = self.forces.sample_rate if self.press_samples is None else self.press_samples
        return self.press_sample + lasts

    def pressed(self, samples: I64, began: int) -> F64:
        """Share of the change of the normal force that began on a sample that is done, 0 to 1."""
        t = np.clip((samples - began + 1) / (self.settled_sample - self.press_sample + 1), 0.0, 1.0)
        return np.asarray(t * t * (3 - 2 * t))

    def load(self, samples: I64) -> F64:
        """The normal force on samples, newtons."""
        before = self.normal_force
        P = before * self.pressed(samples, self.press_sample)
        for began, load in self.loads:
            P, before = P + (load - before) * self.pressed(samples, began), load
        return P

    @property
    def speed_factor(self) -> float:
        """True velocity of the stage over the nominal one: 0.98 at 0.1 N, 0.952 at 1.4 N (paper,
        section 3).
        """
        if not self.sim.slow_actuator:
            return 1.0
        return float(np.interp(self.normal_force, [0.1, 1.4], [4.9, 4.76])) / 5

    @property
    def faults(self) -> tuple[Fault, ...]:
        """What goes wrong."""
        return tuple(map(parse, self.sim.faults))


def _misread(forces: ForceSettings, name: str, value: float) -> ForceSettings:
    """Sensors that read that much more than the settings say: newtons, or a share of the other
    force.
    """
    of, other = (0, 1) if name in ("zero_normal", "normal_from_shear") else (1, 0)
    if "_from_" in name:
        coupling = [list(row) for row in forces.coupling]
        coupling[of][other] += value
        (a, b), (c, d) = coupling
        return replace(forces, coupling=((a, b), (c, d)))
    zero = list(forces.zero)
    zero[of] += value / (forces.stiffness[of] * forces.sensitivity[of])
    return replace(forces, zero=(zero[0], zero[1]))
