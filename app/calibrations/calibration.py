"""What every calibration is: a protocol, what is taken from its sessions, a fit, a picture.

Modules of calibrations import nothing heavy (numpy, scipy, the analysis) but within methods: the
command line needs their declarations before it does anything.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from analysis.options import Section
from app.settings.protocol_steps import Approach, Background, Motion, Step
from app.settings.sections import Config
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.records.quantities import Measurement

O = TypeVar("O", bound=Section)  # noqa: E741 - the options of a calibration
FREE_S = 0.5  # for which a block must hang free before it is moved
PICTURE_S = 5  # between two pictures of a run that needs none
Data = Mapping[str, Any]  # by name: arrays, and numbers as such


@dataclass(frozen=True)
class CalibrationResult:
    """What a calibration finds.

    Attributes
    ----------
    values : tuple of Measurement
        In SI units, with standard uncertainties.
    settings : dict
        ``table.key`` -> value in the units of the settings file.
    remarks : tuple of str
        What a reader should know.
    fit
        What was fitted, for the picture.
    """

    values: tuple[Measurement, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    fit: Any = None


class Calibration(ABC, Generic[O]):
    """A calibration.

    Attributes
    ----------
    name : str
        ``slipscope calibrate NAME``.
    title : str
        What it finds, for help and window.
    files : str
        What can be evaluated, for help: "SESSION.h5...", "MAP".
    takes_several : bool
        Whether several files are evaluated together.
    valid_days : int
        For how long a certificate holds.
    Options : type of Section
        Its own options.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    files: ClassVar[str] = "SESSION.h5..."
    takes_several: ClassVar[bool] = True
    valid_days: ClassVar[int] = 180
    Options: ClassVar[type[Section]] = Section

    @property
    def example(self) -> str:
        """A command line."""
        has_runs = type(self).plan is not Calibration.plan
        what = "bench.toml" if has_runs else self.files.split("|")[0].rstrip(".")
        return f"slipscope calibrate {self.name} {what} -o {self.name}.zip"

    def plan(self, config: Config, options: O) -> tuple[Config, ...]:
        """The settings of the runs that measure it on a bench, each of one session.

        Raises
        ------
        UserError
            It is made from files only, or not possible on this bench.
        """
        raise UserError(
            f"calibrate {self.name}: no run of a bench measures this; give {self.files}"
        )

    @abstractmethod
    def gather(self, sources: Sequence[Path], options: O) -> Data:
        """What the fit needs, by name, from sessions or files: the certificate keeps it."""

    @abstractmethod
    def fit(self, data: Data, options: O) -> CalibrationResult:
        """What the data say.

        Raises
        ------
        ValueError
            They cannot be trusted; the message says why and what to do.
        """

    @abstractmethod
    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """Data, fit and what is left, for the certificate."""


def is_session(path: Path) -> bool:
    """Whether a file is named as a session."""
    return path.suffix.lower() in (".h5", ".hdf5", ".nxs")


def calibration_run(
    config: Config,
    steps: Sequence[Step],
    *,
    velocity: float = 0.0,
    is_of_forces: bool = False,
    **changes: Any,
) -> Config:
    """The settings of a run that does `steps`, without live correlation.

    Parameters
    ----------
    velocity : float
        That of the stage in m/s; 0: `run.velocity`.
    is_of_forces : bool
        Whether nobody needs pictures: one in `PICTURE_S` is taken.
    changes
        Whole sections by the name of their table, such as ``camera=replace(config.camera, ...)``.
    """
    is_pressed = any(isinstance(step, Approach) for step in steps)
    if not is_pressed and any(isinstance(step, Motion) for step in steps):
        steps = (Background(time=FREE_S), *steps)  # which fails where the block is pressed
    run = replace(
        config.run,
        steps=tuple(steps),
        purpose="calibration",
        reversals=0,
        velocity=velocity or config.run.velocity,
    )
    recording = replace(config.recording, results="forces")
    if is_of_forces:
        each = max(config.camera.divisor, PICTURE_S * config.forces.sample_rate)
        changes["camera"] = replace(config.camera, divisor=each)
    return replace(config, **{"run": run, "recording": recording, **changes})
