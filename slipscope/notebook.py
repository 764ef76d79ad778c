"""A session for a notebook: frames, forces and results as arrays in SI units, each read from the
file when it is first used.

>>> from slipscope import Session
>>> with Session("sample7.h5") as s:
...     time_s, normal_n, shear_n = s.forces
"""

from __future__ import annotations

import math
import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from analysis.arrays import F64, Rows
from app.records.legs import numbered_instants
from app.records.record_types import ContactResult, Counts, Event, Phase, SourceSession
from app.records.snapshot_numbers import snapshot_of
from app.records.study_results import RingSeries
from app.records.summary import Summary
from app.report.summary_rows import Row, outcome_rows
from app.session.analyses import analyses_of
from app.session.checked import Closable
from app.session.reader import SessionReader
from app.session.tables import Columns, rings_of, session_table
from app.settings.toml_text import parse_toml
from app.system.errors import UserError
from slipscope.displays import as_html, axes_for
from slipscope.frames_and_fields import Fields, Frames

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from analysis.dic.deformation import Strain
    from analysis.inversion import Inversion


class Forces(NamedTuple):
    """The forces at the full rate, each of shape (samples,); NaN where a sample is missing.

    `time_s` counts from the first sample.
    """

    time_s: F64
    normal_force_n: F64
    shear_force_n: F64


class Channel(NamedTuple):
    """A further channel at the full rate, `values` of shape (samples,) in its own `unit`; NaN where
    a sample is missing.
    """

    unit: str
    values: F64


class StageReadings(NamedTuple):
    """The readings of the stage, both of shape (readings,); `time_s` counts as in `Forces`, the
    position is in the stage's own coordinate, NaN where it could not be read.
    """

    time_s: F64
    position_m: F64


