"""Worlds that are not what the methods assume, from pictures to the summary: what the program says
of a contact that is not round, and of a picture that shakes.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import short_run
from extremes.uneven_world import NU, E, R, Uneven, ellipse

from app.evaluation.pipeline import Pipeline
from app.records.record_types import Conditions, Phase
from app.records.summary import Summary
from app.settings.sections import Config

SMALL = Uneven(P=0.0195, pressure=ellipse(743e-6, 743e-6), size=320, v=4e-6, rate=6, frames=30)
ELLIPSE = replace(SMALL, pressure=ellipse(850e-6, 650e-6))


def shaken(t: float) -> tuple[float, float, float]:
    """By 0.3 px both ways and 0.02 degrees, at 7 Hz."""
    angle = 2 * math.pi * 7.3 * t
    return 0.3 * math.sin(angle), 0.3 * math.cos(angle), math.radians(0.02) * math.sin(angle + 1)


def measured(world: Uneven, angle_from: str = "motion") -> Summary:
    """What a run in this world comes down to."""
    c = Config()
    own = {"young_modulus": E, "lens_radius": R, "poisson": NU, "roughness": 1e-7}
    config = replace(
        c,
        camera=replace(
            c.camera, width=world.size, height=world.size, pixel=world.pixel, angle_from=angle_from
        ),
        sample=replace(c.sample, **own),
        dic=replace(c.dic, threads=1),
    )
    pipeline, snapshots = Pipeline(config), []
    rng = np.random.default_rng(world.seed)
    for n, t in enumerate([None, 0.0, *((np.arange(world.frames) + 0.5) / world.rate).tolist()]):
        phase = (Phase.BACKGROUND, Phase.REFERENCE, Phase.DRIVE)[min(n, 2)]
        Q = world.at(t or 0.0)[1] + 3e-4 * rng.normal()
        at = t if phase is Phase.DRIVE else math.nan
        now = Conditions(phase, at, world.P if n else 0.0, Q, world.v * (t or 0.0))
        snapshots.append(pipeline.step(n, 125 * n, world.image(n, t), now))
    pipeline.close()
    with short_run.without_budget():
        return pipeline.summary(snapshots)


@pytest.mark.parametrize("world", [SMALL, ELLIPSE], ids=["round", "ellipse"])
def test_a_contact_that_is_not_round_is_told_and_a_is_that_of_its_area(world: Uneven) -> None:
    summary = measured(world)
    notes = [note for note in summary.notes if note.startswith(("contact: ", "picture: "))]
    if world is SMALL:
        assert notes == []
    else:
        assert any("half axes 0.8" in note and "it is not round" in note for note in notes)
        assert any("u_x departs from that of a round contact" in note for note in notes)
    a = math.sqrt(850e-6 * 650e-6)
    assert abs(summary.apparent_radius_m - a) < 2.5 * summary.apparent_radius_sd_m
    assert summary.apparent_radius_sd_m < 0.05 * a


def test_a_picture_that_shakes_is_told_and_so_is_each_frame_that_it_costs() -> None:
    world = replace(SMALL, shake=shaken)
    summary = measured(world)
    notes = " ".join(summary.notes)
    found = re.search(r"its centre jumps from frame to frame by ([\d.]+) px", notes)
    assert found
    assert 0.1 < float(found[1]) < 0.3
    assert re.search(r"do without \d+ of 30 frames of the drive", notes)
    assert math.isnan(summary.onset_time_s)
    remedied = measured(world, "angle")
    assert "its centre jumps" in " ".join(remedied.notes)
    assert "do without" not in " ".join(remedied.notes)
    assert "camera.angle_from" not in " ".join(remedied.notes)
