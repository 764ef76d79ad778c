"""What a session is told, record by record, and what an experiment comes down to.

All records are frozen. Lengths, forces and times are in SI units unless the name says otherwise;
images and fields are arrays ``[row, col]``, places are (x, y). Each field names the dataset of the
session file that holds it, with its unit and meaning (`app.records.schema`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, Any, Literal

from msgspec import Meta

from analysis import arrays
from analysis.arrays import U8
from app.records.analog_channels import Channels
from app.records.effort import Effort
from app.records.pixel_pattern import PixelPattern
from app.records.schema import column, columns, record, uncertainty
from app.records.summary import UNMEASURED, Summary
from drivers.protocols import Frame, LostFrame

Index = Annotated[int, Meta(ge=0, lt=1 << 62)]
Number = Annotated[int, Meta(ge=-1, lt=1 << 62)]  # -1: none
Count = Annotated[int, Meta(ge=1, lt=1 << 62)]
Checksum = Annotated[int, Meta(ge=0, lt=1 << 32)]  # CRC-32
Positive = Annotated[float, Meta(ge=1e-12, le=1e12)]

F32 = arrays.F32
F64 = arrays.F64
NAN = math.nan
SUPERVISOR = "supervisor"  # kind of the event that no other process can stop the stage
REVOKED = "revoked"  # kind of the event that frames are uncertain from one on
COMPLETE = "complete"  # kind of the event that a run has done all that it was to do
ACCOUNT = "account"  # kind of the event that says what came of all triggers
REFERENCE = "reference"  # kind of the event that a frame was taken as reference
RESTART = "restart"  # kind of the event that the analysis of the frames began anew
STEP = "step"  # kind of the event that a step began, ``3 of 6: hold for 10 s``
NOTE = "note"  # kind of the event that the operator has noted something
ZERO = "zero"  # kind of the event that says what the sensors read without a force


class End(StrEnum):
    """How a run can have ended."""

    COMPLETE = "complete"  # it has done all that it was to do
    IMPORTED = "imported"  # a run of elsewhere was analysed
    PLAYED = "played"  # a recorded run was analysed once more
    STOPPED = "stopped"  # nobody knows what would have come: somebody ended it before
    FAILED = "failed"
    UNFINISHED = "unfinished"  # the program or the computer was cut off


# kinds of the event that a run has ended, by how
LAST = {End.COMPLETE: COMPLETE, End.STOPPED: "stop", End.FAILED: "error"}
ENDED = ("done", End.STOPPED, End.FAILED)  # the words for the end of a run that people see


class Phase(StrEnum):
    """The phases of a loading experiment, in their order on the sample clock."""

    BACKGROUND = "background"  # the block hangs free: images without contact
    CONTACT = "contact"  # the operator presses the block on, the normal force settles
    REFERENCE = "reference"  # t = 0: at rest under load, before any shear
    DRIVE = "drive"  # the actuator pulls
    END = "end"


# ---------------------------------------------------------------- what the bench measures


@record("/entry/source", since=4)
class SourceSession:
    """The session that holds the images of a further analysis."""

    session: str = column("session", "", "file name of the source, which lies in the same folder")
    started: str = column("start_time", "", "start_time of the source, which identifies it")


@record("/entry")
class Header:
    """What is known of a session from its beginning.

    Attributes
    ----------
    frame_shape : (int, int)
        Rows and columns of an image.
    frame_dtype : str
        Type of a pixel.
    versions : dict
        Name -> version of the programs and libraries in use, and of the computer.
    started : str
        Empty: now.
    sample, operator, note : str
        What the operator says of the run.
    source : SourceSession or None
        None where the images are in this session.
    compression : str
        Of the images in this session.
    pattern : PixelPattern or None
        What was undone in the pictures before they were correlated.
    """

    frame_shape: tuple[Index, Index]
    frame_dtype: Literal["uint8", "uint16"]
    versions: dict[str, str]
    config_toml: str = column("settings/toml", "", "complete settings of the run")
    sample_rate_hz: Positive = column(
        "clock/sample_rate", "Hz", "rate of the DAQ sample clock, the only time base"
    )
    first_trigger: Index = column("clock/first_trigger", "samples", "sample of trigger 0")
    divisor: Count = column("clock/divisor", "samples", "samples from one trigger to the next")
    exposure_samples: Count = column(
        "clock/exposure", "samples", "exposure time of an image, from its trigger on"
    )
    pixel_m: Positive = column("instrument/camera/pixel", "m", "side of a pixel on the interface")
    grid_x_px: F64 = column(
        "fields/x",
        "px",
        "box centres along x, the rows of the image; 0 is the centre of the first pixel",
        shape=("nx",),
    )
    grid_y_px: F64 = column("fields/y", "px", "box centres along y, downwards", shape=("ny",))
    started: str = column(
        "start_time",
        "",
        "time of day when the session was made, ISO 8601; nothing is computed from it",
        default="",
    )
    sample: str = column("sample/name", "", "name of the sample", since=7, default="")
    operator: str = column("user/name", "", "operator of the experiment", since=7, default="")
    note: str = column("notes/description", "", "note of the operator", since=7, default="")
    source: SourceSession | None = None
    compression: Literal["none", "gzip"] = "none"
    auxiliary: Channels | None = None
    pattern: PixelPattern | None = None


@record("/entry/forces", rows="samples")
class Samples:
    """Consecutive samples from number `first` on, as read (volts) and as forces (newtons).

    Both arrays have the shape (n, 2): normal, shear; `auxiliary` (n, k) has further channels in
    their units. Samples missing before `first` are a gap.
    """

    first: Index
    volts: F64 = columns(
        ("normal_sensor", "V", "reading of the normal sensor"),
        ("shear_sensor", "V", "reading of the shear sensor"),
    )
    forces: F64 = columns(
        ("normal_force", "N", "normal force P"), ("shear_force", "N", "shear force Q")
    )

    auxiliary: F64 | None = None

    def __post_init__(self) -> None:
        if self.volts.shape != self.forces.shape or self.volts.shape[1:] != (2,):
            found = f"volts {self.volts.shape}, forces {self.forces.shape}"
            raise ValueError(f"session: {found} must be (n, 2)")


@record("/entry/gaps", rows="gaps")
class Gap:
    """Samples that the board did not deliver, and why."""

    first: Index = column("first", "samples", "first missing sample")
    count: Index = column("count", "samples", "number of missing samples")
    reason: str


@record("/entry/triggers", rows="triggers")
class TriggerRow:
    """A trigger and its fate, as a session holds it."""

    index: int = column("index", "1", "trigger number, from 0")
    sample: int = column("sample", "samples", "sample on which the exposure started")
    image: int = column(
        "image", "1", "row of its image in camera/data (of the source, if any); -1: it was lost"
    )
    reason: str = column("reason", "", "why the frame was lost; empty where it was received")
    analysed: int = column("analysed", "1", "1: analysed during the run; 0: not", dtype="uint8")
    checksum: int = column(
        "checksum",
        "1",
        "CRC-32 of its image, row by row; 0 where the frame was lost",
        dtype="uint32",
        since=4,
    )
    first: int = column(
        "first", "1", "first trigger that can have taken its image, or that has none", since=4
    )
    last: int = column("last", "1", "last one; as `first` where it is certain", since=4)
    stamp_s: float = column(
        "stamp",
        "s",
        "time that the camera's own clock gave to its image; NaN where it gave none",
        since=9,
        default=math.nan,
    )

    @property
    def is_certain(self) -> bool:
        """Whether only one trigger can have its fate."""
        return self.first == self.last


@record("/entry/instrument/actuator", rows="positions")
class Position:
    """Where the stage was at a sample; NaN where it could not be read."""

    sample: Index = column("sample", "samples", "sample at which the position was read")
    position_m: float = column("position", "m", "position of the stage, in its own coordinate")


@record("/entry/events", rows="events")
class Event:
    """Something that happened at a sample: a change of phase, a limit, a stop. From a restart on,
    results rest on the background and the reference as if no frame had been analysed since.
    Nothing is computed from `text`, but that of a phase is its name.
    """

    sample: Index = column("sample", "samples", "sample at which it happened")
    kind: str = column(
        "kind",
        "",
        "phase, step, reversal, zero, answer, note, reference, gap, camera, account, import,"
        " analysis, quality, restart, recording, supervisor, revoked, complete, stop or error",
    )
    text: str = column("text", "", "description for readers; for a phase, its name")
    number: Number = column(
        "number",
        "1",
        "number of the step that began, or of the reference or first revoked frame; else -1",
        since=8,
        default=-1,
    )
    normal_v: float = column(
        "normal_zero", "V", "reading of the normal sensor at a zero; else 0", since=8, default=0.0
    )
    shear_v: float = column(
        "shear_zero", "V", "reading of the shear sensor at a zero; else 0", since=8, default=0.0
    )


# ---------------------------------------------------------------- what is computed on each frame


@record("/entry/results", rows="results")
class Conditions:
    """The state of the bench during an exposure; forces are means over it. Q and travel are along
    the drive, also of one against +x.
    """

    phase: Phase = column(
        "phase", "1", ", ".join(f"{n}: {phase}" for n, phase in enumerate(Phase)), dtype="uint8"
    )
    time_s: float = column(
        "time", "s", "middle of the exposure, counted from the start of the drive; NaN before it"
    )
    normal_force_n: float = column("normal_force", "N", "P, mean over the exposure")
    shear_force_n: float = column("shear_force", "N", "Q, mean over the exposure")
    travel_m: float = column(
        "stage_displacement", "m", "travel of the stage since the reference (delta)"
    )
    step: Index = column(
        "step", "1", "number of the protocol's step, from 1; 0: not known", since=7, default=0
    )
    step_time_s: float = column(
        "step_time",
        "s",
        "middle of the exposure, counted from the start of the step",
        since=7,
        default=NAN,
    )

    @property
    def has_forces(self) -> bool:
        """Whether P and Q are known, which a gap in the samples may hide."""
        return math.isfinite(self.normal_force_n + self.shear_force_n)


@record("/entry/results", rows="results")
class FrameMotion:
    """How far the lens and the contact's centre have moved since the reference, along the drive."""

    lens_m: float = column(
        "lens_displacement", "m", "motion of the lens since the reference, not taken off fields"
    )
    centre_ux_m: float = column("centre_ux", "m", "u_x at the contact's centre")
    centre_ux_sd_m: float = uncertainty("centre_ux", since=5, default=NAN)
    drive_angle_rad: float = column(
        "drive_angle",
        "rad",
        "direction of the drive in the picture, from +x towards +y (down), as used for this frame",
        since=5,
        default=NAN,
    )