class Session(Closable):
    """A recorded experiment. Units are SI and in the names; use it in a ``with`` statement, or
    `close` it.

    Parameters
    ----------
    path : str or Path
        The file that ``slipscope run`` wrote; it is only read.

    Raises
    ------
    FileNotFoundError
        There is no such file; it is a UserError too.
    UserError
        From here and from every attribute: the file cannot be read, is no session or is damaged;
        the message says what to do.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._reader = SessionReader(Path(path))

    def __repr__(self) -> str:
        return (
            f"<Session {self._reader.path.name}: {self.state}, {len(self.frames)} triggers,"
            f" {len(self.results)} results>"
        )

    def _repr_html_(self) -> str:
        outcome = self._reader.outcome
        rows = [Row("ended", outcome.ended_as, outcome.reason), *outcome_rows(outcome)]
        return as_html(self._reader.path.name, rows)

    def close(self) -> None:
        """Close the file; arrays stay. May be called twice."""
        self._reader.close()

    @cached_property
    def frames(self) -> Frames:
        """The raw images."""
        return Frames(self._reader)

    @cached_property
    def fields(self) -> Fields:
        """The displacement fields; ``fields[i]`` belongs to ``results[i]``."""
        return Fields(self._reader)

    def during(self, start_s: float, end_s: float) -> slice:
        """The rows of `results`, `fields` and `rings` from one time to another, seconds from the
        start of the drive, the end not included: ``s.fields[s.during(2.0, 3.5)]``.
        """
        time_s = self.results["time_s"]
        rows = np.flatnonzero((time_s >= start_s) & (time_s < end_s))
        return slice(int(rows[0]), int(rows[-1]) + 1) if len(rows) else slice(0, 0)

    def traction(self, i: int, method: str = "regularised", **contact: float) -> Inversion:
        """The shear traction under ``fields[i]``, the motion of the lens taken off.

        Parameters
        ----------
        i : int
            Row of the results; one of the drive.
        method : str
            ``"regularised"`` (the whole field, the most accurate), ``"cgls"``, ``"van-cittert"``,
            ``"axisymmetric"`` (a profile) or ``"coupled"`` (from u_x and u_y).
        **contact
            In place of what the session holds, SI units: ``normal_force``, ``modulus``,
            ``poisson``, ``radius``, ``roughness``, ``thickness``.

        Returns
        -------
        Inversion
            ``sigma`` and ``sigma_sd``, pascals, at the points of ``fields[i]``, shape (ny, nx); of
            ``"axisymmetric"`` a profile with ``radius``, metres. ``D``, metres; ``Q``, newtons.

        Raises
        ------
        UserError
            The frame has no field or is none of the drive, or its field does not allow it.
        """
        # with what computes, which reading does without
        from app.files.field_files import read_fields
        from app.files.inverting import contact_of, invert_series, with_centre

        frame = self.fields[i].frame
        series = with_centre(read_fields(self._reader.path, None, frames=[frame]))
        settings = contact_of(series, {"method": method, **contact})
        failures: list[str] = []
        for one in invert_series(series, settings, failures):
            return one.result
        raise UserError(f"{self._reader.path}: {failures[0]}")

    def strain(self, i: int, points: int = 5) -> Strain:
        """The strain of the surface in ``fields[i]`` since the reference, by least squares over
        windows of `points` x `points` boxes; see `slipscope.dic.strain`.

        Returns
        -------
        Strain
            ``xx``, ``yy`` and ``xy``, dimensionless, each of shape (ny, nx); NaN where not
            measured.

        Raises
        ------
        UserError
            The frame has no field.
        ValueError
            The window is no odd number from 3 on.
        """
        from analysis.dic import strain

        field = self.fields[i]
        return strain(field.x_m, field.y_m, field.ux_m, field.uy_m, points)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the load curve: the shear force (N) against the stage displacement (um) during the
        drive, with the static force and the numbered instants; ``fields[i].plot()`` draws a field.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Where; default: those of a new figure. They are returned.
        """
        from app.report.figures import draw_force

        names, shots = self.results.dtype.names or (), []
        for row in self.results.tolist():
            numbers = dict(zip(names, row, strict=True))
            shots.append(snapshot_of(numbers | {"phase": Phase(numbers["phase"])}))
        numbered = [shots[i] for i in numbered_instants(shots, self.summary)]
        drive = [shot for shot in shots if shot.conditions.phase is Phase.DRIVE]
        axes = axes_for(axes)
        draw_force(axes, drive, numbered, self.summary)
        axes.set_title(self._reader.path.name)
        return axes

    @cached_property
    def forces(self) -> Forces:
        """Time (s), normal force P and shear force Q (N) of every sample."""
        newtons = self._reader.forces().forces
        time_s = np.arange(len(newtons)) / self.sample_rate_hz
        return Forces(time_s, newtons[:, 0], newtons[:, 1])

    @cached_property
    def auxiliary(self) -> dict[str, Channel]:
        """Name -> the further channels of ``forces.auxiliary``; empty where there are none."""
        channels, values = self._reader.header.auxiliary, self._reader.forces().auxiliary
        if channels is None or values is None:
            return {}
        named = zip(channels.name, channels.unit, values.T, strict=True)
        return {name: Channel(unit, column) for name, unit, column in named}

    @cached_property
    def results(self) -> Rows:
        """The results of each analysed frame as a structured array; NaN where a quantity could not
        be measured.

        Its fields are the numbers of `Snapshot`: ``frame``, ``sample``, ``phase`` (as text),
        ``time_s`` (from the start of the drive), ``shear_force_n`` (Q), ``normal_force_n`` (P),
        ``travel_m``, ``stick_radius_m`` (c), ``stick_radius_sd_m``, ...; ``*_sd`` is a standard
        uncertainty.
        """
        return self._reader.results()

    @cached_property
    def rings(self) -> RingSeries:
        """The ring means of u_x (`radius_m`, `ux_m`, `ux_sd_m`) and of the shear traction
        (`stress_radius_m`, `stress_pa`, `stress_sd_pa`) about the contact's centre, each of shape
        (results, rings): row n belongs to ``results[n]``; NaN where nothing was measured.
        """
        return rings_of(self._reader)

    def table(self, what: str, frames: range | None = None) -> Columns:
        """A table as ``slipscope export --what`` writes it: column -> array, all of one length.

        ``pandas.DataFrame(s.table("rings"))`` takes it as it is, and so does
        ``xarray.Dataset.from_dataframe(pandas.DataFrame(...))``, one variable for each column.
        `xarray.Dataset` itself would take each column for a dimension.

        Parameters
        ----------
        what : str
            ``"results"``, ``"rings"``, ``"stress"``, ``"pressure"``, ``"summary"``, ``"budget"``,
            ``"forces"``, ...; ``slipscope export --help`` lists them.
        frames : range, optional
            Only rows of frames with these numbers.

        Raises
        ------
        UserError
            There is no such table, or the session has nothing for it.
        """
        return session_table(self._reader, what, frames)

    @cached_property
    def drive_start_s(self) -> float:
        """When the drive began, in the time of `forces`; NaN if it did not.

        ``results["time_s"]`` counts from there.
        """
        for event in self.events:
            if (event.kind, event.text) == ("phase", str(Phase.DRIVE)):
                return event.sample / self.sample_rate_hz
        return math.nan

    @property
    def summary(self) -> Summary | None:
        """The results of the experiment (a, Q_s, mu_s, ...); None in a run that was not
        finished or failed.
        """
        return self._reader.outcome.summary

    @cached_property
    def contact(self) -> ContactResult | None:
        """The apparent contact; None where it was not measured."""
        return self._reader.contact()

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Table -> option -> value of the settings used, in the units of the settings file:
        ``settings["run"]["normal_force"]``.
        """
        try:
            return parse_toml(self._reader.header.config_toml)
        except ValueError as error:
            raise UserError(
                f"{self._reader.path}: the session's settings cannot be read: {error}"
            ) from None

    @cached_property
    def events(self) -> list[Event]:
        """The events, in order: phases, limits, stops."""
        return self._reader.events()

    @cached_property
    def gaps(self) -> list[tuple[int, int]]:
        """First sample and number of samples of each gap in the forces."""
        return self._reader.gaps()

    @cached_property
    def stage(self) -> StageReadings:
        """The readings of the stage."""
        samples, metres = self._reader.positions()
        return StageReadings(samples / self.sample_rate_hz, metres)

    @property
    def counts(self) -> Counts:
        """The counts of triggers, frames and samples: received, recorded, lost."""
        return self._reader.outcome.counts

    @cached_property
    def lost_frames(self) -> list[tuple[int, int, str]]:
        """Trigger number, sample and reason of each frame that was lost."""
        return self._reader.lost_frames()

    @property
    def sample(self) -> str:
        """Name of the sample; empty where it was not given."""
        return self._reader.header.sample

    @property
    def operator(self) -> str:
        """Who ran the experiment; empty where it was not given."""
        return self._reader.header.operator

    @property
    def note(self) -> str:
        """The note of the operator."""
        return self._reader.header.note

    @property
    def versions(self) -> dict[str, str]:
        """Name -> version of the program and libraries that made the results, and the computer they
        were made on.
        """
        return self._reader.header.versions

    @property
    def source(self) -> SourceSession | None:
        """The session that holds the images of a further analysis; None where they are in this
        file.
        """
        return self._reader.header.source

    @cached_property
    def analyses(self) -> list[Path]:
        """Files beside this session with other results of the same images (``slipscope replay
        --set``), each a `Session`.
        """
        return analyses_of(self._reader.path)

    @property
    def sample_rate_hz(self) -> float:
        """Rate of the samples, the clock of everything."""
        return self._reader.header.sample_rate_hz

    @property
    def pixel_m(self) -> float:
        """Side of a pixel on the interface."""
        return self._reader.header.pixel_m

    @property
    def state(self) -> str:
        """How the run ended: "done", "stopped", "failed" or "unfinished"."""
        return self._reader.outcome.ended_as

    @property
    def reason(self) -> str:
        """Why it ended, one sentence."""
        return self._reader.outcome.reason
