"""What every calibration is: a protocol, what is taken from its sessions, a fit, a picture.

Modules of calibrations import nothing heavy (numpy, scipy, the analysis) but within methods: the
command line needs their declarations before it does anything.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from analysis.options import Section
from app.calibrations.charts import FitChart, FitCurve, GreyMap, draw_charts
from app.settings.protocol_steps import (
    Approach,
    Background,
    Drive,
    Hold,
    Motion,
    Reference,
    Step,
)
from app.settings.sections import Config
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.records.quantities import Measurement

O = TypeVar("O", bound=Section)  # noqa: E741 - the options of a calibration
FREE_S = 0.5  # for which a block must hang free before it is moved
PICTURE_S = 5  # between two pictures of a run that needs none
Data = Mapping[str, Any]  # by name: arrays, and numbers as such


@dataclass
class CalibrationResult:
    """What a calibration finds.

    Attributes
    ----------
    values : sequence of Measurement
        In SI units, with standard uncertainties.
    settings : dict
        ``table.key`` -> value in the units of the settings file.
    remarks : sequence of str
        What a reader should know.
    charts : sequence of FitChart or GreyMap
        Data, fit and what is left, for the certificate, in `columns` (`draw_charts`).
    fit
        What was fitted, for a picture that no chart describes.
    """

    values: Sequence[Measurement] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    charts: Sequence[FitChart | GreyMap] = ()
    columns: int = 0
    fit: Any = None

    def add(
        self,
        key: str,
        name: str,
        symbol: str,
        unit: str,
        value: float,
        sd: float = math.nan,
        **how: Any,
    ) -> None:
        """A value by its key in files: what it is, its symbol, the unit in which people read it;
        value and standard uncertainty in SI units; `how` are further fields of `Measurement`.
        """
        from app.records.quantities import Measurement

        found = Measurement(name, symbol, float(value), float(sd), unit, key=key, **how)
        self.values = (*self.values, found)

    def remark(self, *said: str) -> None:
        """What a reader should know as well."""
        self.remarks = (*self.remarks, *said)

    def set(self, key: str, value: float, relative_sd: float) -> None:
        """A setting, ``table.key``, in its unit, and its relative standard uncertainty."""
        self.settings |= {key: value, f"uncertainty.{key.partition('.')[2]}": 100 * relative_sd}

    def chart(self, x: str, y: str, *curves: Sequence[Any], **how: Any) -> None:
        """A chart of curves, each the values of a `FitCurve`, under labels of x and y; `how` are
        further fields of `FitChart`.
        """
        self.charts = (*self.charts, FitChart(x, y, [FitCurve(*one) for one in curves], **how))


class Calibration(ABC, Generic[O]):
    """A calibration.

    Attributes
    ----------
    name : str
        ``slipscope calibrate NAME``.
    title : str
        What it finds, for help and window.
    files : str
        What can be evaluated, for help: "SESSION.h5...", "MAP"; of several there is a "..." or a
        space.
    valid_days : int
        For how long a certificate holds.
    Options : type of Section
        Its own options.
    of_files : tuple of str
        Those of the options that `gather` uses: the data of a certificate cannot follow them.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    files: ClassVar[str] = "SESSION.h5..."
    valid_days: ClassVar[int] = 180
    Options: ClassVar[type[Section]] = Section
    of_files: ClassVar[tuple[str, ...]] = ()

    @property
    def takes_several(self) -> bool:
        """Whether several files are evaluated together."""
        return "..." in self.files or " " in self.files

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

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """Data, fit and what is left, for the certificate: the charts of what was found."""
        draw_charts(figure, findings.charts, findings.columns)


def driven_run(
    config: Config, travel: float, velocity: float = 0.0, then: Sequence[Step] = (Hold(time=0.3),)
) -> Config:
    """The settings of a run that drives a free block by a travel in m, at a velocity in m/s (0:
    `run.velocity`), and `then` does more.
    """
    steps = (Reference(time=0.5), Drive(travel=travel, velocity=velocity), *then)
    return calibration_run(config, steps, velocity=velocity)


def calibration_run(
    config: Config,
    steps: Sequence[Step],
    *,
    velocity: float = 0.0,
    shear: float = 0.0,
    is_of_forces: bool = False,
    **changes: Any,
) -> Config:
    """The settings of a run that does `steps`, without live correlation.

    Parameters
    ----------
    velocity : float
        That of the stage in m/s; 0: `run.velocity`.
    shear : float
        Share of P that a contact may show at least and count as pressed.
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
        shear_tolerance=max(config.run.shear_tolerance, shear),
    )
    recording = replace(config.recording, results="forces")
    if is_of_forces:
        each = max(config.camera.divisor, PICTURE_S * config.forces.sample_rate)
        changes["camera"] = replace(config.camera, divisor=each)
    return replace(config, **{"run": run, "recording": recording, **changes})
