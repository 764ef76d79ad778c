"""The results of a long run in little memory: every number, the rings of enough frames, all of the
newest.
"""

import dataclasses
import threading

import numpy as np
import pytest

from app.evaluation.series import MOST_RINGS, Series
from app.records.record_types import (
    Conditions,
    DisplacementField,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
    Stick,
    StressProfile,
    Traction,
)
from app.records.snapshot_numbers import numbers_of


def snapshot(n, *, is_inverted=True):
    rng = np.random.default_rng(n)
    field = rng.random((4, 5), np.float32)
    return Snapshot(
        n,
        125 * n,
        Conditions(list(Phase)[n % 5], *rng.random(4).tolist()),
        motion=FrameMotion(*rng.random(2).tolist()),
        field=DisplacementField(*[field] * 5, status=field.astype(np.uint8)),
        rings=RingProfile(*rng.random((3, 7))),
        stick=Stick(*rng.random(3).tolist()) if n % 3 else None,
        traction=Traction(*rng.random(6).tolist()) if is_inverted else None,
        stress=StressProfile(*rng.random((3, 7))),
        stress_field_pa=field,
    )


def test_every_number_comes_back_and_the_newest_is_whole():
    series, given = Series(), [snapshot(n) for n in range(20)]
    assert (len(series), series.since(0)) == (0, [])
    for one in given:
        series.append(one)
    found = series.since(5)
    assert (len(series), len(found)) == (20, 15)
    assert found[-1] is given[-1]
    for a, b in zip(found, given[5:], strict=True):
        np.testing.assert_equal(numbers_of(a), numbers_of(b))
        assert (a.stick is None) == (b.stick is None)
        for name in ("radius_m", "ux_m", "sd_m"):
            np.testing.assert_array_equal(getattr(a.rings, name), getattr(b.rings, name))
    assert all(part is None for a in found[:-1] for part in (a.field, a.stress, a.stress_field_pa))


@pytest.mark.parametrize("count", [MOST_RINGS, MOST_RINGS + 1, 2 * MOST_RINGS + 1, 5 * MOST_RINGS])
def test_rings_are_kept_of_evenly_chosen_frames_of_those_that_were_inverted(count):
    series = Series()
    for n in range(10):
        series.append(snapshot(n, is_inverted=False))
    one = snapshot(0)
    for n in range(count):
        series.append(dataclasses.replace(one, frame=10 + n))
    kept = [s.frame for s in series.since(0)[:-1] if s.rings is not None]
    at_rest, kept = kept[:2], kept[2:]
    assert at_rest == [2, 7]
    assert MOST_RINGS / 2 <= len(kept) <= MOST_RINGS
    assert kept[0] == 10
    every = kept[1] - kept[0]
    assert kept == list(range(10, 9 + count, every))
    assert (
        every == {MOST_RINGS: 1, MOST_RINGS + 1: 2, 2 * MOST_RINGS + 1: 4, 5 * MOST_RINGS: 8}[count]
    )


def test_the_newest_is_whole_whenever_it_is_read():
    """A frame that comes while the results are read takes nothing from the one before it."""
    series = Series()
    series.append(snapshot(0))
    inside, later, found = threading.Event(), snapshot(1), []

    class Rows(type(series._rows)):
        def __getitem__(self, where):
            inside.set()
            appending.join(0.5)  # it either waits for this, or has come by then
            return super().__getitem__(where)

    series._rows = Rows("d", series._rows)

    def append():
        inside.wait(30)
        series.append(later)

    appending = threading.Thread(target=append)
    appending.start()
    found = series.since(0)
    appending.join()
    assert found[-1].field is not None
    assert series.since(0)[-1] is later
