"""What is computed of each frame: who asks for it, and what is left out for want of time."""

import math

import pytest

from app.evaluation import quality
from app.evaluation.quality import LATEST_S, Quality
from app.records.effort import Asker, Effort, Product
from app.settings import config

PERIOD_S = 42e-3
ALL = Product.CONTACT | Product.PICTURE | Product.SETTLED


def made(*settings, pace=1.0):
    return Quality(config.load(None, ["camera.divisor=42", *settings]), pace)


class Machine:
    """A processor on which the analysis takes as long as what is computed, times `load`."""

    COSTS = ((Product.CONTACT, 6e-3), (Product.PICTURE, 8e-3), (Product.SETTLED, 6e-3))
    EVERY_POINT_S = 30e-3

    def __init__(self, quality):
        self.quality, self.now_s, self.load = quality, 0.0, 1.0
        self.late_s, self.changes, self.steps = [], [], []

    def run(self, seconds, load):
        for _ in range(round(seconds / PERIOD_S)):
            products = self.quality.effort().products
            took = load * sum(cost for of, cost in self.COSTS if products & of)
            took += load * self.EVERY_POINT_S * bool(products & Product.EVERY_POINT)
            waited = max(0.0, took - PERIOD_S)
            skipped = int(took // PERIOD_S)
            self.now_s += max(took, PERIOD_S)
            change = self.quality.took(waited, took, skipped, self.now_s)
            if change:
                self.changes.append((self.now_s, change))
            self.late_s.append(waited + took)
            self.steps.append(self.quality.shed)


def test_without_auto_nothing_is_left_out():
    machine = Machine(made())
    machine.run(10, load=20)
    assert set(machine.steps) == {0}
    assert machine.quality.may_be_late


def test_an_analysis_that_is_not_live_leaves_nothing_out():
    machine = Machine(made("dic.quality=auto", pace=None))
    machine.run(10, load=20)
    assert set(machine.steps) == {0}


def test_steps_are_left_out_one_after_the_other_until_frames_are_in_time_and_come_back():
    machine = Machine(made("dic.quality=auto", "stress.field=true"))
    machine.quality.shows()
    machine.run(3, load=0.5)
    assert set(machine.steps) == {0}
    machine.run(6, load=6)
    assert machine.steps[-1] == 4
    pairs = zip(machine.steps[1:], machine.steps, strict=False)
    assert [step for step, last in pairs if step != last] == [1, 2, 3, 4]
    assert max(machine.late_s[-20:]) < LATEST_S
    machine.run(40, load=0.3)
    assert machine.steps[-1] == 0
    assert any("far from the contact" in change for _, change in machine.changes)


def test_what_nobody_asks_for_is_no_step():
    machine = Machine(made("dic.quality=auto"))  # no traction of every point
    machine.run(1, load=1)
    machine.run(6, load=8)
    assert sorted(set(machine.steps)) == [0, 1, 3, 4]


def test_a_load_between_two_steps_does_not_make_it_swing():
    machine = Machine(made("dic.quality=auto"))
    # with the whole picture 0.95 of a period, without it 0.55
    machine.run(300, load=0.95 * PERIOD_S / 20e-3)
    changes = sum(a != b for a, b in zip(machine.steps, machine.steps[1:], strict=False))
    assert changes <= 30  # 300 s, at most one relapse in 20 s
    assert machine.quality._calm_s == quality.MOST_CALM_S or changes <= 4


def test_a_frame_that_was_skipped_calls_for_less():
    q = made("dic.quality=auto")
    assert not q.took(0.0, 0.01, 0, 1.0)
    assert "before it had none" in q.took(0.0, 0.01, 3, 2.0)
    assert q.shed == 1
    assert not q.took(0.0, 0.01, 3, 2.0 + LATEST_S / 2)  # the change has not come to bear yet


@pytest.mark.parametrize(
    ("results", "products"),
    [("fields", ALL), ("profiles", Product.CONTACT | Product.SETTLED), ("forces", Product(0))],
)
def test_what_is_computed_is_what_is_recorded_or_shown(results, products):
    q = made(f"recording.results={results}", "stress.field=true")
    assert q.effort().products == products
    assert q.effort().asked_by == (Asker.RECORD if products else 0)
    q.shows()
    assert q.effort().products == ALL | Product.EVERY_POINT
    assert q.effort().asked_by & Asker.WINDOW
    q._shown_until = -math.inf  # the window was closed
    assert q.effort().products == products


def test_a_session_of_an_older_format_had_everything_computed():
    assert Effort().products == ALL | Product.EVERY_POINT
