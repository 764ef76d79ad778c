"""The faults of the emulated bench, through the drivers of a real one: what the operator is told,
what the stage does, what the file holds.

The same faults on the simulated bench are in tests/engine/test_faults.py.
"""

import numpy as np
import pytest
from hil_run import HilRun
from short_run import BLIND

DRIVE = 2500  # a sample by which the drive has begun


@pytest.fixture
def ended(tmp_path):
    return lambda *faults, more=(), **options: HilRun(
        tmp_path / "faulty.h5", f"sim.faults={list(faults)}", *BLIND, *more, **options
    )


@pytest.mark.slow
def test_losses_are_found_at_their_true_index_and_the_run_goes_on(ended):
    """A corrupt picture is kept, and a noisy line is asked again."""
    e = ended(
        "lost-trigger 5",
        "lost-frame 8 2",
        "lost-trigger 35 3",
        "late-trigger 25 7",
        "corrupt-frame 30",
        f"noisy-line {DRIVE} 10",
        "lost-frame 50",
    )
    assert (e.outcome.state, e.outcome.reason) == ("done", "the drive of 30 um is complete")
    assert set(e.lost) == {5, 8, 9, 35, 36, 37, 50}
    assert all("missed" in e.lost[n] for n in (5, 35, 36, 37)), e.lost
    assert all("missed" not in e.lost[n] for n in (8, 9, 50)), e.lost
    assert {n: sample - 125 * n for n, (sample, _) in e.triggers.items() if sample != 125 * n} == {
        25: 7
    }
    assert e.wrong_frames() == [30]


@pytest.mark.slow
def test_an_exposure_that_is_not_counted_shifts_no_frame(ended):
    e = ended("uncounted-exposure 20", "uncounted-exposure 40 2")
    assert e.outcome.state == "done", e.outcome.reason
    assert e.wrong_certain_frames() == []
    assert e.wrong_frames() == [] or e.uncertain  # a busy machine may be too late to prove it


@pytest.mark.slow
def test_a_broken_exposure_wire_is_told_by_name(ended):
    e = ended("exposure-wire 30", pace=1.0)
    assert e.wrong_certain_frames() == []
    told = [event for event in e.events if "exposure wire" in event.text]
    assert told, e.events
    assert told[0].sample < 125 * 30 + 6000


def test_a_camera_that_goes_away_ends_the_run_and_stops_the_drive(ended):
    e = ended("camera-gone 35", pace=1.0)
    e.check_failed("camera")
    # those that it had exposed and not handed over are gone with it
    assert set(e.frames) == set(range(len(e.frames)))
    assert 15 < len(e.frames) <= 35


@pytest.mark.parametrize("goes_on", [False, True])
def test_an_overflow_is_a_gap_at_its_place(ended, goes_on):
    e = ended(f"daq-overflow {DRIVE} 300", more=["forces.on_overflow=continue"] if goes_on else [])
    assert e.outcome.state == ("done" if goes_on else "failed"), e.outcome.reason
    (first, count), *more = e.gaps
    assert not more
    assert first <= DRIVE
    assert DRIVE + 300 <= first + count <= DRIVE + 700
    assert np.isnan(e.volts[first : first + count]).all()
    assert np.isfinite(np.delete(e.volts, np.arange(first, first + count), axis=0)).all()
    assert "are lost" in e.outcome.reason or goes_on
    assert e.stands()
    if goes_on:
        assert e.wrong_frames() == []  # nothing was shifted


def test_a_server_that_is_killed_ends_the_run_with_all_that_was_read(ended):
    e = ended(f"daq-gone {DRIVE}")
    e.check_failed("NI board 'Dev1'")
    # what the killed server still held is gone with it
    assert DRIVE - 2000 <= len(e.volts) <= DRIVE + 50


def test_a_saturated_sensor_ends_the_run_by_its_name(ended):
    e = ended(f"saturated {DRIVE}")
    e.check_failed("the shear sensor is at the end of its range")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("stall 15", ("it stands at 15", "following error")),
        ("end-of-run 15", ("end switch", "end of run")),
    ],
)
def test_a_stage_that_can_not_go_on_is_told(ended, fault, words):
    e = ended(fault)
    e.check_failed(*words, stands=False)
    assert e.world.stage_m() == pytest.approx(15e-6, abs=0.1e-6)


def test_a_cut_line_ends_the_run_and_says_that_the_stop_was_not_confirmed(ended):
    e = ended(f"unplugged {DRIVE}")
    e.check_failed("emulated SMC100", stands=False)
    # told within a second of the wall clock, which is two of the world's
    assert DRIVE - 2000 <= len(e.volts) <= DRIVE + 3500
