"""The settings of the simulated bench, beside those of the sample and of the devices."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.options import Section, number_in, option
from drivers.sim.faults import parse

MISTAKEN = {  # what a world may have otherwise than the settings say
    "camera": ("pixel",),
    "sample": ("young_modulus", "poisson", "lens_radius", "roughness", "lens_compliance"),
    "forces": ("stiffness_normal", "stiffness_shear", "sensitivity_normal", "sensitivity_shear"),
}
ADDED = {  # what is added to what the settings say, and up to how much
    "forces.zero_normal": 0.1,  # newtons
    "forces.zero_shear": 0.1,
    "forces.normal_from_shear": 0.2,  # share of Q in the reading of P
    "forces.shear_from_normal": 0.2,
}


def parse_error(text: str) -> tuple[str, str, float]:
    """Section, option and value of an entry of `SimSettings.errors`: a factor, or what is added
    (`ADDED`).

    Raises
    ------
    ValueError
        The message says what was found and what can be written.
    """
    name, _, factor = text.strip().partition(" ")
    section, _, option_name = name.partition(".")
    try:
        value = number_in(factor)
    except ValueError:
        value = 0.0
    if name in ADDED:
        is_known = factor.strip() != "" and 0 < abs(value) <= ADDED[name]
    else:
        is_known = option_name in MISTAKEN.get(section, ()) and 0.5 <= value <= 2
    if not is_known:
        known = ", ".join(f"{table}.{one}" for table, names in MISTAKEN.items() for one in names)
        added = ", ".join(f"{one} (up to {most:g})" for one, most in ADDED.items())
        raise ValueError(
            f"'{text}' found; write one of {known} and the true value over that of the settings,"
            f" 0.5 to 2, as in 'camera.pixel 1.01'; or one of {added} and what it reads too much,"
            " in N or as a share of the other force, as in 'forces.zero_shear 0.005'"
        )
    return section, option_name, value


@dataclass(frozen=True, kw_only=True)
class SimSettings(Section):
    """The simulated bench: one world, shared by all simulated devices."""

    seed: int = option(1, "Seed of all random numbers; the same seed gives the same bits", ge=0)
    law: str = option(
        "elasto-plastic",
        "Friction at each point: rigid until it slides, mu p (1 - exp(-s/(mu L))), or a table",
        choices=("cattaneo-mindlin", "elasto-plastic", "table"),
    )
    friction: float = option(0.93, "Friction coefficient mu of the interface, at 1 N", gt=0, le=5)
    friction_decay: float = option(
        0.0, "mu varies as the normal force to the power of minus this", ge=0, le=1
    )
    slip_length: float = option(0.8, "Length L of the elasto-plastic law", "um", gt=0, le=100)
    ageing: float = option(
        0.0,
        "Growth beta of the static friction after a hold in sliding, as a share of mu: beta ln(1 +"
        " t/ageing_time) (elasto-plastic)",
        ge=0,
        le=0.2,
    )
    ageing_time: float = option(
        1.0, "Time of a hold from which the contact ages", "s", gt=0, le=1000
    )
    ageing_slip: float = option(
        3.0, "Slip D_c over which the contact loses its ageing", "um", gt=0, le=1000
    )
    relaxation: float = option(
        0.0,
        "Share of the block's modulus at once that relaxes to sample.young_modulus"
        " (elasto-plastic); 0: an elastic block",
        ge=0,
        le=0.5,
    )
    relaxation_time: float = option(
        5.0, "Time constant with which it relaxes under a constant strain", "s", gt=0, le=10000
    )
    law_table: str = option(
        "",
        "CSV file for law = 'table': slip (um) and shear traction as a share of mu p, two columns",
    )
    pressure: str = option(
        "greenwood-tripp",
        "Pressure of the contact: of smooth faces, Greenwood and Tripp's of a face with"
        " sample.roughness (elasto-plastic, table), that of Johnson, Kendall and Roberts of smooth"
        " faces that adhere and are not driven, or that of pressure_table (elasto-plastic, table)",
        choices=("hertz", "greenwood-tripp", "jkr", "table"),
    )
    pressure_table: str = option(
        "",
        "CSV file for pressure = 'table': distance from the centre (mm) and pressure in any unit,"
        " falling to 0 in the last row, two columns; the distances are those under"
        " run.normal_force, to which the pressure is scaled",
    )
    adhesion: tuple[float, float] = option(
        (50.0, 50.0),
        "Work of adhesion as the faces come together, and as they part, which is not less (jkr)",
        "mJ/m2",
        ge=0,
        le=10000,
    )
    errors: tuple[str, ...] = option(
        (),
        "True values that differ from the settings, as factors: 'camera.pixel 1.01',"
        " 'forces.stiffness_shear 0.997'; or offsets of a sensor: 'forces.zero_shear 0.005' (N),"
        " 'forces.shear_from_normal 0.01' (of P); the manual, under simulation, lists them",
    )
    distortion: float = option(
        0.0,
        "Radial distortion of the lens: share by which the ideal position of an image corner is"
        " further out than the observed one",
        "%",
        ge=-5,
        le=5,
    )
    contact_offset: tuple[float, float] = option(
        (6.4, -4.7),
        "Position of the contact, (x, y) from the middle of the image",
        "px",
        ge=-16384,
        le=16384,
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
    sensor_delay: float = option(
        0.0, "Delay of the readings of both force sensors", "ms", ge=0, le=1000
    )
    sensor_filter: float = option(
        0.0,
        "Time constant of the low-pass of first order in the conditioner of both force sensors; 0:"
        " none",
        "ms",
        ge=0,
        le=1000,
    )
    hum: float = option(0.0, "Rms 50 Hz hum in the reading of each sensor", "mN", ge=0, le=1000)
    zero_drift: float = option(
        0.0, "Drift of the zero of each sensor in a minute", "mN", ge=-100, le=100
    )
    read_noise: float = option(
        1.0, "Standard deviation of the camera's read noise", "grey levels", ge=0, le=50
    )
    unequal_pixels: float = option(
        0.0,
        "Standard deviation of the gain of the camera's pixels, a pattern that stays in the image"
        " while the block moves",
        "%",
        ge=0,
        le=20,
    )
    dust: int = option(
        0,
        "Number of marks on the glass or on the camera's window, over the whole image, which stay"
        " in place while the block moves: 3 to 30 px wide, most of them dark",
        ge=0,
        le=10000,
    )
    full_well: float = option(
        20000.0,
        "Electrons at full scale, which determine the shot noise; 0: no shot noise",
        "electrons",
        ge=0,
    )
    press_time: float = option(
        1.25,
        "Time at which the simulated operator begins to press the contact",
        "s",
        ge=0,
        le=86400,
    )
    slow_actuator: bool = option(
        True, "The stage moves 2 to 5 % more slowly than commanded, as in the paper"
    )
    stage_drift: float = option(
        0.0, "Rate at which the stage creeps without reporting it", "um/s", ge=-1, le=1
    )
    backlash: float = option(
        0.0, "Motion that the stage loses at each reversal without reporting it", "um", ge=0, le=100
    )
    screw_error: float = option(
        0.0, "Amplitude of the periodic error of the stage's screw", "um", ge=0, le=5
    )
    screw_pitch: float = option(50.0, "Period of the error of the screw", "um", ge=35, le=10000)
    drive_angle: float = option(
        0.0,
        "Direction of the drive in the image, from its rows (+x) downwards, as with a rotated"
        " camera",
        "degrees",
        ge=-180,
        le=180,
    )
    lens_marks: int = option(
        0,
        "Height of a strip at the top of the image that shows marks on the lens, which move with"
        " it",
        "px",
        ge=0,
        le=2000,
    )
    readout: float = option(
        0.0,
        "Rolling shutter: time from the exposure of the top row of an image to that of the bottom"
        " row; negative: the bottom row comes first; 0: global shutter",
        "ms",
        ge=-1000,
        le=1000,
    )
    exposure_lag: float = option(0.0, "Delay of an exposure after its trigger", "ms", ge=0, le=100)
    camera_clock: float = option(
        0.0, "Share by which the camera's clock runs fast against the board's", ge=-0.01, le=0.01
    )
    faults: tuple[str, ...] = option(
        (),
        "Faults, and when they occur: 'lost-trigger 40', 'daq-overflow 5000 300'; the manual,"
        " under bench, lists them",
    )
    image_drift: tuple[float, float] = option(
        (0.0, 0.0),
        "Drift of the camera over the interface (x, y), as when the camera warms up",
        "px/s",
        ge=-100,
        le=100,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        closing, opening = (1e3 * work for work in self.adhesion)
        if closing > opening:
            raise ValueError(
                f"sim.adhesion: {closing:g} mJ/m2 of closing and {opening:g} of opening"
                " found; give a second number that is not less"
            )
        for name, texts, parser in (
            ("faults", self.faults, parse),
            ("errors", self.errors, parse_error),
        ):
            try:
                for text in texts:
                    parser(text)
            except ValueError as error:
                raise ValueError(f"sim.{name}: {error}") from None
