"""What goes wrong on a bench, one fault at a time: what the operator is told, what the actuator
does, and what the file holds.
"""

import numpy as np
import pytest
import short_run
from whole_runs import PATIENCE_S, RunFile

from app.records.record_types import Phase
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from drivers.protocols import LostSamples
from drivers.sim.faults import FAULTS, parse
from slipscope import Session

SMALL = (*short_run.SMALL, *short_run.BLIND, "run.travel=30")
SEEN = ("recording.results=fields", "camera.width=480", "camera.height=360")
DRIVE = short_run.DRIVE + 200  # it ends beyond 7900


class Ended(RunFile):
    """A run with one fault, ended."""

    def __init__(self, path, fault, *overrides):
        settings = config.load(None, [*SMALL, f"sim.faults=['{fault}']", *overrides])
        self.run = live.make_run(settings, path, pace=None)
        self.run.start()
        self.end()
        self.read(path, settings.run.travel)


@pytest.fixture
def ended(tmp_path):
    return lambda fault, *overrides: Ended(tmp_path / "faulty.h5", fault, *overrides)


@pytest.mark.parametrize(
    ("fault", "where", "words"),
    [
        ("lost-trigger 5 3", (5, 6, 7), "missed trigger"),
        ("lost-frame 40", (40,), "lost on its way"),
    ],
)
def test_a_lost_image_is_a_named_loss_at_its_index_and_the_run_goes_on(ended, fault, where, words):
    e = ended(fault)
    assert (e.outcome.state, e.outcome.reason) == ("done", "the drive of 30 um is complete")
    assert tuple(e.lost) == where
    assert all(words in reason for reason in e.lost.values())
    assert f"{len(where)} ×" in (told := e.run.health().losses)
    assert words in told
    assert all(sample == 125 * index for index, (sample, _) in e.triggers.items())
    assert e.stands()


def test_a_board_that_gives_gap_after_gap_in_the_drive_ends_the_run(tmp_path):
    """Nobody knew the forces, no limit was looked at, and the run never ended."""
    more = ("forces.on_overflow=continue", "limits.age=0.2", *short_run.BLIND)
    run = live.make_run(config.load(None, [*short_run.SMALL, *more]), tmp_path / "x.h5", pace=5.0)
    read = run._bench.forces.read

    def blind(timeout):
        block = read(timeout)
        if run._history.phase_start(Phase.DRIVE) is None:
            return block
        return LostSamples(block.first, len(block.volts), "board: overwritten")

    run._bench.forces.read = blind
    run.start()
    outcome = run.wait(PATIENCE_S)
    assert outcome.state == "failed"
    assert "nothing but gaps came for 0.2" in outcome.reason
    assert 0 < outcome.counts.samples_lost < 5000
    with Session(tmp_path / "x.h5") as session:
        assert session.counts.samples_lost == outcome.counts.samples_lost


def test_a_run_whose_reference_is_lost_ends_instead_of_waiting_for_it(ended):
    e = ended("lost-trigger 4 40", "camera.divisor=250", "run.travel=20")
    e.check_failed("16 of 20 triggers have no image")
    assert "(16 × simulated camera: missed trigger, " in e.outcome.reason
    assert e.world.stage_m() == 0.0


@pytest.mark.parametrize("counted", [False, True])
def test_a_late_trigger_is_seen_where_the_board_counts_the_exposures(ended, counted):
    e = ended("late-trigger 30 7", *(["forces.exposure_counter=ctr1"] if counted else []))
    assert e.outcome.state == "done"
    assert e.counts.frames_lost == 0
    assert e.triggers[30][0] == 125 * 30 + (7 if counted else 0)
    assert e.triggers[31][0] == 125 * 31
    assert e.run.health().exposures == (e.counts.triggers if counted else -1)


def test_a_corrupt_picture_is_kept_and_only_its_own_points_are_lost(ended, tmp_path):
    e = ended("corrupt-frame 30", *SEEN)
    assert e.outcome.state == "done"
    with SessionReader(tmp_path / "faulty.h5") as s:
        lost = {
            snapshot.frame: float((snapshot.field.status != 0).mean())
            for snapshot in s.snapshots()
            if snapshot.field is not None
        }
    assert 0.3 < lost[30] < 0.7
    assert max(lost[29], lost[31], lost[32]) < 0.05
    assert e.frames[30][1][200:].std() > 2 * e.frames[29][1][200:].std()


