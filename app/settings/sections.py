"""The settings of the program, and all settings together.

Each section is declared by the part that owns it: those of the analysis in `analysis.settings`,
those of the devices in `drivers.settings` and `drivers.sim.settings`, the others here.
"""

from __future__ import annotations

import math
import unicodedata
from dataclasses import dataclass, field, replace
from functools import cached_property

from analysis.options import Section, like, option, quantity
from analysis.settings import Correlation, Sample, StressSettings, Uncertainties
from app.settings.protocol_steps import (
    KINDS,
    Approach,
    Motion,
    Step,
    check,
    legs,
    protocol_of,
    reach,
)
from app.settings.toml_text import MOST_DOTS
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sim.settings import SimSettings


@dataclass(frozen=True, kw_only=True)
class RunSettings(Section):
    """The loading experiment.

    Attributes
    ----------
    steps : tuple of Step
        Those of the settings; empty where the others say it all.
    """

    steps: tuple[Step, ...] = ()
    purpose: str = option(
        "experiment",
        "Purpose of the run; the steps of a calibration need neither a contact nor a drive",
        choices=("experiment", "calibration"),
    )
    normal_force: float = option(
        0.5, "Normal force P at which the contact is pressed", "N", gt=0, le=10
    )
    velocity: float = option(5.0, "Nominal velocity of the actuator", "um/s", gt=0, le=1000)
    travel: float = option(
        190.0,
        "Stage travel of the drive, negative in the opposite direction; the actuator is never"
        " sent further",
        "um",
        ge=-20000,
        le=20000,
    )
    reversals: int = option(
        0,
        "Number of times the stage reverses: at the end of its travel, at its start, and so on",
        ge=0,
        le=1000,
    )
    background_time: float = option(
        1.0,
        "Duration of the images of the free block before contact; 0: none, and the apparent"
        " radius is not measured",
        "s",
        ge=0,
        le=60,
    )
    contact_timeout: float = option(
        120.0, "Time allowed for the operator to press the contact to P", "s", gt=0, le=3600
    )
    settle_time: float = option(
        1.0, "Time for which P must stay within settle_tolerance", "s", gt=0, le=600
    )
    settle_tolerance: float = option(
        0.02,
        "Largest deviation of P from normal_force, as a fraction of normal_force",
        gt=0,
        le=0.5,
    )
    shear_tolerance: float = option(
        0.01,
        "Largest initial |Q|, as a fraction of P; above it the contact must be made again",
        gt=0,
        le=1,
    )
    reference_time: float = option(
        1.5,
        "Rest under load before the drive, during which the reference image is taken",
        "s",
        gt=0,
        le=60,
    )

    @cached_property
    def protocol(self) -> tuple[Step, ...]:
        """The steps of the run, whichever way they are given."""
        return protocol_of(self)

    @cached_property
    def as_planned(self) -> RunSettings:
        """The same with the load, velocity and travel that its steps say: those of the first
        approach and of the first motion, and the furthest place of the stage.
        """
        loads = [step.normal_force for step in self.protocol if isinstance(step, Approach)]
        velocities = [step.velocity for step in self.protocol if isinstance(step, Motion)]
        return replace(
            self,
            normal_force=(*loads, self.normal_force)[0],
            velocity=(*velocities, self.velocity)[0],
            travel=max(reach(self.protocol), key=abs) or self.travel,
        )

    @property
    def said_by_steps(self) -> set[str]:
        """Keys of [run] that have no effect, because each step of the protocol says it itself."""
        of_steps = {of for kind in KINDS.values() for of in kind.like_run.values()}
        left = {of for one in self.steps for k, of in one.like_run.items() if not getattr(one, k)}
        return {f"run.{of}" for of in of_steps - left} if self.steps else set()

    @property
    def direction(self) -> float:
        """1.0 for a first drive along +x, -1.0 for one the other way."""
        first = next((leg for leg in legs(self.protocol, as_planned=True)), None)
        return math.copysign(1.0, first.end[0] if first else self.travel)


LONGEST_TEXTS = {"sample": 100, "operator": 100, "note": 2000}  # characters


