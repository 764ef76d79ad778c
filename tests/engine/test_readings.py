"""Zeros, cross-talk and drift that the settings do not know: each is in the uncertainty of what it
changes, and told where the run shows it.
"""

from __future__ import annotations

import math
import re
import tempfile
from functools import cache
from pathlib import Path

from short_run import SMALL, TRACTION

from app.records.summary import Summary
from app.runs import live
from app.settings import config

WORLD = (
    *SMALL,
    TRACTION,
    "camera.width=640",
    "camera.height=480",
    "camera.pixel=10",
    "sim.law=elasto-plastic",
    "sim.pressure=greenwood-tripp",
    "run.background_time=1",
    "run.reference_time=1.5",
    "run.shear_tolerance=0.1",
    "run.settle_tolerance=0.1",
    "sim.press_time=1.2",
)
ERRORS = (
    'sim.errors=["forces.zero_normal -0.003", "forces.zero_shear 0.005",'
    ' "forces.shear_from_normal -0.02", "forces.normal_from_shear 0.02"]'
)
MU = 0.93


@cache
def concluded(*settings: str) -> Summary:
    """What a run comes down to whose settings know nothing of the world's faults."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        run = live.make_run(config.load(None, (*WORLD, *settings)), path, pace=None)
        run.start()
        outcome = run.wait(300)
    assert outcome is not None
    assert outcome.state == "done", outcome.reason
    assert outcome.summary is not None
    return outcome.summary


def notes_of(summary: Summary) -> str:
    return "\n".join(n for n in summary.notes if n.startswith(("forces:", "drift:")))


def size(value: float, truth: float, sd: float, share: float) -> float:
    """Of an error, in stated standard uncertainties of both kinds."""
    return abs(value - truth) / math.hypot(sd, share * value)


def test_a_bench_without_faults_is_told_none() -> None:
    s = concluded()
    assert notes_of(s) == ""
    assert s.systematic("law_mu") < 0.02


def test_what_the_settings_do_not_know_is_told_and_is_in_the_uncertainty() -> None:
    """Zeros, cross terms, and a camera that creeps along the drive, all at once."""
    still, s = concluded(), concluded(ERRORS, "sim.image_drift=[0.003, 0]")
    told = notes_of(s)
    for what in (
        "before contact, without a force, P reads -2.99",
        "before contact, without a force, Q reads 4.97",
        "as the contact was pressed, Q came to read -2.06",
        "as the contact was sheared, P changed by ",
        "at rest under load the contact creeps by 0.03",
    ):
        assert what in told, told
    (share,) = re.findall(r"P changed by (\S+) \+- (\S+) %", told)
    assert abs(float(share[0]) - 2.0) < 3 * float(share[1])
    assert abs(s.law_mu / MU - 1) > 0.03
    assert size(s.law_mu, MU, s.law_mu_sd, s.systematic("law_mu")) < 1.5
    assert s.systematic("law_mu") < 2 * abs(s.law_mu / MU - 1)
    assert abs(s.law_length_m / still.law_length_m - 1) > 0.05
    both = s.law_length_sd_m, s.systematic("law_length")
    assert size(s.law_length_m, still.law_length_m, *both) < 1.5, both
    assert abs(s.onset_time_s - still.onset_time_s) < 1.5 * s.systematic("onset_time") * 5.5
