"""What the frames of a run tell the step of its protocol that is under way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from app.evaluation import conclusions
from app.experiment.live_findings import LiveFindings
from app.records.record_types import Conditions, Phase, Snapshot
from app.settings import config

STEPS = '{do="approach"}, {do="reference"}, {do="drive", travel=50}, {do="drive", until_slid=9}'


def frame(number, step):
    now = Conditions(Phase.DRIVE, 0.0625 + 0.125 * number, 0.5, 0.1, 0.0)
    return Snapshot(number, 125 * number, replace(now, step=step))


@pytest.fixture
def found(monkeypatch):
    """What is found in frames of step 3 and then of step 4; and in which an onset was looked for,
    0.2 s after the middle of the first of these.
    """
    asked = []

    def onset(_, frames):
        asked.append([one.frame for one in frames])
        return frames[0].conditions.time_s + 0.2

    monkeypatch.setattr(conclusions, "onset_on_the_way", onset)
    frames = [[frame(0, 3), frame(1, 3)], [frame(2, 3), frame(3, 4)], [frame(4, 4)], []]
    settings = config.load(None, [f"run.steps=[{STEPS}]", "camera.exposure=30"])
    findings = LiveFindings(settings, lambda _: frames.pop(0))
    return [findings.look() for _ in range(4)], asked


def test_an_onset_is_looked_for_in_the_frames_of_the_step_under_way(found):
    assert found[1] == [[0, 1], [3], [3, 4]]


def test_an_onset_is_told_by_the_sample_on_which_it_came(found):
    seen, _ = found
    first = np.array([0, 375, 375, 375])
    assert [one.onset_sample for one in seen] == pytest.approx(first + 15 + 200)
    assert [one.sample for one in seen] == [125, 375, 500, 500]
    assert all(math.isnan(one.stick_share) for one in seen)  # which no step waits for
