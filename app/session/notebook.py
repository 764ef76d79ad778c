"""A session for a notebook: frames, forces and results as arrays in SI units, read when they are
asked for.

>>> from app.session import Session
>>> with Session("sample7.h5") as s:
...     time_s, normal_n, shear_n = s.forces
"""

from __future__ import annotations

import math
import os
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self, overload

import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.results import ContactResult, Event, Phase, Source, Summary
from app.session.analyses import analyses_of
from app.session.reader import SessionReader
from app.toml import parse_toml


class Forces(NamedTuple):
    """The forces at the full rate, each of shape (samples,); NaN where a sample is missing.

    `time_s` counts from the first sample.
    """

    time_s: NDArray[np.float64]
    normal_force_n: NDArray[np.float64]
    shear_force_n: NDArray[np.float64]


class Field(NamedTuple):
    """The displacement of one frame from the reference, NaN where it could not be measured.

    `x_m` (nx,) and `y_m` (ny,) are places in the image, counted from its first pixel, y down;
    `ux_m`, `uy_m`, their standard uncertainties `ux_sd_m`, `uy_sd_m` and the correlation `zncc`
    have the shape (ny, nx). The motion of the lens, `lens_m`, which the holder's compliance allows,
    is still in `ux_m`.
    """

    frame: int
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    ux_m: NDArray[np.float64]
    uy_m: NDArray[np.float64]
    ux_sd_m: NDArray[np.float64]
    uy_sd_m: NDArray[np.float64]
    zncc: NDArray[np.float32]
    lens_m: float


class Frames:
    """The raw images by the number of their trigger, each read when it is asked for:
    ``frames[10]``; ``frames[10:20]`` is one array.

    The length is that of the triggers. A frame that was lost keeps its number: asking for it is a
    UserError that says why; `received` holds the numbers that have an image.
    """

    def __init__(self, reader: SessionReader) -> None:
        self._reader = reader
        triggers = reader.triggers()
        self._reasons = {
            int(row["index"]): row["reason"] for row in triggers if not row["received"]
        }
        self.received: NDArray[np.int64] = triggers["index"][triggers["received"]]
        self._count = len(triggers)

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int, /) -> NDArray[Any]: ...
    @overload
    def __getitem__(self, index: slice, /) -> NDArray[Any]: ...
    def __getitem__(self, index: int | slice, /) -> NDArray[Any]:
        if isinstance(index, slice):
            shape = self._reader.frame_shape
            images = [self[n] for n in range(*index.indices(len(self)))]
            return np.stack(images) if images else np.empty((0, *shape), self._reader.frame_dtype)
        n = index + len(self) if index < 0 else index
        if not 0 <= n < len(self):
            raise IndexError(
                f"{self._reader.path}: frame {index} was asked, there are {len(self)}, counted from"
                " 0"
            )
        if n in self._reasons:
            raise UserError(
                f"{self._reader.path}: frame {n} was lost: {self._reasons[n]}; `frames.received`"
                " tells which there are"
            )
        return self._reader.frame(n)[2]


class Fields:
    """The displacement fields, one for each row of the results, each read when it is asked for:
    ``fields[i]``.
    """

    def __init__(self, reader: SessionReader) -> None:
        self._reader = reader

    def __len__(self) -> int:
        return len(self._reader.analysed_frames())

    def __getitem__(self, i: int) -> Field:
        r, n = self._reader, i + len(self) if i < 0 else i
        if not 0 <= n < len(self):
            raise IndexError(
                f"{r.path}: field {i} was asked, there are {len(self)}, counted from 0"
            )
        found, pixel = r.snapshot(n), r.pixel_m
        if not found.ux_px.size:
            raise UserError(
                f"{r.path}: result {n} has no field: frame {found.frame} came before the reference;"
                " ask for a later one"
            )
        ux, uy, ux_sd, uy_sd = (
            np.float64(pixel) * part
            for part in (found.ux_px, found.uy_px, found.ux_std_px, found.uy_std_px)
        )
        return Field(
            found.frame,
            pixel * r.grid_x_px,
            pixel * r.grid_y_px,
            ux,
            uy,
            ux_sd,
            uy_sd,
            found.zncc,
            found.lens_m,
        )


