"""Pictures that were recorded, and of which little could be measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.records.record_types import Snapshot

# of `analysis.dic.status.Status`, which the process of a bench does not load
OK, LOW_CONTRAST, OUT_OF_IMAGE, MASKED, STATES = 0, 1, 2, 6, 7
DAMAGED = 0.8  # a picture of which less than this share of the usual points could be measured


@dataclass(frozen=True, slots=True)
class Damage:
    """Pictures of which far fewer points could be measured than usually: how many, the number of
    the newest, the share of its points that was lost; and the share that usually is measured, NaN
    before the first.
    """

    pictures: int = 0
    newest: int = -1
    lost: float = math.nan
    usual: float = math.nan

    def after(self, snapshot: Snapshot) -> Damage:
        """The damage so far, with a further frame."""
        if snapshot.field is None:
            return self
        count = np.bincount(snapshot.field.status.ravel(), minlength=STATES)
        wanted = max(1, count.sum() - count[MASKED] - count[OUT_OF_IMAGE])
        share = float(count[OK] / wanted)
        # at first all that has a texture
        usual = 1 - count[LOW_CONTRAST] / wanted if math.isnan(self.usual) else self.usual
        if share < DAMAGED * usual:
            return Damage(self.pictures + 1, snapshot.frame, 1 - share, float(usual))
        return replace(self, usual=share)

    def __str__(self) -> str:
        """What an operator should know of it; empty where there is none."""
        if not self.pictures:
            return ""
        lost = f"frame {self.newest}: {self.lost:.0%} of its points could not be measured"
        if self.pictures == 1:
            return f"a picture is damaged, or something hid the contact: {lost}"
        return f"{self.pictures} pictures are damaged, or something hid the contact; last in {lost}"