@record("/entry/fields", rows="fields", shape=("ny", "nx"))
class DisplacementField:
    """Displacement of each box of the grid between the reference and the image, shape (ny, nx).

    The motion of the lens is still in it. Displacements, their standard uncertainties and the
    correlation are NaN where `status`, an `analysis.dic.Status`, is not 0.
    """

    ux_px: F32 = column("ux", "px", "displacement along x; NaN where status is not 0")
    uy_px: F32 = column("uy", "px", "displacement along y; NaN where status is not 0")
    ux_std_px: F32 = uncertainty("ux", since=2)
    uy_std_px: F32 = uncertainty("uy", since=2)
    zncc: F32 = column("zncc", "1", "correlation at the peak; NaN where status is not 0")
    status: U8 = column("status", "1", "0: measured; else why not")


@record("/entry/rings", rows="results", shape=("rings",))
class RingProfile:
    """Azimuthal mean of u_x about the contact's centre, shape (n,), the motion of the lens
    removed.
    """

    radius_m: F64 = column("radius", "m", "mean radius of the ring")
    ux_m: F64 = column("ux", "m", "azimuthal mean of u_x, lens compliance removed")
    sd_m: F64 = column("ux_errors", "m", "its standard error")


@record("/entry/results", rows="results")
class Stick:
    """The Cattaneo-Mindlin profile that fits the rings: stick radius c, and the traction mu p0 at
    the centre of a contact that slides as a whole.
    """

    stick_radius_m: float = column(
        "stick_radius", "m", "stick radius c; NaN where it cannot be determined"
    )
    stick_radius_sd_m: float = uncertainty("stick_radius")
    full_slip_pa: float = column(
        "full_slip_stress", "Pa", "mu p0 of the profile that gave stick_radius", since=3
    )
    reduced_chi2: float = column(
        "stick_chi2", "1", "reduced chi2 of that profile", since=5, default=NAN
    )


