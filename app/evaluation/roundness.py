"""What the frames of a run tell against a round contact, about which all rings are drawn."""

from __future__ import annotations

import math

from analysis.contact.apparent import ApparentContact
from analysis.contact.rings import Rings
from analysis.contact.roundness import Departure, departure_from_round
from app.settings.sections import Config

CERTAIN = 3.5  # times its standard uncertainty from which a departure is there
LEAST = 0.01  # share of the slip at the rim from which it matters
OFTEN = 0.25  # share of the frames from which it is told


class Roundness:
    """Notes of a contact that is not round, and how many frames of a run depart from one."""

    def __init__(self, config: Config) -> None:
        dic = config.dic
        self._poisson = config.sample.poisson
        self._shared = max(1.0, (dic.noise_box_px / dic.step) ** 2)
        self._frames = self._uneven = 0
        self._largest: Departure | None = None
        self.centre_sd_m = math.nan

    def of_contact(self, found: ApparentContact, pixel_m: float) -> list[str]:
        """Of the contact about whose centre the rings are drawn: whether its micro-contacts fill an
        ellipse.
        """
        self.centre_sd_m = math.hypot(*found.centre_sd_px) / math.sqrt(2) * pixel_m
        if not math.isfinite(found.angle):
            return []
        long, short = (1e3 * axis * pixel_m for axis in found.axes_px)
        return [
            "contact: it is not round: the micro-contacts fill an ellipse of half axes"
            f" {long:.2f} and {short:.2f} mm, the long one at"
            f" {math.degrees(found.angle):.0f} degrees from the rows of the picture; a is that of a"
            " disc of its area, and results of rings are means over the azimuth"
        ]

    def add(self, rings: Rings, radius: float) -> None:
        """A further frame of the drive, with the contact's radius, metres."""
        if not math.isfinite(self.centre_sd_m):
            return
        found = departure_from_round(rings, radius, self._poisson, self._shared, self.centre_sd_m)
        if found is None:
            return
        self._frames += 1
        if found.is_seen(CERTAIN, LEAST):
            self._uneven += 1
            if self._largest is None or found.size > self._largest.size:
                self._largest = found

    def notes(self) -> list[str]:
        """What limits the results of rings, of the run so far."""
        found = self._largest
        if found is None or not self._uneven > OFTEN * self._frames:
            return []
        share = found.size / max(abs(found.slip), found.size)
        how = (
            "one side slips before the other, as where friction is uneven, or the block tilted"
            if found.first * found.second_noise > found.second * found.first_noise
            else "it slips sooner one way than the other, as where the contact is longer one way or"
            " has a gap, or the lens distorts"
        )
        return [
            f"contact: in {self._uneven} of {self._frames} frames u_x departs from that of a round"
            f" contact with even friction, by up to {1e6 * found.size:.2g} um or"
            f" {100 * share:.3g} % of the slip at its rim: {how}. c, sigma(r) and p(r) are means"
            " over the azimuth; they and L may be off beyond their uncertainties"
        ]