@dataclass(frozen=True, kw_only=True)
class AboutSettings(Section):
    """Notes of the operator on a run; nothing is computed from them."""

    sample: str = option("", "Name of the sample, at most 100 characters")
    operator: str = option("", "Name of the operator, at most 100 characters")
    note: str = option("", "Remarks, at most 2000 characters; lines end with \\n")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, longest in LONGEST_TEXTS.items():
            text: str = getattr(self, name)
            if len(text) > longest or text.count(".") > MOST_DOTS:
                raise ValueError(
                    f"about.{name} has {len(text)} characters, {text.count('.')} of them full"
                    f" stops; {longest} and {MOST_DOTS} are the most"
                )
            allowed = "\n\t" if name == "note" else ""
            for character in text:
                if unicodedata.category(character) in ("Cc", "Cs") and character not in allowed:
                    raise ValueError(
                        f"about.{name} has the control character {character!a}, which could steer a"
                        " terminal; leave it out"
                    )


@dataclass(frozen=True, kw_only=True)
class Limits(Section):
    """If a limit is exceeded, the actuator stops, and the run ends and names the limit."""

    shear_force: float = option(1.9, "Largest |Q|", "N", gt=0, le=100)
    normal_force: float = option(1.9, "Largest |P|", "N", gt=0, le=100)
    travel: float = option(
        500.0, "Largest stage travel from the start of the drive", "um", gt=0, le=20000
    )
    age: float = option(
        0.8,
        "Largest age of the newest force, and of an image that is due, while the stage moves",
        "s",
        gt=0.1,
        le=10,
    )
    lost_frames: float = option(
        0.2, "Largest share of triggers without an image, from the twentieth trigger on", gt=0, le=1
    )


@dataclass(frozen=True, kw_only=True)
class RecordingSettings(Section):
    """The session file."""

    flush_interval: float = option(0.4, "Time between flushes to disk", "s", gt=0, le=0.5)
    queue: float = option(
        4.0,
        "Largest backlog of data for the disk; beyond it the run ends because the disk is too slow",
        "s",
        gt=0,
        le=60,
    )
    results: str = option(
        "fields",
        "Results computed and recorded for each frame. fields: displacement fields and all results"
        " from them; profiles: u_x(r), sigma(r) and c, from displacements around the contact; or"
        " forces only. An open window still receives everything that it displays",
        choices=("fields", "profiles", "forces"),
    )
    compression: str = option(
        "none",
        "Compression of the images; gzip saves some of the space, for processor time with each"
        " image",
        choices=("none", "gzip"),
    )


@dataclass(frozen=True, kw_only=True)
class CalibrationSettings(Section):
    """The certificates of the bench's calibrations, see `slipscope calibrate`."""

    certificates: tuple[str, ...] = option(
        (),
        "Certificate files; their values replace the settings that they name, and every session"
        " stores a copy of them",
    )


@dataclass(frozen=True, kw_only=True)
class ReplaySettings(Section):
    """The recorded experiment that is played by each device whose source is "replay"."""

    session: str = option("", "Session file")


