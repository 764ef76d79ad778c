"""The settings of the simulated bench, beside those of the sample and of the devices."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.options import Section, option
from drivers.sim.faults import parse


@dataclass(frozen=True, kw_only=True)
class SimSettings(Section):
    """The simulated bench: one world, seen by all simulated devices."""

    seed: int = option(1, "Seed of everything random: the same seed gives the same bits", ge=0)
    law: str = option(
        "cattaneo-mindlin",
        "Friction at each point: rigid until it slides, mu p (1 - exp(-s/(mu L))), or a table",
        choices=("cattaneo-mindlin", "elasto-plastic", "table"),
    )
    friction: float = option(0.93, "Friction coefficient mu of the interface, at 1 N", gt=0, le=5)
    friction_decay: float = option(
        0.0, "mu falls with the normal force like its power of minus this", ge=0, le=1
    )
    slip_length: float = option(0.8, "Length L of the elasto-plastic law", "um", gt=0, le=100)
    law_table: str = option(
        "",
        "CSV file for law = 'table': slip (um) and shear traction as a share of mu p, two columns",
    )
    thickness: float = option(
        0.0,
        "Thickness of the block on its rigid plate (elasto-plastic, table); 0: a half-space",
        "mm",
        ge=0,
    )
    renderer: str = option(
        "fast",
        "'fast' keeps up with the camera; 'exact' sums analytic blobs",
        choices=("fast", "exact"),
    )
    force_noise: float = option(
        1.0, "Standard deviation of the force noise of each sensor", "mN", ge=0, le=1000
    )
    read_noise: float = option(
        1.0, "Standard deviation of the camera's read noise", "grey levels", ge=0, le=50
    )
    full_well: float = option(
        20000.0,
        "Electrons at full scale, which set the shot noise; 0: no shot noise",
        "electrons",
        ge=0,
    )
    press_time: float = option(
        1.25, "When the simulated operator begins to press the contact", "s", ge=0, le=3600
    )
    slow_actuator: bool = option(
        True, "The stage moves 2 to 5 % more slowly than it is told, as in the paper"
    )
    stage_drift: float = option(
        0.0, "The stage creeps at this rate, which it does not report", "um/s", ge=-1, le=1
    )
    drive_angle: float = option(
        0.0,
        "Direction of the drive in the image, from its rows (+x) downwards, as of a turned camera",
        "degrees",
        ge=-180,
        le=180,
    )
    faults: tuple[str, ...] = option(
        (),
        "What goes wrong, and when: 'lost-trigger 40', 'daq-overflow 5000 300'; docs/bench.md lists"
        " them",
    )
    image_drift: tuple[float, float] = option(
        (0.0, 0.0), "Drift of the camera over the interface (x, y), as when it warms up", "px/s"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            for text in self.faults:
                parse(text)
        except ValueError as error:
            raise ValueError(f"sim.faults: {error}") from None
