"""What the analysis hands to the disk, the screen and the report: frozen, plain arrays, units in
the names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class Phase(StrEnum):
    """The parts of a loading experiment, in their order on the sample clock."""

    BACKGROUND = "background"  # the block hangs free: images without contact
    CONTACT = "contact"  # the operator presses it on, the normal force settles
    REFERENCE = "reference"  # t = 0: at rest under load, before any shear
    DRIVE = "drive"  # the actuator pulls
    END = "end"


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a sample: a change of phase, a limit, a stop."""

    sample: int
    kind: str  # "phase", "reference", "gap", "import", "analysis", "stop", "error"
    text: str


@dataclass(frozen=True, slots=True)
class Source:
    """The session that holds the images of a further analysis: the name of its file and when it was
    made.
    """

    session: str
    started: str


@dataclass(frozen=True, slots=True)
class ContactResult:
    """The apparent contact on the reference frame (paper, section 2.3.1).

    `centre_px` is (x, y). `profile_*` is the azimuthally averaged background difference. NaN: not
    measured.
    """

    centre_px: tuple[float, float]
    apparent_radius_m: float
    apparent_radius_sd_m: float
    shift_px: tuple[float, float]
    profile_radius_px: F64
    profile_grey: F64


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything the pipeline found on one frame.

    Attributes
    ----------
    frame, sample : int
        Trigger number and the sample on which its exposure started.
    phase : Phase
    time_s : float
        Middle of the exposure, counted from the start of the drive; NaN before it.
    normal_force_n, shear_force_n : float
        Means over the exposure.
    travel_m : float
        Stage displacement since the reference (delta of the paper's Fig. 5).
    lens_m : float
        Displacement of the lens since the reference, by the compliance of its holder: to be taken
        off `ux_px`. NaN before the reference.
    ux_px, uy_px, zncc : ndarray, shape (ny, nx), float32
        Displacement from the reference in the image (lens compliance not removed) and correlation
        at the peak; NaN where `status` is not 0. Empty (0, 0) before there is a reference.
    ux_std_px, uy_std_px : ndarray, shape (ny, nx), float32
        Standard uncertainty of the displacement; NaN or empty likewise.
    status : ndarray, shape (ny, nx), uint8
        `analysis.dic.Status`.
    ring_radius_m, ring_ux_m, ring_sd_m : ndarray, shape (nr,)
        Azimuthal mean of u_x about the contact's centre, lens compliance removed, and its standard
        error.
    centre_ux_m : float
        u_x at the contact's centre, lens compliance removed (parabola through the innermost 0.3 a).
    stick_radius_m, stick_radius_sd_m : float
        c from the Cattaneo-Mindlin profile fit; NaN where it can not be told.
    full_slip_pa : float
        mu p0 of that profile: with c it gives Cattaneo and Mindlin's traction.
    peak_radius_m, peak_radius_sd_m : float
        c from the maximum of the shear traction, the paper's definition.
    block_m, block_sd_m : float
        Displacement D of the block far from the contact, as the inversion finds it.
    stress_force_n, stress_force_sd_n : float
        Integral of the shear traction.
    stress_radius_m, stress_pa, stress_sd_pa : ndarray, shape (ns,)
        Azimuthal mean of the shear traction sigma_xz about the contact's centre; empty where it was
        not inverted.
    stress_field_pa : ndarray, shape (ny, nx), float32
        Shear traction of each grid point, where the settings ask for it; else empty. It is not
        recorded: the fields give it again.
    """

    frame: int
    sample: int
    phase: Phase
    time_s: float
    normal_force_n: float
    shear_force_n: float
    travel_m: float
    lens_m: float
    ux_px: F32
    uy_px: F32
    ux_std_px: F32
    uy_std_px: F32
    zncc: F32
    status: NDArray[np.uint8]
    ring_radius_m: F64
    ring_ux_m: F64
    ring_sd_m: F64
    centre_ux_m: float
    stick_radius_m: float
    stick_radius_sd_m: float
    full_slip_pa: float = math.nan
    peak_radius_m: float = math.nan
    peak_radius_sd_m: float = math.nan
    block_m: float = math.nan
    block_sd_m: float = math.nan
    stress_force_n: float = math.nan
    stress_force_sd_n: float = math.nan
    stress_radius_m: F64 = field(default_factory=lambda: np.empty(0))
    stress_pa: F64 = field(default_factory=lambda: np.empty(0))
    stress_sd_pa: F64 = field(default_factory=lambda: np.empty(0))
    stress_field_pa: F32 = field(default_factory=lambda: np.empty((0, 0), np.float32))


def without_fields(snapshot: Snapshot) -> Snapshot:
    """The snapshot's numbers and rings alone: what a long series can keep in memory."""
    fields: dict[str, Any] = dict.fromkeys(
        ("ux_px", "uy_px", "ux_std_px", "uy_std_px", "zncc", "stress_field_pa"),
        np.empty((0, 0), np.float32),
    )
    return replace(snapshot, **fields, status=np.empty((0, 0), np.uint8))


@dataclass(frozen=True, slots=True)
class Summary:
    """What a loading experiment comes down to; NaN where the run did not go far enough, with the
    reason in `notes`.

    Radii and times in metres and seconds, forces in newtons; `*_sd` is a standard uncertainty,
    `mu_d_range` the least and greatest Q/P during sliding (the paper's error bar). `calibration_sd`
    is the relative uncertainty that the stiffness of the cantilevers adds to every friction
    coefficient, and is in no other. `law_*` is the local friction law mu p (1 - exp(-s/(mu L))).
    """

    normal_force_n: float
    apparent_radius_m: float
    apparent_radius_sd_m: float
    hertz_radius_m: float
    onset_time_s: float
    onset_time_sd_s: float
    static_force_n: float
    mu_s: float
    mu_s_sd: float
    mu_d: float
    mu_d_range: tuple[float, float]
    sliding_velocity_m_s: float
    notes: tuple[str, ...] = ()
    law_mu: float = math.nan
    law_mu_sd: float = math.nan
    law_length_m: float = math.nan
    law_length_sd_m: float = math.nan
    young_modulus_pa: float = math.nan
    young_modulus_sd_pa: float = math.nan
    calibration_sd: float = math.nan


@dataclass(frozen=True, slots=True)
class Counts:
    """The account of a run: every trigger has a fate, every sample is there."""

    triggers: int = 0
    frames_received: int = 0
    frames_recorded: int = 0
    frames_lost: int = 0
    frames_analysed: int = 0
    frames_skipped: int = 0  # received and recorded, not analysed live
    samples: int = 0
    samples_lost: int = 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended: `state` is "done" or "failed", `reason` one sentence."""

    state: str
    reason: str
    counts: Counts
    summary: Summary | None
    # peak_memory_mib, cpu_s, wall_s of this process
    resources: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Health:
    """The state of a run at a glance: cheap to read, at any time, from any thread.

    `queue_fill` is the recorder queue's share in use (0 to 1) and `queue_seconds` the data it can
    hold; `progress` runs from 0 to 1; `disk_free_bytes` is negative where nothing is written (a
    replay).
    """

    state: str
    reason: str
    phase: str
    counts: Counts
    queue_fill: float
    queue_seconds: float
    disk_free_bytes: int
    sample: int
    progress: float