@record("/entry/results", rows="results", since=3)
class Traction:
    """What the shear traction under the rings says: c by the paper's definition, the displacement D
    of the block far away, the force.
    """

    peak_radius_m: float = column("peak_radius", "m", "c, where the shear traction is largest")
    peak_radius_sd_m: float = uncertainty("peak_radius")
    block_m: float = column(
        "block_displacement",
        "m",
        "D, displacement of the block far from the contact, from the inversion",
    )
    block_sd_m: float = uncertainty("block_displacement")
    stress_force_n: float = column("stress_force", "N", "integral of the shear traction")
    stress_force_sd_n: float = uncertainty("stress_force")


@record("/entry/stress", rows="results", shape=("radii",), since=3)
class StressProfile:
    """Azimuthal mean of the shear traction sigma_xz about the contact's centre, shape (n,)."""

    radius_m: F64 = column("radius", "m", "distance from the contact's centre")
    stress_pa: F64 = column("stress", "Pa", "azimuthal mean of the shear traction sigma_xz")
    sd_pa: F64 = uncertainty("stress")


@record("/entry/results", rows="results")
class Snapshot:
    """All results of one frame; a part is None where it could not be computed.

    Attributes
    ----------
    frame, sample : int
        Trigger number, and the sample on which the exposure started.
    conditions : Conditions
    motion, field, rings : optional
        From the reference on.
    stick, traction, stress : optional
        During the drive.
    stress_field_pa : ndarray, shape (ny, nx), float32, or None
        Shear traction of each grid point, where the settings ask for it, by a few iterations from
        that of the frame before: large shapes are right, fine detail is not converged. It is not
        recorded: the displacement fields give it again.
    effort : Effort
    """

    frame: Index = column("frame", "1", "trigger number of the frame, in the order of analysis")
    sample: Index = column("sample", "samples", "sample on which its exposure started")
    conditions: Conditions
    motion: FrameMotion | None = None
    field: DisplacementField | None = None
    rings: RingProfile | None = None
    stick: Stick | None = None
    traction: Traction | None = None
    stress: StressProfile | None = None
    stress_field_pa: F32 | None = None
    effort: Effort = Effort()

    @property
    def stick_radius(self) -> tuple[float, float]:
        """Stick radius c and its standard uncertainty, metres: where the traction is largest or,
        where there is none, of the profile that fits the rings; NaN for neither.
        """
        traction, stick = self.traction, self.stick
        if traction and math.isfinite(traction.peak_radius_m):
            return traction.peak_radius_m, traction.peak_radius_sd_m
        return (stick.stick_radius_m, stick.stick_radius_sd_m) if stick else (NAN, NAN)


