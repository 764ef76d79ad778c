"""How far the board can be at a time of the computer's clock, hours after the start."""

import math
from types import SimpleNamespace

import pytest

from drivers.bench import ClockedForces
from drivers.clock import ANCHORED_S, DRIFT, SampleClock
from drivers.errors import DeviceFault

RATE = 1000.0


def started(pace=1.0):
    clock = SampleClock(RATE, pace)
    clock.start()
    clock.began_s = 0.0
    return clock


def ask(clock, at_s, *, starts_s=0.01, ppm=0.0, behind=0.0, takes_s=0.002, pace=1.0):
    """Ask a board that started after it was told to, and whose answer is `behind` samples."""
    newest = (at_s - starts_s) * RATE * pace * (1 + ppm * 1e-6) - behind
    clock.anchor(max(0, math.floor(newest)), at_s, at_s + takes_s)


@pytest.mark.slow
@pytest.mark.parametrize("pace", [1.0, 2.0])
@pytest.mark.parametrize("ppm", [-600, -100, 0, 100, 600])
def test_the_bound_stays_close_for_hours_and_is_never_passed(ppm, pace):
    clock = started(pace)
    for tenth in range(1, 72_000):
        at_s = tenth / 10
        stands = 300 if tenth % 200 < 30 else 0  # a busy computer hands nothing over for 3 s
        ask(clock, at_s, ppm=ppm, behind=stands + 5 * (tenth % 3), pace=pace)
        if tenth % 1000 == 0:
            taken = (at_s - 0.01) * RATE * pace * (1 + ppm * 1e-6)
            slack = clock.latest(at_s) - taken
            assert 0 <= slack <= 40 * pace, at_s


def test_an_answer_that_took_long_makes_the_bound_no_closer():
    clock = started()
    for second in range(1, 200):
        # at first the answer is of its end, later of its beginning
        late_s = 0.08 if second < ANCHORED_S else 0.0
        clock.anchor(round((second + late_s) * RATE), second, second + 0.08)
    assert clock.latest(200.0) >= 200 * RATE


def test_without_answers_the_start_bounds_the_clock():
    clock = started()
    assert clock.latest(100.0) == pytest.approx(100 * RATE * (1 + DRIFT) + 1)
    ask(clock, 50.0)  # nothing was learned at the start
    assert clock.latest(100.0) == pytest.approx(100 * RATE * (1 + DRIFT) + 1)


def test_a_start_forgets_the_answers_of_the_run_before():
    clock = started()
    for second in range(1, 100):
        ask(clock, float(second))
    assert clock.latest(100.0) < 100 * RATE * (1 + DRIFT)
    clock.start()
    clock.began_s = 0.0
    assert clock.latest(100.0) == pytest.approx(100 * RATE * (1 + DRIFT) + 1)


def test_a_clock_that_no_wall_clock_binds_has_no_bound():
    clock = started(None)
    ask(clock, 1.0)
    assert clock.latest(1.0) == math.inf


@pytest.mark.parametrize(("is_in_read_time", "told"), [(False, 70), (True, 0)])
def test_samples_that_wait_count_where_the_stage_is_known_for_them(is_in_read_time, told):
    board = SimpleNamespace(name="board", backlog=lambda: 70)
    forces = ClockedForces(board, started(), stage_in_read_time=is_in_read_time)
    assert forces.backlog() == told


@pytest.mark.parametrize("wrong", [-1, 2**60, None, 7.5])
def test_a_backlog_that_is_no_number_of_samples_is_refused(wrong):
    """One below 0 put the stage on samples before the first, which cost the session."""
    board = SimpleNamespace(name="board", backlog=lambda: wrong)
    with pytest.raises(DeviceFault, match=f"board: its driver gave {wrong} for its backlog"):
        ClockedForces(board, started()).backlog()
