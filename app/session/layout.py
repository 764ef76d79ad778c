"""The session file on one page: every group and dataset with its shape, unit and meaning. Writer
and reader know no other names.

A session is one HDF5 file in NeXus style. ``/@default`` leads to the load curve: shear force
against stage displacement. Nothing is compressed (but the images by gzip, if asked), so every HDF5
reader opens it. Row ``n`` of the forces is sample ``n`` of the DAQ clock; missing samples are NaN
and listed in `gaps`. Every trigger has a row in `triggers`, which is the truth about what was
recorded.
"""

from __future__ import annotations

from dataclasses import dataclass

from app.results import Phase

FORMAT_VERSION = 4
FORMAT_ATTRIBUTE = "slipscope_format"
UNFINISHED = "unfinished"

TEXT = "text"  # variable-length UTF-8
IMAGE = "image"  # the camera's own dtype

PHASES = tuple(Phase)  # a phase is stored as its place in this list
FORCES_CHUNK = 4096  # samples
NO_ROW = -1  # of an image or field that does not exist


@dataclass(frozen=True, slots=True)
class Group:
    """A group: its NeXus class and, for plots, its signal, its other signals and its axes ("." for
    a plain count).
    """

    path: str
    nx_class: str
    meaning: str
    signal: str = ""
    auxiliary_signals: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Item:
    """A dataset. Sides of `shape` are numbers or names; a name in `GROWING` starts at 0. `rows` is
    the length of a chunk.

    Sessions of a format before `since` do not have it.
    """

    path: str
    shape: tuple[str | int, ...]
    dtype: str
    unit: str
    meaning: str
    rows: int = 1024
    since: int = 1

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.path.rpartition("/")[2]

    @property
    def group(self) -> str:
        """The path of the group it lies in."""
        return self.path.rpartition("/")[0]


GROWING = frozenset(
    {
        "samples",
        "gaps",
        "triggers",
        "frames",
        "positions",
        "events",
        "results",
        "rings",
        "radii",
        "fields",
    }
)

GROUPS = (
    Group("/entry", "NXentry", "one loading experiment"),
    Group("/entry/run", "NXcollection", "how the run ended"),
    Group("/entry/settings", "NXcollection", "what the run was asked to do"),
    Group("/entry/versions", "NXcollection", "what it ran on"),
    Group(
        "/entry/source",
        "NXcollection",
        "the session that holds the images; only in a further analysis of one",
    ),
    Group(
        "/entry/clock", "NXcollection", "the DAQ sample clock and the camera triggers cut from it"
    ),
    Group("/entry/instrument", "NXinstrument", "the bench"),
    Group("/entry/instrument/camera", "NXdetector", "the triggered camera"),
    Group("/entry/instrument/actuator", "NXpositioner", "the stage that drives the block"),
    Group("/entry/triggers", "NXcollection", "every trigger and its fate"),
    Group(
        "/entry/forces",
        "NXdata",
        "forces at full rate; the row is the sample",
        "shear_force",
        ("normal_force",),
        (".",),
    ),
    Group(
        "/entry/gaps",
        "NXcollection",
        "samples that the board did not deliver; their rows in the forces are NaN",
    ),
    Group("/entry/events", "NXcollection", "phases, limits, stops"),
    Group(
        "/entry/results",
        "NXdata",
        "what was found on each analysed frame",
        "shear_force",
        ("normal_force",),
        ("stage_displacement",),
    ),
    Group(
        "/entry/rings",
        "NXdata",
        "u_x about the contact's centre; one row per row of results",
        "ux",
        (),
        (".", "."),
    ),
    Group(
        "/entry/stress",
        "NXdata",
        "shear traction about the contact's centre; one row per row of results",
        "stress",
        (),
        (".", "."),
    ),
    Group(
        "/entry/fields",
        "NXdata",
        "displacement from the reference image, lens compliance not removed",
        "ux",
        (),
        ("frame", "y", "x"),
    ),
    Group(
        "/entry/contact",
        "NXcollection",
        "the apparent contact on the reference frame; absent where it was not measured",
    ),
    Group(
        "/entry/profile",
        "NXdata",
        "background difference about the contact's centre; comes with contact",
        "grey",
        (),
        ("radius",),
    ),
    Group(
        "/entry/summary",
        "NXcollection",
        "what the experiment comes down to; absent in an unfinished or failed run",
    ),
    Group("/entry/counts", "NXcollection", "the account of the run; absent in an unfinished one"),
)
LATER = frozenset(
    {"/entry/source", "/entry/contact", "/entry/profile", "/entry/summary", "/entry/counts"}
)  # not in every session

