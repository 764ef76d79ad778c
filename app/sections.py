"""Every option of SlipScope: the only place where one is declared, with default, unit, limits and
the sentence that explains it.
"""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct


class Section(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every table of the settings file."""


def _f(text: str, unit: str = "", **limits: Any) -> Meta:
    return Meta(description=text, extra={"unit": unit}, **limits)


class Run(Section, frozen=True):
    """The loading experiment."""

    normal_force: Annotated[
        float, _f("Normal force P the contact is pressed to", "N", gt=0, le=10)
    ] = 0.5
    velocity: Annotated[float, _f("Velocity asked of the actuator", "um/s", gt=0, le=1000)] = 5.0
    travel: Annotated[
        float,
        _f("Stage travel of the drive; the actuator is never asked for more", "um", gt=0, le=20000),
    ] = 190.0
    background_time: Annotated[
        float,
        _f(
            "Images of the free block are taken for this long before contact; 0: none, the"
            " apparent radius is not measured",
            "s",
            ge=0,
            le=60,
        ),
    ] = 1.0
    contact_timeout: Annotated[
        float, _f("How long the operator has to press the contact to P", "s", gt=0, le=3600)
    ] = 120.0
    settle_time: Annotated[
        float, _f("P must stay within settle_tolerance for this long", "s", gt=0, le=600)
    ] = 1.0
    settle_tolerance: Annotated[
        float, _f("Allowed distance of P from normal_force, as a fraction of it", "", gt=0, le=0.5)
    ] = 0.02
    shear_tolerance: Annotated[
        float,
        _f(
            "Allowed initial |Q|, as a fraction of P; above it the contact must be renewed",
            "",
            gt=0,
            le=1,
        ),
    ] = 0.01
    reference_time: Annotated[
        float,
        _f(
            "Rest under load in which the reference image is taken, before the drive",
            "s",
            gt=0,
            le=60,
        ),
    ] = 1.5


class Forces(Section, frozen=True):
    """The DAQ board and the two capacitive sensors."""

    source: Annotated[str, _f("Driver of the DAQ board; `slipscope doctor` lists them")] = "sim"
    device: Annotated[str, _f("Name of the board in NI MAX")] = "Dev1"
    server: Annotated[
        str,
        _f("host:port of the NI gRPC device server that the board is behind; empty: this computer"),
    ] = ""
    certificate: Annotated[
        str, _f("File (PEM) that vouches for the server; empty: a plain connection")
    ] = ""
    channels: Annotated[tuple[str, str], _f("Analog inputs of the normal and the shear sensor")] = (
        "ai0",
        "ai1",
    )
    wiring: Annotated[
        str,
        _f(
            "How they are wired, rse and nrse against ground or AI SENSE",
            pattern="^(differential|rse|nrse)$",
        ),
    ] = "differential"
    range: Annotated[
        tuple[float, float], _f("Each input is read from minus to plus this (normal, shear)", "V")
    ] = (10.0, 10.0)
    buffer: Annotated[
        float, _f("Data the vendor's library holds while nobody reads", "s", ge=1, le=600)
    ] = 10.0
    on_overflow: Annotated[
        str,
        _f(
            "When samples were lost, as a gap: the run ends, or goes on", pattern="^(end|continue)$"
        ),
    ] = "end"
    trigger: Annotated[
        str,
        _f(
            "Camera triggers from a counter's pulses or a line clocked by the samples",
            pattern="^(counter|digital)$",
        ),
    ] = "counter"
    trigger_counter: Annotated[str, _f("Counter of the trigger pulses")] = "ctr0"
    trigger_terminal: Annotated[
        str, _f("Terminal the pulses come out of; empty: the counter's own (PFI12 for ctr0)")
    ] = ""
    trigger_line: Annotated[str, _f("Line of the trigger, for trigger = 'digital'")] = "port0/line0"
    exposure_counter: Annotated[
        str,
        _f(
            "Counter of the camera's exposures, which proves the number of each frame; empty: none,"
            " e.g. 'ctr1'"
        ),
    ] = ""
    exposure_terminal: Annotated[
        str, _f("Terminal that the camera's exposure output is wired to")
    ] = "PFI3"
    sample_rate: Annotated[
        int, _f("Sampling rate: the clock of everything", "Hz", ge=100, le=100000)
    ] = 1000
    block: Annotated[int, _f("Samples read at a time", "samples", ge=1, le=10000)] = 50
    sensitivity_normal: Annotated[
        float, _f("Displacement per volt of the normal sensor", "um/V", gt=0, le=10000)
    ] = 300.0
    sensitivity_shear: Annotated[
        float, _f("Displacement per volt of the shear sensor", "um/V", gt=0, le=10000)
    ] = 22.0
    stiffness_normal: Annotated[
        float, _f("Stiffness k_N of the normal cantilever", "N/m", gt=0, le=1e7)
    ] = 689.0
    stiffness_shear: Annotated[
        float, _f("Stiffness K_T of the tangential cantilever", "N/m", gt=0, le=1e7)
    ] = 9579.0
    stiffness_uncertainty: Annotated[
        tuple[float, float], _f("Standard uncertainties of k_N and K_T", "N/m")
    ] = (5.0, 25.0)
    sign: Annotated[
        tuple[int, int],
        _f("1 or -1 (normal, shear): -1 where a sensor's voltage falls as its force grows"),
    ] = (1, 1)
    zero: Annotated[tuple[float, float], _f("Sensor readings at no force (normal, shear)", "V")] = (
        0.0,
        0.0,
    )
    coupling: Annotated[
        tuple[tuple[float, float], tuple[float, float]],
        _f("Cross-coupling: reading = coupling x (P, Q); undone by its inverse"),
    ] = ((1.0, 0.004), (0.008, 1.0))


class Camera(Section, frozen=True):
    """The triggered camera."""

    source: Annotated[str, _f("Driver of the camera; `slipscope doctor` lists them")] = "sim"
    device: Annotated[
        str,
        _f(
            "Serial number or name of the camera (`slipscope cameras`); empty: the only one there"
            " is"
        ),
    ] = ""
    producer: Annotated[
        str, _f("GenTL producer (.cti) of the camera's vendor, for source = 'gentl'")
    ] = ""
    folder: Annotated[str, _f("Folder of images, for source = 'folder'")] = ""
    pixel_format: Annotated[
        str,
        _f(
            "More than 8 bit gives 16-bit images on the format's own scale",
            pattern="^(Mono8|Mono10|Mono12|Mono12p|Mono12Packed|Mono16)$",
        ),
    ] = "Mono8"
    offset: Annotated[
        tuple[int, int], _f("Top-left pixel (x, y) of the image on the sensor", "px")
    ] = (0, 0)
    gain: Annotated[float, _f("Gain; -1: as the camera is set", "dB", ge=-1, le=60)] = -1.0
    trigger_line: Annotated[
        str,
        _f(
            "Input of the camera that the triggers come in on; empty: trigger and exposure as the"
            " camera is set"
        ),
    ] = "Line1"
    exposure_line: Annotated[
        str,
        _f(
            "Output that tells when the camera exposes, for forces.exposure_counter; empty: not set"
        ),
    ] = ""
    divisor: Annotated[
        int,
        _f(
            "Samples per trigger: 125 is 8 frames/s at 1 kHz, 250 is 4", "samples", ge=1, le=1000000
        ),
    ] = 125
    max_rate: Annotated[
        float, _f("Fastest trigger rate the camera follows", "frames/s", gt=0, le=10000)
    ] = 24.0
    width: Annotated[int, _f("Image width", "px", ge=64, le=16384)] = 1600
    height: Annotated[int, _f("Image height", "px", ge=64, le=16384)] = 1200
    pixel: Annotated[float, _f("Size of a pixel on the interface", "um", gt=0, le=1000)] = 7.04
    exposure: Annotated[float, _f("Exposure time", "ms", gt=0, le=1000)] = 10.0


class Actuator(Section, frozen=True):
    """The DC actuator that drives the block."""

    source: Annotated[str, _f("Driver of the actuator; `slipscope doctor` lists them")] = "sim"
    port: Annotated[str, _f("Serial port, 'COM3' or '/dev/ttyUSB0', or 'socket://host:port'")] = ""
    address: Annotated[int, _f("Number of the controller on its line", "", ge=1, le=31)] = 1
    baud: Annotated[
        int, _f("Speed of the line; 0: that of the model", "baud", ge=0, le=4000000)
    ] = 0
    travel: Annotated[
        tuple[float, float], _f("The stage is never asked to leave these positions", "mm")
    ] = (0.0, 25.0)
    max_velocity: Annotated[float, _f("Nor to go faster", "um/s", gt=0, le=1e5)] = 1000.0


class Limits(Section, frozen=True):
    """Beyond these the actuator stops and the run ends by name."""

    shear_force: Annotated[float, _f("Greatest |Q|", "N", gt=0, le=100)] = 1.9
    normal_force: Annotated[float, _f("Greatest P", "N", gt=0, le=100)] = 1.9
    travel: Annotated[
        float, _f("Greatest stage travel from the start of the drive", "um", gt=0, le=20000)
    ] = 500.0


class Sample(Section, frozen=True):
    """The block, the lens, and what holds them."""

    young_modulus: Annotated[float, _f("Young's modulus E of the block", "MPa", gt=0, le=1e6)] = (
        3.43
    )
    poisson: Annotated[float, _f("Poisson's ratio of the block", "", ge=0, le=0.5)] = 0.5
    lens_radius: Annotated[float, _f("Radius of curvature R of the lens", "mm", gt=0, le=1e5)] = (
        128.8
    )
    roughness: Annotated[
        float, _f("Standard deviation h of the heights of the rough surface", "um", ge=0, le=1000)
    ] = 0.595
    thickness: Annotated[
        float,
        _f(
            "Thickness of the block on its rigid plate, for the traction; 0: a half-space",
            "mm",
            ge=0,
            le=1e4,
        ),
    ] = 0.0
    lens_compliance: Annotated[
        float, _f("Displacement of the lens holder per newton of Q", "um/N", ge=0, le=100)
    ] = 0.68


class Dic(Section, frozen=True):
    """Digital image correlation of each frame with the reference."""

    method: Annotated[
        str,
        _f(
            "Passes over the image, IC-GN box by box, the paper's search",
            pattern="^(shared|icgn|direct)$",
        ),
    ] = "shared"
    box: Annotated[int, _f("Side of the correlation box", "px", ge=4, le=200)] = 20
    step: Annotated[int, _f("Pitch of the grid of boxes", "px", ge=1, le=200)] = 10
    order: Annotated[
        int,
        _f(
            "Deformation of a box in icgn: 0 shift, 1 and its gradient, 2 and its curvature",
            "",
            ge=0,
            le=2,
        ),
    ] = 1
    interpolant: Annotated[
        str,
        _f(
            "How images are read between pixels",
            pattern="^(matched|bilinear|bicubic|bspline3|bspline5|sinc6|sinc8)$",
        ),
    ] = "matched"
    precision: Annotated[
        str, _f("Arithmetic; double in icgn only", pattern="^(single|double)$")
    ] = "single"
    tolerance: Annotated[
        float,
        _f("A step shorter than this is the last; 0: the method's own limit", "px", ge=0, le=1),
    ] = 0.0
    search: Annotated[
        int, _f("Largest jump between two images that must be found", "px", ge=1, le=200)
    ] = 64
    min_correlation: Annotated[
        float, _f("A point whose correlation is lower is lost", "", ge=0, lt=1)
    ] = 0.5
    min_contrast: Annotated[
        float,
        _f("A box whose standard deviation is smaller is not correlated", "grey levels", ge=0),
    ] = 2.0
    max_saturated: Annotated[
        float, _f("Share of a box that may be at full scale (shared, icgn)", "", ge=0, le=1)
    ] = 0.2
    full_scale: Annotated[
        int,
        _f(
            "End of the grey scale, 4095 for 12 bit; 0: of the image type",
            "grey levels",
            ge=0,
            le=65535,
        ),
    ] = 0
    update: Annotated[
        str, _f("When an image becomes the new reference", pattern="^(never|every|quality)$")
    ] = "never"
    update_every: Annotated[
        int, _f("Images from one reference to the next, for update = every", "images", ge=1)
    ] = 100
    update_below: Annotated[
        float,
        _f(
            "Median correlation that asks for a new reference, for update = quality", "", ge=0, le=1
        ),
    ] = 0.8
    threads: Annotated[
        int, _f("Threads that share a field; the result does not depend on it", "", ge=1, le=64)
    ] = 2


class Stress(Section, frozen=True):
    """The shear traction sigma_xz, from the displacement field by the Green's tensor of the block."""

    method: Annotated[
        str,
        _f(
            "Profile about the contact's centre on every frame, or none",
            pattern="^(axisymmetric|none)$",
        ),
    ] = "axisymmetric"
    field: Annotated[
        bool, _f("The traction of every grid point as well, by conjugate gradients", "")
    ] = False


class Recording(Section, frozen=True):
    """The session file."""

    flush_interval: Annotated[float, _f("Time between flushes to disk", "s", gt=0, le=0.5)] = 0.4
    queue: Annotated[
        float, _f("Data the recorder's queue holds before the run ends by name", "s", gt=0, le=60)
    ] = 4.0
    compression: Annotated[
        str,
        _f(
            "Of the images; gzip: a tenth smaller, for 30 ms of processor each",
            pattern="^(none|gzip)$",
        ),
    ] = "none"


class Replay(Section, frozen=True):
    """The recorded experiment that a bench plays where a source is "replay"."""

    session: Annotated[str, _f("Session file")] = ""


class Sim(Section, frozen=True):
    """The simulated bench: one world, seen by all simulated devices."""

    seed: Annotated[int, _f("Seed of everything random; same seed, same bits", "", ge=0)] = 1
    law: Annotated[
        str,
        _f(
            "Friction at each point: rigid and sliding, mu p (1 - exp(-s/(mu L))), or a table",
            pattern="^(cattaneo-mindlin|elasto-plastic|table)$",
        ),
    ] = "cattaneo-mindlin"
    friction: Annotated[
        float, _f("Friction coefficient mu of the interface, at 1 N", "", gt=0, le=5)
    ] = 0.93
    friction_decay: Annotated[
        float, _f("mu falls with the normal force like its power of minus this", "", ge=0, le=1)
    ] = 0.0
    slip_length: Annotated[float, _f("Length L of the elasto-plastic law", "um", gt=0, le=100)] = (
        0.8
    )
    law_table: Annotated[
        str,
        _f(
            "For law = 'table': CSV file of slip (um) and shear traction as a share of mu p, two"
            " columns"
        ),
    ] = ""
    thickness: Annotated[
        float,
        _f(
            "Thickness of the block on its rigid plate (elasto-plastic, table); 0: a half-space",
            "mm",
            ge=0,
        ),
    ] = 0.0
    renderer: Annotated[
        str,
        _f(
            "'fast' keeps up with the camera; 'exact' sums analytic blobs", pattern="^(fast|exact)$"
        ),
    ] = "fast"
    force_noise: Annotated[
        float, _f("Standard deviation of the force noise of each sensor", "mN", ge=0, le=1000)
    ] = 1.0
    read_noise: Annotated[
        float, _f("Standard deviation of the camera's read noise", "grey levels", ge=0, le=50)
    ] = 1.0
    full_well: Annotated[
        float,
        _f("Electrons at full scale (sets the shot noise); 0: no shot noise", "electrons", ge=0),
    ] = 20000.0
    press_time: Annotated[
        float, _f("When the simulated operator begins to press the contact", "s", ge=0, le=3600)
    ] = 1.25
    slow_actuator: Annotated[
        bool, _f("The stage really moves 2 to 5 % slower than asked, as in the paper", "")
    ] = True
    stage_drift: Annotated[
        float, _f("The stage creeps by this besides what it reports", "um/s", ge=-1, le=1)
    ] = 0.0
    drive_angle: Annotated[
        float, _f("Angle of the drive to the rows of the image", "degrees", ge=-10, le=10)
    ] = 0.0
    faults: Annotated[
        tuple[str, ...],
        _f(
            "What goes wrong, and when: 'lost-trigger 40', 'daq-overflow 5000 300'; the README"
            " lists them"
        ),
    ] = ()
    image_drift: Annotated[
        tuple[float, float],
        _f("The camera drifts over the interface (x, y), as when it warms up", "px/s"),
    ] = (0.0, 0.0)


class Config(Section, frozen=True):
    """A bench and what to do with it."""

    run: Run = Run()
    forces: Forces = Forces()
    camera: Camera = Camera()
    actuator: Actuator = Actuator()
    limits: Limits = Limits()
    sample: Sample = Sample()
    dic: Dic = Dic()
    stress: Stress = Stress()
    recording: Recording = Recording()
    replay: Replay = Replay()
    sim: Sim = Sim()
