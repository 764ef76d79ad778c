"""The analysis of an experiment, live or recorded: from frames to results."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.evaluation.damage import Damage
from app.evaluation.history import DriveForces, History
from app.evaluation.series import Series
from app.records.effort import Effort
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import REFERENCE, Conditions, ContactResult, Event, Snapshot
from app.records.summary import Summary
from app.settings.sections import Config

# number, sample and image of a frame, and what is to be computed of it
Following = tuple[int, int, NDArray[np.generic], Effort]


class FrameAnalysis(Protocol):
    """What analyses frame by frame, here (`app.evaluation.pipeline`) or in a process of its own."""

    contact: ContactResult | None
    reference_frame: int | None
    pattern: PixelPattern | None  # what it undoes in every picture

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        now: Conditions,
        effort: Effort,
        following: Following | None = None,
    ) -> Snapshot: ...
    def restart(self) -> None: ...
    def summary(self, snapshots: list[Snapshot], forces: DriveForces | None) -> Summary: ...
    def close(self) -> None: ...


class Analysis:
    """An experiment on its way from frames to results, live or recorded.

    Only here the pipeline is stepped. One thread steps; the rest may be read from any.

    Attributes
    ----------
    history : History
        What the bench has measured so far.
    pipeline : FrameAnalysis
    reference_image : ndarray or None
        From which displacements are measured.
    series : Series
        One snapshot per analysed frame.
    uncertain : set of int
        Those of them that another trigger may have taken.
    damage : Damage
        Of their pictures.
    """

    def __init__(self, config: Config, pipeline: FrameAnalysis) -> None:
        self.config = config
        self.history = History(
            float(config.forces.sample_rate), config.exposure_samples, config.run.direction
        )
        self.pipeline = pipeline
        self.reference_image: NDArray[np.generic] | None = None
        self.series = Series()
        self.uncertain: set[int] = set()
        self._revoked_from: int | None = None
        self.damage = Damage()

    def step(
        self,
        index: int,
        sample: int,
        image: NDArray[np.generic],
        append: Callable[[Event | Snapshot], None],
        effort: Effort,
        *,
        is_certain: bool = True,
        waited_s: float | None = None,
        following: Following | None = None,
    ) -> Effort:
        """Analyse the next frame and append the result to the record; what it took, too, where it
        is said for how long the frame has waited.

        Everything up to the end of its exposure must be in the history. The frame after it, if it
        is there already, is begun.
        """
        began = time.perf_counter()
        now = self.history.conditions(sample)
        snapshot = self.pipeline.step(index, sample, image, now, effort, following)
        if waited_s is not None:
            effort = replace(effort, took_s=time.perf_counter() - began, waited_s=waited_s)
            snapshot = replace(snapshot, effort=effort)
        if self.pipeline.reference_frame == index:
            self.reference_image = image
            append(Event(sample, REFERENCE, f"frame {index}", index))
        has_fields = self.config.recording.results == "fields"
        append(snapshot if has_fields else replace(snapshot, field=None))
        if not is_certain:
            self.uncertain.add(index)
        self.series.append(snapshot)
        self.damage = self.damage.after(snapshot)
        return effort

    def revoke(self, first: int | None) -> None:
        """No frame from `first` on is of a certain trigger: the account of the run does not hold;
        None if it does. To be called when all frames are analysed.
        """
        if first is None:
            return
        self._revoked_from = first
        self.uncertain |= {one.frame for one in self.series.since(0) if one.frame >= first}

    def close(self) -> None:
        """Let the threads of the correlation go. May be called twice."""
        self.pipeline.close()

    def summary(self) -> Summary | None:
        """What the experiment comes down to, once it is closed; None if no frame was analysed, or
        if the run was for a calibration.

        Frames whose trigger is uncertain are left out, unless they are more than half of all.
        """
        snapshots, doubtful = self.series.since(0), len(self.uncertain)
        if not snapshots or self.config.run.purpose == "calibration":
            return None
        used, notes = snapshots, []
        if doubtful:
            why = ""
            if self._revoked_from is not None:
                why = f", from frame {self._revoked_from} on because the account does not hold"
            many = 2 * doubtful > len(snapshots)
            used = snapshots if many else [s for s in snapshots if s.frame not in self.uncertain]
            notes.append(
                f"camera: the trigger of {doubtful} of {len(snapshots)} frames is uncertain{why}; "
                + ("the results rest on them too" if many else "the results do without them")
            )
        # later samples are known in a live run alone
        known = snapshots[-1].sample + self.history.exposure_samples
        summary = self.pipeline.summary(used, self.history.drive_forces(known))
        if self.damage.pictures:
            notes.append(f"camera: {self.damage}")
        if fading := self.damage.fading:
            notes.append(f"camera: {fading}")
        return replace(summary, notes=(*summary.notes, *notes))
