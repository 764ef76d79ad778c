"""Which pictures are called damaged, from what became of their points."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.dic.status import Status
from app.evaluation.damage import Damage
from app.records.effort import Effort, Product
from app.records.record_types import Conditions, DisplacementField, Phase, Snapshot


def snapshot(frame, **shares):
    """A frame of whose 100 points so many have a status, by its label; the others are measured."""
    status = np.zeros((10, 10), np.uint8)
    first = 0
    for label, count in shares.items():
        status.ravel()[first : first + count] = Status[label.upper()]
        first += count
    field = DisplacementField(*5 * [np.zeros((10, 10), np.float32)], status)
    now = Conditions(Phase.DRIVE, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Snapshot(frame, 125 * frame, now, field=field)


def after(*snapshots):
    damage = Damage()
    for one in snapshots:
        damage = damage.after(one)
    return damage


@pytest.mark.parametrize(
    "shares",
    [
        {"decorrelated": 15},  # fewer than usual, and enough
        {"masked": 60},  # not asked for
        {"out_of_image": 60},  # it has moved
        {"low_contrast": 60},  # nothing to be recognised, in the first as in the others
    ],
)
def test_what_may_be_is_no_damage(shares):
    assert not str(after(*(snapshot(n, **shares) for n in range(3))))


@pytest.mark.parametrize("label", ["decorrelated", "not_converged", "saturated", "low_contrast"])
def test_a_sudden_loss_is_told_with_its_frame_and_share(label):
    damage = after(snapshot(1), snapshot(2, **{label: 30}), snapshot(3))
    assert str(damage) == (
        "a picture is damaged, or something hid the contact: frame 2: 30% of its points could not"
        " be measured"
    )


def test_a_light_that_goes_out_for_good_is_not_what_is_usual():
    damage = after(snapshot(1), *(snapshot(n, low_contrast=90) for n in range(2, 9)))
    assert (damage.pictures, damage.newest) == (7, 8)
    assert str(damage).startswith("7 pictures are damaged")
    assert "last in frame 8: 90%" in str(damage)


def test_a_spoiled_reference_spoils_all_that_follow():
    assert after(*(snapshot(n, decorrelated=50) for n in range(5))).pictures == 5


def test_a_slow_loss_is_none_of_one_picture():
    assert after(*(snapshot(n, decorrelated=2 * n) for n in range(40))).pictures == 0


def test_points_that_are_found_little_by_little_are_not_lost():
    """As while the focus is set: the fewest come before the most."""
    found = after(*(snapshot(n, low_contrast=38 - 2 * n) for n in range(20)))
    assert (found.most, found.least, found.fading) == (1.0, 1.0, "")


def test_points_that_are_lost_little_by_little_are_told_though_no_picture_is_damaged():
    """As where the focus drifts: each frame shows nearly as much as the one before."""
    damage = after(*(snapshot(n, decorrelated=3 * n) for n in range(12)))
    assert not str(damage)
    assert "fell from 100% to 67%" in damage.fading
    assert not after(*(snapshot(n, decorrelated=n) for n in range(12))).fading
    assert not after(*(snapshot(n, decorrelated=33 - 3 * n) for n in range(12))).fading
    contact_alone = Effort(computed=int(Product.CONTACT))
    shed = (replace(snapshot(n, decorrelated=3 * n), effort=contact_alone) for n in range(12))
    assert not after(*shed).fading
    assert not after(snapshot(0), snapshot(1, decorrelated=90), snapshot(2)).fading
