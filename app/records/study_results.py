"""What `slipscope analyze` makes of sessions: the results of each run, and what all runs have in
common. Figures, reports, exports and notebooks read nothing else.

All records are frozen; lengths, forces and times are in SI units unless the name says otherwise.
Each field names its dataset in the file of results (`app.records.schema`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from analysis.arrays import F32, F64, I64, U8, Rows
from app.records.quantities import as_text, joint_quantities
from app.records.record_types import NAN, ContactResult
from app.records.schema import column, record, uncertainty
from app.records.summary import Summary


@record("origin")
class Origin:
    """Where the results of a run come from."""

    session: str = column("session", "", "name of the session's file")
    started: str = column("start_time", "", "start_time of the session, which identifies it")
    state: str = column("state", "", "how the run ended: done, stopped, failed or unfinished")
    reason: str = column("reason", "", "why it ended, in one sentence")
    config_toml: str = column("settings", "", "the settings of the analysis, complete")
    sample: str = column("sample", "", "name of the sample", default="")
    operator: str = column("operator", "", "operator", default="")
    note: str = column("note", "", "note of the operator", default="")
    checksum: str = column(
        "checksum", "", "SHA-256 of the recorded data, with the images' checksums", default=""
    )

    def __repr__(self) -> str:
        return f"<Origin: {self.session}, started {self.started}, {self.state}>"


@record("pictures")
class Pictures:
    """The reference under load, and the free block before the contact (Fig. 2); grey levels scaled
    to 8 bits, shape (rows, columns), empty where there is none.
    """

    reference: U8 = column(
        "reference", "counts", "reference image, at rest under load", shape=("y", "x")
    )
    background: U8 = column(
        "background", "counts", "background image of the free block", shape=("y0", "x0")
    )
    pixel_m: float = column("pixel", "m", "side of a pixel on the interface")


@record("rings", shape=("results", "rings"))
class RingSeries:
    """Ring means of u_x about the contact's centre, lens removed, and of sigma_xz, shape (frames,
    rings): a row for each frame of `RunResult.frames`, NaN where nothing was measured.
    """

    radius_m: F64 = column("radius", "m", "mean radius of the ring")
    ux_m: F64 = column("ux", "m", "azimuthal mean of u_x")
    ux_sd_m: F64 = uncertainty("ux")
    stress_radius_m: F64 = column(
        "stress_radius", "m", "distance from the contact's centre", shape=("results", "radii")
    )
    stress_pa: F64 = column(
        "stress",
        "Pa",
        "azimuthal mean of sigma_xz, computed with E of the settings",
        shape=("results", "radii"),
    )
    stress_sd_pa: F64 = uncertainty("stress")


@record("law", shape=("results", "law_radii"))
class LawSeries:
    """The points of the master curve (Fig. 15): local slip and traction over that of sliding, for
    each frame, at the radii of `Summary.pressure_radius_m`; NaN where they tell nothing.
    """

    slip_m: F64 = column("slip", "m", "local slip")
    ratio: F64 = column("ratio", "1", "shear traction over that of sliding")


@record("instants", shape=("instants", "ny", "nx"))
class Instants:
    """Fields at the numbered instants (Figs 5, 6 and 10), displacements along x and y of the
    picture without the motion of the lens, the traction along the drive.
    """

    frame: I64 = column("frame", "1", "trigger number", shape=("instants",))
    x_m: F64 = column("x", "m", "x of the box centres from the contact's centre", shape=("nx",))
    y_m: F64 = column(
        "y", "m", "y of the box centres from the contact's centre, downwards", shape=("ny",)
    )
    ux_m: F32 = column("ux", "m", "displacement along x")
    uy_m: F32 = column("uy", "m", "displacement along y")
    stress_pa: F32 = column("stress", "Pa", "shear traction sigma_xz, computed with E of the run")


@record("noise", shape=("boxes",))
class BoxNoise:
    """Standard deviation of u_x against the side of the correlation box (Fig. 4d), for the texture
    and the noise of this run's pictures.
    """

    box_px: F64 = column("box", "px", "side of the box")
    sigma_px: F64 = column("sigma", "px", "standard deviation of u_x")
    floor_px: F64 = column("floor", "px", "Cramer-Rao bound of that box")
    direct_px: F64 = column(
        "direct", "px", "standard deviation of u_x by the direct method", since=3
    )


@record("search", since=2)
class BoxSearch:
    """A box of the reference, a later picture in which it is looked for, and their correlation
    (Figs 4a to 4c); cuts of both pictures with grey levels scaled to 8 bits.
    """

    frame: int = column("frame", "1", "trigger number of the later picture")
    box_px: int = column("box", "px", "side of the box")
    x_px: int = column("box_x", "px", "first column of the box in the reference")
    y_px: int = column("box_y", "px", "first row of the box in the reference")
    left_px: int = column("cut_x", "px", "first column of both cuts in their pictures")
    top_px: int = column("cut_y", "px", "first row of both cuts in their pictures")
    reference: U8 = column("reference", "counts", "cut of the reference", shape=("rows", "columns"))
    later: U8 = column("later", "counts", "cut of the later picture", shape=("rows", "columns"))
    tau_y_px: F64 = column("tau_y", "px", "displacements tried along y", shape=("tau_y",))
    tau_x_px: F64 = column("tau_x", "px", "displacements tried along x", shape=("tau_x",))
    correlation: F64 = column(
        "correlation",
        "1",
        "normalised correlation at displacements along y and x",
        shape=("tau_y", "tau_x"),
    )
    ux_px: float = column("ux", "px", "displacement along x: top of the correlation")
    uy_px: float = column("uy", "px", "displacement along y (down)")


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """All results of one session.

    Attributes
    ----------
    origin : Origin
    summary : Summary
    contact : ContactResult or None
        None where it was not measured.
    pictures : Pictures
    frames : ndarray, shape (frames,)
        The numbers of every analysed frame as a structured array, as `Session.results`.
        Its fields are the numbers of `Snapshot`: ``frame``, ``phase`` (text), ``time_s``, ...
    rings : RingSeries
    law : LawSeries
    instants : Instants
    noise : BoxNoise
    """

    origin: Origin
    summary: Summary
    contact: ContactResult | None
    pictures: Pictures
    frames: Rows
    rings: RingSeries
    law: LawSeries
    instants: Instants
    noise: BoxNoise
    search: BoxSearch | None = None

    def __repr__(self) -> str:
        return (
            f"<RunResult of {self.origin.session}: {self.origin.state}, {len(self.frames)} frames>"
        )


@record("joint")
class Joint:
    """Common results of the runs (`analysis.friction.joint`); NaN with the reason in `notes`."""

    young_modulus_pa: float = column("young_modulus", "Pa", "E", default=NAN)
    young_modulus_sd_pa: float = uncertainty("young_modulus", default=NAN)
    length_m: float = column("length", "m", "L of the local law", default=NAN)
    length_sd_m: float = uncertainty("length", default=NAN)
    mu: float = column("mu", "1", "mu at 1 N, of mu = mu_1 P^-decay", default=NAN)
    mu_sd: float = uncertainty("mu", default=NAN)
    decay: float = column("decay", "1", "exponent of the fall of mu with P", default=NAN)
    decay_sd: float = uncertainty("decay", default=NAN)
    stiffness_length_m: float = column(
        "stiffness_length",
        "m",
        "L from the interface stiffness: p/k of all rings of all runs",
        default=NAN,
    )
    stiffness_length_sd_m: float = uncertainty("stiffness_length", default=NAN)
    roughness_length_m: float = column(
        "roughness_length", "m", "L after Bureau, from the roughness in the settings", default=NAN
    )
    roughness_length_sd_m: float = uncertainty("roughness_length", default=NAN)
    notes: tuple[str, ...] = column(
        "notes",
        "",
        "why a quantity is NaN, or which runs are inconsistent",
        shape=("notes",),
        default=(),
    )

    def __str__(self) -> str:
        title = "What the runs have in common, ± total uncertainty:"
        return as_text(title, joint_quantities(self), self.notes)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """Show a notebook the same, in place of every number in full."""
        printer.text(str(self))


@dataclass(frozen=True, kw_only=True)
class StudyResults:
    """All that an analysis of sessions gave.

    Attributes
    ----------
    runs : tuple of RunResult
        By normal force, then by name.
    joint : Joint
    made_with : dict
        Name -> what made the results: versions, the settings that were changed, the preset.
    """

    runs: tuple[RunResult, ...]
    joint: Joint
    made_with: dict[str, str]