def test_a_camera_that_goes_away_ends_the_run_and_stops_the_drive(ended):
    e = ended("camera-gone 30")
    e.check_failed("simulated camera: it was unplugged at trigger 30")
    assert set(e.frames) == set(range(30))
    assert all("no image came before the run ended" in reason for reason in e.lost.values())
    assert 0 < e.world.stage_m() < 30e-6


def test_an_overflow_is_a_gap_with_its_length_and_ends_the_run(ended):
    e = ended(f"daq-overflow {DRIVE + 7} 300")
    e.check_failed(f"300 samples from {DRIVE + 7} on are lost")
    assert e.gaps == [(DRIVE + 7, 300)]
    assert e.counts.samples_lost == 300
    assert np.isnan(e.volts[DRIVE + 7 : DRIVE + 307]).all()
    assert np.isfinite(e.volts[: DRIVE + 7]).all()
    assert next(event.text for event in e.events if event.kind == "gap").startswith(
        "300 samples lost"
    )


def test_a_run_may_go_on_after_an_overflow_and_nothing_is_shifted(ended, small_run):
    e = ended(f"daq-overflow {DRIVE} 300", "forces.on_overflow=continue", *SEEN, "run.travel=60")
    assert (e.outcome.state, e.outcome.reason) == ("done", "the drive of 60 um is complete")
    assert e.gaps == [(DRIVE, 300)]
    path, calm = small_run
    with SessionReader(path) as s:
        volts = s.forces().volts
    np.testing.assert_array_equal(e.volts[:DRIVE], volts[:DRIVE])
    n = min(len(e.volts), len(volts))
    # the drive began at another block
    np.testing.assert_allclose(e.volts[DRIVE + 300 : n], volts[DRIVE + 300 : n], atol=0.03)
    assert e.outcome.summary.mu_s == pytest.approx(calm.summary.mu_s, rel=0.01)


def test_a_board_that_goes_away_ends_the_run_with_all_that_was_read(ended):
    e = ended(f"daq-gone {DRIVE + 500}")
    e.check_failed("the board no longer answers")
    assert DRIVE + 400 <= len(e.volts) <= DRIVE + 500


def test_a_saturated_sensor_ends_the_run_by_its_name(ended):
    e = ended(f"saturated {DRIVE}")
    e.check_failed("the shear sensor is at the end of its range of 10 V")
    assert e.volts[DRIVE:, 1].max() == pytest.approx(10, abs=0.001)
    assert len(e.volts) < DRIVE + 300


def test_a_stage_that_stands_ends_the_run_within_seconds(ended):
    e = ended("stall 20")
    e.check_failed("actuator: it stands at 20.0 um of travel while it should move")
    reached = np.flatnonzero(e.newtons[:, 1] > 0.99 * np.nanmax(e.newtons[:, 1]))[0]
    assert len(e.volts) - reached < 4000


def test_an_end_of_run_is_told(ended):
    e = ended("end-of-run 20")
    e.check_failed("the stage met its end switch after 20 um")


def test_a_cut_line_ends_the_run_and_says_that_the_stop_was_not_confirmed(ended):
    e = ended(f"unplugged {DRIVE}")
    e.check_failed("the line is dead", stands=False)
    assert len(e.volts) >= DRIVE
    e.world.advance(30_000)
    assert not e.world.is_moving()  # a bounded move ends by itself
    assert e.world.stage_m() <= 30.001e-6


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        ("noisy-line 5", "it has no line that could be noisy"),
        ("mute-controller 5", "for the fault 'mute-controller'"),
        ("deaf-controller 5", "for the fault 'deaf-controller'"),
        ("silent-server 5", "they come from no server"),
        ("slow-server 5", "for the fault 'slow-server'"),
    ],
)
def test_what_is_not_there_can_not_be_at_fault(tmp_path, fault, sentence):
    run = live.make_run(
        config.load(None, [*SMALL, f"sim.faults=['{fault}']"]), tmp_path / "x.h5", pace=None
    )
    run.start()
    assert sentence in run.wait(PATIENCE_S).reason


@pytest.mark.parametrize(
    "text",
    [
        "",
        "lost-tirgger 4",
        "lost-trigger",
        "lost-trigger x",
        "lost-trigger -1",
        "lost-trigger 1 2 3",
        "stall nan",
    ],
)
def test_what_is_no_fault_is_refused(text, tmp_path):
    with pytest.raises(ValueError, match=r"no fault is called|write 'KIND AT'"):
        parse(text)


def test_every_fault_is_explained():
    assert all(parse(f"{kind} 7").kind == kind and "AT" in FAULTS[kind] for kind in FAULTS)
