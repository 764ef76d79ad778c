"""What the analysis of the frames tells the protocol while the stage moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from app.evaluation.setup import hertz_radius_m
from app.records.record_types import Phase, Snapshot
from app.settings.protocol_steps import Motion
from app.settings.sections import Config

MOST_FRAMES = 400  # most frames in which an onset is looked for while the stage moves


@dataclass(frozen=True, slots=True)
class Seen:
    """What is known from the frames that were analysed so far.

    Attributes
    ----------
    sample : int
        On which the exposure of the newest of them began.
    stick_share : float
        c in it over Hertz's contact radius under P, which it is at rest; NaN where c cannot be
        told.
    onset_sample : float
        t_s of the step under way, on the sample clock; NaN until it is found.
    """

    sample: int = -1
    stick_share: float = math.nan
    onset_sample: float = math.nan


class LiveFindings:
    """Follows the snapshots of a run, as its protocol asks.

    Parameters
    ----------
    snapshots : callable
        Those after the first n.
    """

    def __init__(
        self,
        config: Config,
        snapshots: Callable[[int], list[Snapshot]],
    ) -> None:
        self._config, self._snapshots = config, snapshots
        self._seen, self._count, self._step = Seen(), 0, 0
        self._frames: list[Snapshot] = []  # of the step under way, without their fields
        steps = [step for step in config.run.protocol if isinstance(step, Motion)]
        self._finds_onsets = any(step.until_slid >= 0 for step in steps)
        self._tells_stick = any(step.until_stick > 0 for step in steps)
        if self._finds_onsets or self._tells_stick:  # it takes long: not while the stage moves
            import app.evaluation.conclusions  # noqa: F401

    def look(self) -> Seen:
        """What is known now."""
        new = self._snapshots(self._count)
        if not new:
            return self._seen
        self._count += len(new)
        newest = new[-1]
        if newest.conditions.step != self._step:
            self._step, self._frames = newest.conditions.step, []
        self._frames += [
            replace(s, field=None)
            for s in new
            if s.conditions.phase is Phase.DRIVE and s.conditions.step == self._step
        ]
        self._seen = Seen(
            newest.sample,
            self._stick_share(newest) if self._tells_stick else math.nan,
            self._onset_sample() if self._finds_onsets else math.nan,
        )
        return self._seen

    def _stick_share(self, newest: Snapshot) -> float:
        a = hertz_radius_m(self._config, newest.conditions.normal_force_n)
        return newest.stick_radius[0] / a if a > 0 else math.nan

    def _onset_sample(self) -> float:
        from app.evaluation.conclusions import onset_on_the_way

        if len(self._frames) > 2 * MOST_FRAMES:
            self._frames = self._frames[::2]
        time_s = onset_on_the_way(self._config, self._frames)
        if not self._frames or not math.isfinite(time_s):
            return math.nan
        first, rate = self._frames[0], self._config.forces.sample_rate
        middle = first.sample + self._config.exposure_samples / 2
        return middle + (time_s - first.conditions.time_s) * rate
