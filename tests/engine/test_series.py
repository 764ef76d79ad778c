"""The results of a long run in little memory: every number, the rings of enough frames, the fields
of the newest.
"""

import dataclasses

import numpy as np
import pytest

from app.engine.series import MOST_RINGS, Series
from app.results import Phase, Snapshot

DOUBLES = [field.name for field in dataclasses.fields(Snapshot) if field.type == "float"]


def snapshot(n, *, is_inverted=True):
    rng = np.random.default_rng(n)
    field, rings = rng.random((4, 5), np.float32), rng.random((6, 7))
    numbers = dict(zip(DOUBLES, rng.random(len(DOUBLES)).tolist(), strict=True))
    if not is_inverted:
        numbers["stress_force_n"] = np.nan
    fields = dict.fromkeys(
        ("ux_px", "uy_px", "ux_std_px", "uy_std_px", "zncc", "stress_field_pa"), field
    )
    names = (
        "ring_radius_m",
        "ring_ux_m",
        "ring_sd_m",
        "stress_radius_m",
        "stress_pa",
        "stress_sd_pa",
    )
    return Snapshot(
        n,
        125 * n,
        list(Phase)[n % 5],
        status=field.astype(np.uint8),
        **fields,
        **numbers,
        **dict(zip(names, rings, strict=True)),
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
        assert (a.frame, a.sample, a.phase) == (b.frame, b.sample, b.phase)
        assert [getattr(a, name) for name in DOUBLES] == [getattr(b, name) for name in DOUBLES]
        for name in ("ring_radius_m", "ring_ux_m", "ring_sd_m"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert all(
        a.ux_px.size == a.status.size == a.stress_pa.size == a.stress_field_pa.size == 0
        for a in found[:-1]
    )


@pytest.mark.parametrize("count", [MOST_RINGS, MOST_RINGS + 1, 2 * MOST_RINGS + 1, 5 * MOST_RINGS])
def test_rings_are_kept_of_evenly_chosen_frames_of_those_that_were_inverted(count):
    series = Series()
    for n in range(10):
        series.append(snapshot(n, is_inverted=False))
    one = snapshot(0)
    for n in range(count):
        series.append(dataclasses.replace(one, frame=10 + n))
    kept = [s.frame for s in series.since(0)[:-1] if s.ring_ux_m.size]
    assert MOST_RINGS / 2 <= len(kept) <= MOST_RINGS
    assert kept[0] == 10
    every = kept[1] - kept[0]
    assert kept == list(range(10, 9 + count, every))
    assert (
        every == {MOST_RINGS: 1, MOST_RINGS + 1: 2, 2 * MOST_RINGS + 1: 4, 5 * MOST_RINGS: 8}[count]
    )