class Session:
    """A recorded experiment. Units are SI and in the names; use it in a ``with`` statement, or
    `close` it.

    Parameters
    ----------
    path : str or Path
        The file that `slipscope run` wrote; it is only read.

    Raises
    ------
    UserError
        From here and from everything asked: the file can not be read, is no session or is damaged;
        the message says what to do.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._reader = SessionReader(Path(path))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return (
            f"<Session {self._reader.path.name}: {self.state}, {len(self.frames)} triggers,"
            f" {len(self.results)} results>"
        )

    def close(self) -> None:
        """Let go of the file; arrays stay. May be called twice."""
        self._reader.close()

    @cached_property
    def frames(self) -> Frames:
        """The raw images."""
        return Frames(self._reader)

    @cached_property
    def fields(self) -> Fields:
        """The displacement fields; ``fields[i]`` belongs to ``results[i]``."""
        return Fields(self._reader)

    @cached_property
    def forces(self) -> Forces:
        """Time (s), normal force P and shear force Q (N) of every sample."""
        first, _, newtons = self._reader.forces()
        return Forces(
            (first + np.arange(len(newtons))) / self._reader.sample_rate_hz,
            newtons[:, 0],
            newtons[:, 1],
        )

    @cached_property
    def results(self) -> NDArray[np.void]:
        """What was found on each analysed frame, as a structured array, NaN where it could not be
        told.

        Its fields are the numbers of `app.results.Snapshot`: `frame`, `sample`, `phase` (as text),
        `time_s` (from the start of the drive), `shear_force_n` (Q), `normal_force_n` (P),
        `travel_m`, `stick_radius_m` (c), `stick_radius_sd_m`, ...; `*_sd` is a standard
        uncertainty.
        """
        return self._reader.results()

    @cached_property
    def drive_start_s(self) -> float:
        """When the drive began, in the time of `forces`; NaN if it did not.

        ``results["time_s"]`` counts from there.
        """
        began = [
            event.sample
            for event in self.events
            if (event.kind, event.text) == ("phase", str(Phase.DRIVE))
        ]
        return began[0] / self._reader.sample_rate_hz if began else math.nan

    @cached_property
    def summary(self) -> Summary | None:
        """What the experiment comes down to (a, Q_s, mu_s, ...); None in a run that was not
        finished or failed.
        """
        return self._reader.summary()

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
            return parse_toml(self._reader.config_toml)
        except ValueError as error:
            raise UserError(
                f"{self._reader.path}: the session's settings can not be read: {error}"
            ) from None

    @cached_property
    def events(self) -> list[Event]:
        """What happened, in order: phases, limits, stops."""
        return self._reader.events()

    @cached_property
    def gaps(self) -> list[tuple[int, int]]:
        """First sample and number of samples of each gap in the forces."""
        return self._reader.gaps()

    @cached_property
    def lost_frames(self) -> list[tuple[int, int, str]]:
        """Trigger number, sample and reason of each frame that was lost."""
        return self._reader.lost_frames()

    @property
    def versions(self) -> dict[str, str]:
        """Name -> version of the program and libraries that made the results, and the computer they
        were made on.
        """
        return self._reader.versions

    @property
    def source(self) -> Source | None:
        """Of a further analysis: the session that holds the images.

        None where they are in this file.
        """
        return self._reader.source

    @cached_property
    def analyses(self) -> list[Path]:
        """Files beside this session with other results of the same images (`slipscope replay
        --set`), each a `Session`.
        """
        return analyses_of(self._reader.path)

    @property
    def sample_rate_hz(self) -> float:
        """Rate of the samples, the clock of everything."""
        return self._reader.sample_rate_hz

    @property
    def pixel_m(self) -> float:
        """Side of a pixel on the interface."""
        return self._reader.pixel_m

    @property
    def state(self) -> str:
        """How the run ended: "done", "failed" or "unfinished"."""
        return self._reader.state

    @property
    def reason(self) -> str:
        """Why it ended, one sentence."""
        return self._reader.reason
