"""Pictures that were recorded, and of which little could be measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from app.records.effort import Product
from app.records.record_types import Snapshot

# of `analysis.dic.status.Status`, which the process of a bench does not load
OK, LOW_CONTRAST, OUT_OF_IMAGE, MASKED, STATES = 0, 1, 2, 6, 8
DAMAGED = 0.8  # a picture of which less than this share of the usual points could be measured


@dataclass(frozen=True, slots=True)
class Damage:
    """Pictures of which far fewer points could be measured than usually: how many, the number of
    the newest, the share of its points that was lost; and the share that usually is measured, the
    most that was usual so far and the least after that, NaN before the first.
    """

    pictures: int = 0
    newest: int = -1
    lost: float = math.nan
    usual: float = math.nan
    most: float = math.nan
    least: float = math.nan

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
            pictures = self.pictures + 1
            return replace(
                self, pictures=pictures, newest=snapshot.frame, lost=1 - share, usual=float(usual)
            )
        if Product.PICTURE not in snapshot.effort.products:  # the contact alone shows more
            return replace(self, usual=share)
        if not share <= self.most:
            return replace(self, usual=share, most=share, least=share)
        return replace(self, usual=share, least=min(self.least, share))

    @property
    def fading(self) -> str:
        """That fewer and fewer points could be measured; empty where that is not so."""
        if not self.least < DAMAGED * self.most:
            return ""
        return (
            f"the share of the points that could be measured fell from {self.most:.0%} to"
            f" {self.least:.0%} in the course of the run: the focus, the light or the surface"
            " changed, and t_s, mu_s, E and L may be off beyond their uncertainties"
        )

    def __str__(self) -> str:
        """What an operator should know of it; empty where there is none."""
        if not self.pictures:
            return ""
        lost = f"frame {self.newest}: {self.lost:.0%} of its points could not be measured"
        if self.pictures == 1:
            return f"a picture is damaged, or something hid the contact: {lost}"
        return f"{self.pictures} pictures are damaged, or something hid the contact; last in {lost}"