ITEMS = (
    Item("/entry/title", (), TEXT, "", "what this is, for a reader"),
    Item("/entry/program_name", (), TEXT, "", "SlipScope; its version is in versions"),
    Item(
        "/entry/start_time",
        (),
        TEXT,
        "",
        "time of day when the session was made, ISO 8601; for people, nothing is computed from it",
    ),
    Item(
        "/entry/end_time",
        (),
        TEXT,
        "",
        "time of day when the run ended, ISO 8601; empty if it was not finished",
    ),
    Item("/entry/run/state", (), TEXT, "", "done, failed or unfinished"),
    Item("/entry/run/reason", (), TEXT, "", "one sentence: why it ended"),
    Item(
        "/entry/run/resources", (), TEXT, "", "memory, processor and wall time of the run, as JSON"
    ),
    Item("/entry/settings/toml", (), TEXT, "", "the settings used, complete"),
    Item(
        "/entry/versions/name",
        ("programs",),
        TEXT,
        "",
        "program, library, or the computer, its processor and system",
    ),
    Item("/entry/versions/version", ("programs",), TEXT, "", "its version, or what it is"),
    Item(
        "/entry/source/session",
        (),
        TEXT,
        "",
        "name of its file, which lies beside this one",
        since=4,
    ),
    Item(
        "/entry/source/start_time",
        (),
        TEXT,
        "",
        "its start_time, which tells it from others of that name",
        since=4,
    ),
    Item(
        "/entry/clock/sample_rate",
        (),
        "float64",
        "Hz",
        "rate of the DAQ sample clock, the only time base",
    ),
    Item("/entry/clock/first_trigger", (), "int64", "samples", "sample of trigger 0"),
    Item("/entry/clock/divisor", (), "int64", "samples", "samples from one trigger to the next"),
    Item(
        "/entry/clock/exposure",
        (),
        "int64",
        "samples",
        "exposure time of an image, from its trigger on",
    ),
    Item(
        "/entry/instrument/camera/data",
        ("frames", "rows", "columns"),
        IMAGE,
        "counts",
        "raw images, one chunk each",
        1,
    ),
    Item("/entry/instrument/camera/pixel", (), "float64", "m", "side of a pixel on the interface"),
    Item(
        "/entry/instrument/actuator/sample",
        ("positions",),
        "int64",
        "samples",
        "sample at which the position was read",
    ),
    Item(
        "/entry/instrument/actuator/position",
        ("positions",),
        "float64",
        "m",
        "position of the stage, in its own coordinate",
    ),
    Item("/entry/triggers/index", ("triggers",), "int64", "1", "trigger number, from 0"),
    Item(
        "/entry/triggers/sample",
        ("triggers",),
        "int64",
        "samples",
        "sample on which the exposure started",
    ),
    Item(
        "/entry/triggers/image",
        ("triggers",),
        "int64",
        "1",
        "row of its image in camera/data (of the source, if any); -1: it was lost",
    ),
    Item(
        "/entry/triggers/reason",
        ("triggers",),
        TEXT,
        "",
        "why the frame was lost; empty where it was received",
    ),
    Item(
        "/entry/triggers/analysed",
        ("triggers",),
        "uint8",
        "1",
        "1: analysed during the run; 0: not",
    ),
    Item(
        "/entry/triggers/checksum",
        ("triggers",),
        "uint32",
        "1",
        "CRC-32 of its image, row by row; 0 where the frame was lost",
        since=4,
    ),
    Item(
        "/entry/forces/normal_force", ("samples",), "float64", "N", "normal force P", FORCES_CHUNK
    ),
    Item("/entry/forces/shear_force", ("samples",), "float64", "N", "shear force Q", FORCES_CHUNK),
    Item(
        "/entry/forces/normal_sensor",
        ("samples",),
        "float64",
        "V",
        "reading of the normal sensor",
        FORCES_CHUNK,
    ),
    Item(
        "/entry/forces/shear_sensor",
        ("samples",),
        "float64",
        "V",
        "reading of the shear sensor",
        FORCES_CHUNK,
    ),
    Item("/entry/gaps/first", ("gaps",), "int64", "samples", "first missing sample"),
    Item("/entry/gaps/count", ("gaps",), "int64", "samples", "how many are missing"),
    Item("/entry/events/sample", ("events",), "int64", "samples", "when it happened"),
    Item(
        "/entry/events/kind",
        ("events",),
        TEXT,
        "",
        "phase, reference, gap, import, analysis, stop or error",
    ),
    Item("/entry/events/text", ("events",), TEXT, "", "what happened"),
    Item(
        "/entry/results/frame",
        ("results",),
        "int64",
        "1",
        "trigger number of the frame, in the order of analysis",
    ),
    Item(
        "/entry/results/sample",
        ("results",),
        "int64",
        "samples",
        "sample on which its exposure started",
    ),
    Item(
        "/entry/results/phase",
        ("results",),
        "uint8",
        "1",
        ", ".join(f"{n}: {phase}" for n, phase in enumerate(PHASES)),
    ),
    Item(
        "/entry/results/time",
        ("results",),
        "float64",
        "s",
        "middle of the exposure from the start of the drive; NaN before it",
    ),
    Item("/entry/results/normal_force", ("results",), "float64", "N", "P, mean over the exposure"),
    Item("/entry/results/shear_force", ("results",), "float64", "N", "Q, mean over the exposure"),
    Item(
        "/entry/results/stage_displacement",
        ("results",),
        "float64",
        "m",
        "travel of the stage since the reference (delta)",
    ),
    Item(
        "/entry/results/lens_displacement",
        ("results",),
        "float64",
        "m",
        "motion of the lens since the reference, not taken off fields",
    ),
    Item("/entry/results/centre_ux", ("results",), "float64", "m", "u_x at the contact's centre"),
    Item(
        "/entry/results/stick_radius",
        ("results",),
        "float64",
        "m",
        "c; NaN where it can not be told",
    ),
    Item(
        "/entry/results/stick_radius_errors",
        ("results",),
        "float64",
        "m",
        "its standard uncertainty",
    ),
    Item(
        "/entry/results/full_slip_stress",
        ("results",),
        "float64",
        "Pa",
        "mu p0 of the profile that gave stick_radius",
        since=3,
    ),
    Item(
        "/entry/results/peak_radius",
        ("results",),
        "float64",
        "m",
        "c, where the shear traction is largest",
        since=3,
    ),
    Item(
        "/entry/results/peak_radius_errors",
        ("results",),
        "float64",
        "m",
        "its standard uncertainty",
        since=3,
    ),
    Item(
        "/entry/results/block_displacement",
        ("results",),
        "float64",
        "m",
        "D, of the block far from the contact, inverted",
        since=3,
    ),
    Item(
        "/entry/results/block_displacement_errors",
        ("results",),
        "float64",
        "m",
        "its standard uncertainty",
        since=3,
    ),
    Item(
        "/entry/results/stress_force",
        ("results",),
        "float64",
        "N",
        "integral of the shear traction",
        since=3,
    ),
    Item(
        "/entry/results/stress_force_errors",
        ("results",),
        "float64",
        "N",
        "its standard uncertainty",
        since=3,
    ),
    Item(
        "/entry/results/stress_count",
        ("results",),
        "int64",
        "1",
        "number of radii; the rest of the row in stress is NaN",
        since=3,
    ),
    Item(
        "/entry/results/ring_count",
        ("results",),
        "int64",
        "1",
        "number of rings; the rest of the row in rings is NaN",
    ),
    Item(
        "/entry/results/field",
        ("results",),
        "int64",
        "1",
        "row of its field in fields; -1: there was no reference yet",
    ),
    Item(
        "/entry/rings/radius", ("results", "rings"), "float64", "m", "mean radius of the ring", 64
    ),
    Item(
        "/entry/rings/ux",
        ("results", "rings"),
        "float64",
        "m",
        "azimuthal mean of u_x, lens compliance removed",
        64,
    ),
    Item("/entry/rings/ux_errors", ("results", "rings"), "float64", "m", "its standard error", 64),
    Item(
        "/entry/stress/radius",
        ("results", "radii"),
        "float64",
        "m",
        "distance from the contact's centre",
        64,
        since=3,
    ),
    Item(
        "/entry/stress/stress",
        ("results", "radii"),
        "float64",
        "Pa",
        "azimuthal mean of the shear traction sigma_xz",
        64,
        since=3,
    ),
    Item(
        "/entry/stress/stress_errors",
        ("results", "radii"),
        "float64",
        "Pa",
        "its standard uncertainty",
        64,
        since=3,
    ),
    Item("/entry/fields/frame", ("fields",), "int64", "1", "trigger number of the frame"),
    Item(
        "/entry/fields/x",
        ("nx",),
        "float64",
        "px",
        "box centres along x, the driving direction; 0 is the centre of the first pixel",
    ),
    Item("/entry/fields/y", ("ny",), "float64", "px", "box centres along y, downwards"),
    Item(
        "/entry/fields/ux",
        ("fields", "ny", "nx"),
        "float32",
        "px",
        "displacement along x; NaN where status is not 0",
        1,
    ),
    Item(
        "/entry/fields/uy",
        ("fields", "ny", "nx"),
        "float32",
        "px",
        "displacement along y; NaN where status is not 0",
        1,
    ),
    Item(
        "/entry/fields/ux_errors",
        ("fields", "ny", "nx"),
        "float32",
        "px",
        "its standard uncertainty",
        1,
        since=2,
    ),
    Item(
        "/entry/fields/uy_errors",
        ("fields", "ny", "nx"),
        "float32",
        "px",
        "its standard uncertainty",
        1,
        since=2,
    ),
    Item(
        "/entry/fields/zncc",
        ("fields", "ny", "nx"),
        "float32",
        "1",
        "correlation at the peak; NaN where status is not 0",
        1,
    ),
    Item(
        "/entry/fields/status", ("fields", "ny", "nx"), "uint8", "1", "0: measured; else why not", 1
    ),
    Item("/entry/contact/centre", (2,), "float64", "px", "centre of the contact (x, y)"),
    Item("/entry/contact/radius", (), "float64", "m", "apparent contact radius a"),
    Item("/entry/contact/radius_errors", (), "float64", "m", "its standard uncertainty"),
    Item(
        "/entry/contact/shift",
        (2,),
        "float64",
        "px",
        "rigid shift from the background to the reference image (x, y)",
    ),
    Item(
        "/entry/profile/radius", ("profile",), "float64", "px", "radius about the contact's centre"
    ),
    Item(
        "/entry/profile/grey",
        ("profile",),
        "float64",
        "counts",
        "azimuthal mean of the background difference",
    ),
    Item("/entry/summary/normal_force", (), "float64", "N", "P"),
    Item("/entry/summary/apparent_radius", (), "float64", "m", "a"),
    Item("/entry/summary/apparent_radius_errors", (), "float64", "m", "its standard uncertainty"),
    Item("/entry/summary/hertz_radius", (), "float64", "m", "contact radius after Hertz"),
    Item(
        "/entry/summary/onset_time",
        (),
        "float64",
        "s",
        "t_s, the onset of sliding, from the start of the drive",
    ),
    Item("/entry/summary/onset_time_errors", (), "float64", "s", "its standard uncertainty"),
    Item("/entry/summary/static_force", (), "float64", "N", "Q_s, the shear force at the onset"),
    Item("/entry/summary/mu_s", (), "float64", "1", "static friction coefficient Q_s/P"),
    Item("/entry/summary/mu_s_errors", (), "float64", "1", "its standard uncertainty"),
    Item("/entry/summary/mu_d", (), "float64", "1", "dynamic friction coefficient"),
    Item(
        "/entry/summary/mu_d_range", (2,), "float64", "1", "least and greatest Q/P during sliding"
    ),
    Item("/entry/summary/sliding_velocity", (), "float64", "m/s", "velocity during sliding"),
    Item(
        "/entry/summary/law_mu",
        (),
        "float64",
        "1",
        "mu of the local friction law mu p (1 - exp(-s/(mu L)))",
        since=3,
    ),
    Item("/entry/summary/law_mu_errors", (), "float64", "1", "its standard uncertainty", since=3),
    Item("/entry/summary/law_length", (), "float64", "m", "L of that law", since=3),
    Item(
        "/entry/summary/law_length_errors", (), "float64", "m", "its standard uncertainty", since=3
    ),
    Item(
        "/entry/summary/young_modulus",
        (),
        "float64",
        "Pa",
        "E from the balance of the shear traction with Q",
        since=3,
    ),
    Item(
        "/entry/summary/young_modulus_errors",
        (),
        "float64",
        "Pa",
        "its standard uncertainty",
        since=3,
    ),
    Item(
        "/entry/summary/calibration_uncertainty",
        (),
        "float64",
        "1",
        "relative, by the cantilevers, of every friction coefficient",
        since=4,
    ),
    Item("/entry/summary/notes", ("notes",), TEXT, "", "why a quantity above is NaN"),
    Item("/entry/counts/triggers", (), "int64", "1", "triggers sent"),
    Item("/entry/counts/frames_received", (), "int64", "1", "frames that came"),
    Item("/entry/counts/frames_recorded", (), "int64", "1", "frames in this file"),
    Item("/entry/counts/frames_lost", (), "int64", "1", "triggers without a frame"),
    Item("/entry/counts/frames_analysed", (), "int64", "1", "frames analysed during the run"),
    Item(
        "/entry/counts/frames_skipped",
        (),
        "int64",
        "1",
        "frames recorded but not analysed during the run",
    ),
    Item("/entry/counts/samples", (), "int64", "1", "force samples that came"),
    Item("/entry/counts/samples_lost", (), "int64", "1", "force samples that did not"),
)

