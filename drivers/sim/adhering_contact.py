"""Smooth faces that adhere: their contact after a history of loads."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.mechanics import jkr
from analysis.settings import Sample
from drivers.sim.scenario import Scenario


@dataclass(frozen=True, slots=True)
class AdheringContact:
    """A contact of Johnson, Kendall and Roberts, with the work of adhesion that it has at this
    radius under this force: between that of closing and that of opening.

    Attributes
    ----------
    radius : float
        Metres; 0 where the faces do not touch.
    force : float
        Normal force, newtons.
    sample : Sample
    """

    radius: float
    force: float
    sample: Sample

    def pressure(self, r: ArrayLike) -> F64:
        """Pressure at the distance r from the centre, pascals, negative where it pulls."""
        if not self.radius:
            return np.zeros(np.shape(r))
        w = float(jkr.work_of_adhesion(self.radius, self.force, *self.sample.bodies))
        return jkr.pressure(r, self.radius, w, *self.sample.bodies)


def adhering_contact(
    loads: Iterable[float], adhesion: tuple[float, float], sample: Sample
) -> AdheringContact:
    """The contact after these loads (newtons), between which the force changes one way: its edge
    moves out where it is smaller than under the work of adhesion of closing, in where it is larger
    than under that of opening, and rests in between. Beyond the pull-off the faces are apart.
    """
    radius = force = 0.0
    for force in loads:
        radii = (jkr.contact_radius(force, work, *sample.bodies) for work in adhesion)
        least, most = map(np.nan_to_num, radii)
        # faces that have parted touch again under no pull
        radius = float(np.clip(radius, least if radius or force >= 0 else 0.0, most))
    return AdheringContact(radius, force, sample)


def adhering_faces(scenario: Scenario, sample: int, P: float) -> AdheringContact | None:
    """The faces of a world on a sample, under P newtons; None where they do not adhere."""
    s = scenario
    if s.sim.pressure != "jkr" or sample < s.press_sample:
        return None
    # the loads that were reached before that of now, which is on its way from the last of them
    begun = [load for began, load in s.loads if began <= sample]
    reached = [s.normal_force, *begun[:-1]] if begun else []
    return adhering_contact([*reached, P], s.sim.adhesion, s.sample)