# ---------------------------------------------------------------- what an experiment comes down to


@record("/entry")
class ContactResult:
    """The apparent contact on the reference frame (paper, section 2.3.1); NaN: not measured."""

    centre_px: tuple[float, float] = column("contact/centre", "px", "centre of the contact (x, y)")
    apparent_radius_m: float = column("contact/radius", "m", "apparent contact radius a")
    apparent_radius_sd_m: float = uncertainty("contact/radius")
    shift_px: tuple[float, float] = column(
        "contact/shift", "px", "rigid shift from the background to the reference image (x, y)"
    )
    profile_radius_px: F64 = column(
        "profile/radius", "px", "radius about the contact's centre", shape=("profile",)
    )
    profile_grey: F64 = column(
        "profile/grey", "counts", "azimuthal mean of the background difference", shape=("profile",)
    )


@record("/entry/counts")
class Counts:
    """The account of a run: every trigger has a fate, every sample is there."""

    triggers: Index = column("triggers", "1", "triggers sent", default=0)
    frames_received: Index = column("frames_received", "1", "frames received", default=0)
    frames_recorded: Index = column("frames_recorded", "1", "frames in this file", default=0)
    frames_lost: Index = column("frames_lost", "1", "triggers without a frame", default=0)
    frames_analysed: Index = column(
        "frames_analysed", "1", "frames analysed during the run", default=0
    )
    frames_skipped: Index = column(
        "frames_skipped", "1", "frames recorded but not analysed during the run", default=0
    )
    samples: Index = column("samples", "1", "force samples received", default=0)
    samples_lost: Index = column("samples_lost", "1", "force samples lost", default=0)


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended, the reason in one sentence, and its account.

    `resources` says what the run took of the computer, see `app.records.effort.Resources`, and
    holds its receipt.
    """

    end: End
    reason: str
    counts: Counts
    summary: Summary | None
    resources: dict[str, Any] = field(default_factory=dict)

    @property
    def measured(self) -> Summary:
        """The summary, also of a run without one."""
        return self.summary or UNMEASURED

    @property
    def is_complete(self) -> bool:
        """Whether the run came to its own end: nobody and nothing ended it before."""
        return self.end is End.COMPLETE

    @property
    def state(self) -> str:
        """``failed`` or ``unfinished``, or else ``done``."""
        return str(self.end) if self.end in (End.FAILED, End.UNFINISHED) else "done"

    @property
    def ended_as(self) -> str:
        """How it ended, for people: as `state`, but ``stopped`` where somebody ended it before."""
        return str(self.end) if self.end is End.STOPPED else self.state


Acquired = Samples | Gap | Frame | LostFrame | TriggerRow | Position
Record = Acquired | Event | Snapshot | ContactResult | Outcome