# dataset -> attribute of app.results.Snapshot, ContactResult, Summary
RESULTS = {
    "frame": "frame",
    "sample": "sample",
    "phase": "phase",
    "time": "time_s",
    "normal_force": "normal_force_n",
    "shear_force": "shear_force_n",
    "stage_displacement": "travel_m",
    "lens_displacement": "lens_m",
    "centre_ux": "centre_ux_m",
    "stick_radius": "stick_radius_m",
    "stick_radius_errors": "stick_radius_sd_m",
    "full_slip_stress": "full_slip_pa",
    "peak_radius": "peak_radius_m",
    "peak_radius_errors": "peak_radius_sd_m",
    "block_displacement": "block_m",
    "block_displacement_errors": "block_sd_m",
    "stress_force": "stress_force_n",
    "stress_force_errors": "stress_force_sd_n",
}
STRESS = {"radius": "stress_radius_m", "stress": "stress_pa", "stress_errors": "stress_sd_pa"}
RINGS = {"radius": "ring_radius_m", "ux": "ring_ux_m", "ux_errors": "ring_sd_m"}
FIELDS = {
    "ux": "ux_px",
    "uy": "uy_px",
    "ux_errors": "ux_std_px",
    "uy_errors": "uy_std_px",
    "zncc": "zncc",
    "status": "status",
}
CONTACT = {
    "contact/centre": "centre_px",
    "contact/radius": "apparent_radius_m",
    "contact/radius_errors": "apparent_radius_sd_m",
    "contact/shift": "shift_px",
    "profile/radius": "profile_radius_px",
    "profile/grey": "profile_grey",
}
SUMMARY = {
    "normal_force": "normal_force_n",
    "apparent_radius": "apparent_radius_m",
    "apparent_radius_errors": "apparent_radius_sd_m",
    "hertz_radius": "hertz_radius_m",
    "onset_time": "onset_time_s",
    "onset_time_errors": "onset_time_sd_s",
    "static_force": "static_force_n",
    "mu_s": "mu_s",
    "mu_s_errors": "mu_s_sd",
    "mu_d": "mu_d",
    "mu_d_range": "mu_d_range",
    "sliding_velocity": "sliding_velocity_m_s",
    "notes": "notes",
    "law_mu": "law_mu",
    "law_mu_errors": "law_mu_sd",
    "law_length": "law_length_m",
    "law_length_errors": "law_length_sd_m",
    "young_modulus": "young_modulus_pa",
    "young_modulus_errors": "young_modulus_sd_pa",
    "calibration_uncertainty": "calibration_sd",
}


def items_of(group: str) -> tuple[Item, ...]:
    """The datasets that lie directly in a group, in order."""
    return tuple(item for item in ITEMS if item.group == group)


def markdown() -> str:
    """The layout as a Markdown table, for the documentation."""
    lines = ["| dataset | shape | type | unit | meaning |", "|---|---|---|---|---|"]
    for item in ITEMS:
        shape = " x ".join(str(side) for side in item.shape) or "one value"
        since = f" (version {item.since} on)" if item.since > 1 else ""
        lines.append(
            f"| `{item.path}` | {shape} | {item.dtype} | {item.unit} | {item.meaning}{since} |"
        )
    return "\n".join(lines) + "\n"