@dataclass(frozen=True, kw_only=True)
class Config:
    """A bench and what to do with it: all settings, by table of the settings file.

    Raises
    ------
    ValueError
        Two settings do not go together.
    """

    run: RunSettings = field(default_factory=RunSettings)
    about: AboutSettings = field(default_factory=AboutSettings)
    forces: ForceSettings = field(default_factory=ForceSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    actuator: ActuatorSettings = field(default_factory=ActuatorSettings)
    limits: Limits = field(default_factory=Limits)
    sample: Sample = field(default_factory=Sample)
    uncertainty: Uncertainties = field(default_factory=Uncertainties)
    dic: Correlation = field(default_factory=Correlation)
    stress: StressSettings = field(default_factory=StressSettings)
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    replay: ReplaySettings = field(default_factory=ReplaySettings)
    sim: SimSettings = field(default_factory=SimSettings)

    def __post_init__(self) -> None:
        run, forces, camera, actuator = self.run, self.forces, self.camera, self.actuator
        if self.frame_rate_hz > camera.max_rate:
            least = math.ceil(forces.sample_rate / camera.max_rate)
            raise ValueError(
                f"camera.divisor = {camera.divisor} asks {self.frame_rate_hz:.3g} frames/s,"
                f" {camera.max_rate:g} is the camera's limit; use a divisor of {least} or more"
            )
        if self.exposure_samples > camera.divisor:
            raise ValueError(
                f"camera.exposure = {quantity(camera, 'exposure')} is longer than the trigger"
                f" period of {1e3 / self.frame_rate_hz:.4g} ms; shorten it or raise camera.divisor"
            )
        if abs(camera.readout) * self.frame_rate_hz > 1:
            raise ValueError(
                f"camera.readout = {quantity(camera, 'readout')} is longer than the trigger period"
                f" of {1e3 / self.frame_rate_hz:.4g} ms; correct it or raise camera.divisor"
            )
        if run.steps:
            if run.reversals:
                raise ValueError(
                    f"run.reversals = {run.reversals} goes with the travel of run.travel, not with"
                    " run.steps; leave it out, and write steps that reverse"
                )
            check(
                run.protocol,
                self.limits,
                actuator.max_velocity,
                is_experiment=run.purpose == "experiment",
            )
        elif not run.travel:
            raise ValueError("run.travel = 0 um is no drive; give the way of the stage")
        elif abs(run.travel) > self.limits.travel:
            raise ValueError(
                f"run.travel = {quantity(run, 'travel')} is beyond limits.travel ="
                f" {quantity(self.limits, 'travel')}"
            )
        if not run.steps and run.normal_force >= self.limits.normal_force:
            raise ValueError(
                f"run.normal_force = {quantity(run, 'normal_force')} is not below"
                f" limits.normal_force = {quantity(self.limits, 'normal_force')}"
            )
        if not run.steps and run.velocity > actuator.max_velocity:
            raise ValueError(
                f"run.velocity = {quantity(run, 'velocity')} is beyond actuator.max_velocity ="
                f" {quantity(actuator, 'max_velocity')}"
            )
        if "replay" in self.sources and not self.replay.session:
            raise ValueError(
                "replay.session must be the session that a source = 'replay' plays; found \"\""
            )
        if self.dic.box >= min(camera.shape):
            raise ValueError(
                f"dic.box = {quantity(self.dic, 'box')} does not fit the {camera.width} x"
                f" {camera.height} image"
            )

    @property
    def sources(self) -> tuple[str, str, str]:
        """Names of the drivers of forces, camera and actuator."""
        return self.forces.source, self.camera.source, self.actuator.source

    @property
    def frame_rate_hz(self) -> float:
        """Triggers per second."""
        return self.forces.sample_rate / self.camera.divisor

    @property
    def exposure_samples(self) -> int:
        """Exposure of the camera in samples."""
        return self.camera.exposure_samples(self.forces.sample_rate)

    @property
    def correlation(self) -> Correlation:
        """How the camera's images are correlated: `dic` with the end of the grey scale."""
        return replace(self.dic, full_scale=self.dic.full_scale or self.camera.full_scale)


# ---------------------------------------------------------------------- of single commands


def flag(name: str) -> str:
    """A setting as an option of the command line."""
    return "--" + name.replace("_", "-")


INVERSIONS = ("axisymmetric", "regularised", "cgls", "van-cittert", "coupled")


@dataclass(frozen=True, kw_only=True)
class ContactSettings(Section):
    """A sphere pressed on a block."""

    normal_force: float = option(0.5, "Normal force P", "N", gt=0, le=100)
    modulus: float = like(Sample, "young_modulus")
    poisson: float = like(Sample, "poisson")
    radius: float = like(Sample, "lens_radius")
    roughness: float = like(Sample, "roughness")
    thickness: float = like(Sample, "thickness")

    @property
    def depth(self) -> float:
        """Thickness of the block in metres, infinite for a half-space."""
        return self.thickness or math.inf


@dataclass(frozen=True, kw_only=True)
class ModelSettings(ContactSettings):
    """The contact for which `slipscope model` computes the theory."""

    friction: float = like(SimSettings, "friction")
    length: float = option(
        0.8, "Elastic length L of the interface; 0: Cattaneo-Mindlin", "um", ge=0, le=1000
    )
    adhesion: float = option(
        0.0, "Work of adhesion w; if above 0, the JKR values are added", "mJ/m2", ge=0, le=1e4
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thickness > 0 and self.length == 0:
            raise ValueError(
                "--thickness: a layer is solved for a rough interface only; give --length more than"
                " 0 with it"
            )


@dataclass(frozen=True, kw_only=True)
class InversionSettings(ContactSettings):
    """How `slipscope invert` inverts fields, and the contact on which they were measured."""

    method: str = option(
        INVERSIONS[0],
        "A profile about the centre; the whole field (regularised: most accurate; cgls: plain"
        " conjugate gradients; van-cittert: the paper's method); or both components from both"
        " fields of a session",
        choices=INVERSIONS,
    )
    pixel: float = like(CameraSettings, "pixel")
    box: float = option(
        0.0,
        "Side of the box over which a displacement is averaged; default: two grid pitches",
        "um",
        ge=0,
    )
    centre: tuple[float, float] = option(
        (0.0, 0.0),
        "Centre of the contact (x, y) in the file's coordinates; default: computed",
        "mm",
    )
