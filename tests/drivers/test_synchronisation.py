"""The account of frames in a world of faults, where every image carries the number of its trigger:
nothing that is said to be certain is wrong.
"""

import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.synchronisation import FAULTS, MODES, Plan, World, outcomes
from drivers.protocols import Frame

RUNS = 40
BOTH, COUNT, STAMPS, NEITHER = MODES
WITNESSED = MODES[:3]
PERIODS = (42, 50, 125, 250)


def played(mode, plan, seed=0):
    world = World(seed, mode, plan)
    answers = world.play()
    found = outcomes(answers)
    wrong = found["CERTAIN AND WRONG"], found["outside its range"]
    assert wrong == (0, 0), f"{found}, {plan}"
    return world, answers, found


@pytest.mark.parametrize("mode", MODES)
def test_no_frame_is_certain_and_wrong(mode):
    certain = 0
    for seed in range(RUNS):
        world = World(seed, mode)
        found = outcomes(world.play())
        wrong = found["CERTAIN AND WRONG"], found["outside its range"]
        assert wrong == (0, 0), f"seed {seed}: {found}, {world.faults}"
        certain += found["certain and right"]
    assert certain > 1000 or mode == NEITHER  # it is easy to be certain of nothing


@pytest.mark.slow
def test_within_an_hour_of_faults_few_frames_are_uncertain_and_none_is_wrong():
    plan = Plan(600, 3600.0, delay_s=0.7, jitter_s=0.05, drift_s=0.6, is_slewed=True)
    for n, kind in enumerate((*FAULTS, "uncounted exposure", "missed trigger")):
        plan.faults.append((kind, 300 + 350 * n))
    plan.steps = [(2000, -0.4), (4000, 0.6)]
    _, _, found = played(BOTH, plan)
    assert found["uncertain"] < 30


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_a_sound_bench_with_a_witness_is_certain_of_all(mode):
    """With both at any delay; with one where images come before the next exposure."""
    for seed in range(20):
        divisor = PERIODS[seed % len(PERIODS)]
        most = 3.0 if mode == BOTH else 0.5
        plan = Plan(divisor, 20.0, delay_s=most * divisor / 1000 * seed / 40, jitter_s=0.002)
        if mode == BOTH:
            plan.steps = [(20, divisor / 1000), (50, -divisor / 500)]
            plan.jitter_s = divisor / 1000 * (seed % 3)
        world, answers, _ = played(mode, plan, seed)
        assert all(isinstance(answer, Frame) for answer in answers)
        assert [answer.image for answer in answers] == list(range(world.triggers))
        assert {answer.is_certain for answer in answers} == {mode != NEITHER}


@settings(max_examples=30, deadline=None)
@given(
    divisor=st.sampled_from(PERIODS),
    periods=st.floats(0.0, 2.9),
    kind=st.sampled_from(["missed trigger", "uncounted exposure", "counted glitch", "lost image"]),
    where=st.integers(10, 60),
    seed=st.integers(0, 1000),
)
def test_both_witnesses_are_certain_again_after_one_fault(divisor, periods, kind, where, seed):
    delay_s = 0.003 + periods * divisor / 1000
    plan = Plan(divisor, 80 * divisor / 1000, [(kind, where)], delay_s, 0.002)
    _, _, found = played(BOTH, plan, seed)
    assert found["uncertain"] == 0


@settings(max_examples=30, deadline=None)
@given(
    divisor=st.sampled_from(PERIODS),
    periods=st.floats(0.0, 2.9),
    where=st.integers(10, 60),
    seed=st.integers(0, 1000),
)
def test_both_witnesses_are_certain_again_after_an_exposure_by_noise(divisor, periods, where, seed):
    delay_s = 0.003 + periods * divisor / 1000
    plan = Plan(divisor, 80 * divisor / 1000, [("extra exposure", where)], delay_s, 0.002)
    _, answers, found = played(BOTH, plan, seed)
    assert found["uncertain"] <= 4
    assert answers[-1].is_certain


@settings(max_examples=50, deadline=None)
@given(
    mode=st.sampled_from(WITNESSED),
    divisor=st.sampled_from(PERIODS),
    faults=st.lists(
        st.tuples(st.sampled_from(FAULTS), st.integers(0, 79)),
        max_size=3,
        unique_by=lambda fault: fault[1] // 10,
    ),
    periods=st.floats(0.0, 3.0),
    jitter=st.floats(0.0, 1.5),
    service=st.sampled_from([0.0, 0.5, 0.97, 1.0]),
    steps=st.lists(
        st.tuples(st.integers(0, 79), st.sampled_from([-2, -1, -0.5, 0.3, 1, 2])), max_size=2
    ),
    seed=st.integers(0, 100),
)
def test_whatever_happens_far_apart_what_is_certain_is_true(
    mode, divisor, faults, periods, jitter, service, steps, seed
):
    """No two faults at one place; the pairs that nobody can see are of two at one image."""
    period_s = divisor / 1000
    places = {where // 10 for _, where in faults}
    steps = [(n, by * period_s) for n, by in steps if n // 10 not in places]
    plan = Plan(divisor, 80 * period_s, faults, 0.003 + periods * period_s, jitter * period_s)
    plan.steps, plan.service_s = steps, service * period_s
    played(mode, plan, seed)


def late(periods, divisor=42):
    return 0.003 + periods * divisor / 1000


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "faults"),
    [
        # the delay rises from half a period to just over one before an exposure is not counted
        (BOTH, ["uncounted exposure"]),
        (COUNT, ["uncounted exposure"]),
        # with both, a transport that is slower by a period at the very image hides nothing
        (BOTH, ["uncounted exposure", "slower"]),
        # a queue drains by a period as a trigger is missed
        (COUNT, ["missed trigger", "faster"]),
        (STAMPS, ["missed trigger", "faster"]),
    ],
)
@pytest.mark.parametrize("periods", [1.08, 1.5, 2.2])
def test_a_delay_of_a_period_proves_nothing(mode, faults, periods):
    """Images 20 ms after the exposure, then more than a period: no image comes early enough any
    more to disprove what one witness says.
    """
    plan = Plan(42, 15.0, delay_s=0.02, jitter_s=0.002)
    plan.steps = [(20, late(periods) - 0.02)]
    for fault in faults:
        if fault in ("slower", "faster"):
            plan.steps.append((60, 0.042 if fault == "slower" else -0.042))
        else:
            plan.faults.append((fault, 60))
    _, _, found = played(mode, plan)
    assert found["certain and right"] >= 60


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "divisor", "where"), [(BOTH, 42, 20_000), (COUNT, 125, 7_000)])
def test_after_a_quarter_of_an_hour_an_exposure_not_counted_is_found_by_causality(
    mode, divisor, where
):
    """Images come in time: none that follows could have been exposed already one trigger later."""
    seconds = (where + 100) * divisor / 1000
    plan = Plan(divisor, seconds, [("uncounted exposure", where)], 0.013, 0.002)
    _, _, found = played(mode, plan)
    assert found["uncertain"] == 0
    plan.is_slewed = True
    _, _, found = played(mode, plan)
    assert found["uncertain"] == 0


def test_an_exposure_by_noise_is_no_frame_of_a_trigger():
    plan = Plan(125, 10.0, [("extra exposure", 30)], 0.2, 0.002)
    world, answers, _ = played(BOTH, plan, 3)
    assert [a.index for a in answers if not a.is_certain] in ([], [31])
    assert world.numbers.account.surplus == 1


@pytest.mark.slow
@pytest.mark.parametrize("mode", WITNESSED)
@pytest.mark.parametrize("where", [0, 30])
def test_an_exposure_by_noise_takes_no_place_of_an_image_that_was_lost(mode, where):
    plan = Plan(1500, 70.0, [("lost image", where), ("extra exposure", where)], 0.01, 0.002)
    for seed in range(10):
        _, answers, _ = played(mode, plan, seed)
        assert not any(a.is_certain and getattr(a, "image", 0) == -1 for a in answers)


@pytest.mark.slow
@pytest.mark.parametrize("where", [0, 1, 30])
@pytest.mark.parametrize("periods", [0.6, 1.1, 1.9])
def test_noise_that_takes_the_place_of_an_exposure_not_counted_shifts_no_frame(periods, where):
    """The count is complete again, one sample of it late, and no exposure was late."""
    certain = 0
    for seed in range(8):
        faults = [("extra exposure", where), ("uncounted exposure", where)]
        _, answers, found = played(BOTH, Plan(400, 40.0, faults, late(periods, 400), 0.008), seed)
        certain += found["certain and right"]
        assert sum(getattr(answer, "image", 0) == -1 for answer in answers) <= 1
    assert certain >= 8 * where


def test_after_an_image_without_an_id_the_first_with_one_is_no_noise():
    plan = Plan(250, 20.0, [("failed without id", 0)], 0.44, 0.0005)
    for seed in range(8):
        assert played(BOTH, plan, seed)[2]["uncertain"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "faults", "periods"),
    [
        (BOTH, [("uncounted exposure", 40), ("clock jump", 40)], 1.4),
        (BOTH, [("uncounted exposure", 40), ("lost image", 40), ("clock jump", 41)], 1.4),
        (STAMPS, [("lost image", 40), ("missed trigger", 41), ("clock jump", 40)], 0.3),
        (STAMPS, [("missed trigger", 1), ("clock jump", 2)], 0.3),
    ],
)
def test_a_jump_of_the_camera_s_clock_hides_no_other_fault(mode, faults, periods):
    """Some of these jumps are of a period, so that both witnesses tell a miss, or one tells none;
    how late the image comes says otherwise.
    """
    for seed in range(30):
        played(mode, Plan(125, 10.0, faults, late(periods, 125), 0.002), seed)


def test_without_ids_a_jump_of_the_camera_s_clock_hides_no_image_that_was_lost():
    faults = [("lost image", 40), ("clock jump", 40)]
    for seed in range(30):
        plan = Plan(125, 10.0, faults, late(0.3, 125), 0.002, has_ids=False)
        played(STAMPS, plan, seed)


def test_where_the_delay_scatters_a_miss_that_both_tell_waits_for_images_in_time():
    faults = [("uncounted exposure", 20), ("lost image", 20), ("clock jump", 21)]
    for seed in range(30):
        played(BOTH, Plan(250, 12.0, faults, 0.03, 0.375), seed)


def test_a_transport_that_became_slower_does_not_confirm_a_jump_of_the_camera_s_clock():
    for seed in range(30):
        plan = Plan(125, 15.0, [("clock jump", 80)], 0.02, 0.002, [(40, 0.125)], has_ids=False)
        played(STAMPS, plan, seed)


def test_after_noise_and_an_exposure_not_counted_images_in_time_are_certain_again():
    plan = Plan(
        400, 50.0, [("extra exposure", 0), ("uncounted exposure", 0)], late(1.1, 400), 0.008
    )
    plan.steps = [(60, -0.4)]
    for seed in range(6):
        assert played(BOTH, plan, seed)[2]["certain and right"] >= 60


def test_frames_of_a_slower_transport_keep_the_numbers_of_their_timestamps():
    """Without ids, nothing tells a transport that becomes slower by a period from a lost image."""
    plan = Plan(125, 10.0, delay_s=0.025, jitter_s=0.0005, drift_s=-0.16, has_ids=False)
    plan.steps = [(13, 0.25), (46, 0.25)]
    _, answers, found = played(STAMPS, plan)
    assert 0 < found["certain and right"] < found["uncertain"] < 80
    assert [answer.image for answer in answers] == list(range(80))


@pytest.mark.parametrize("periods", [0.4, 1.4, 2.4])
def test_a_count_that_the_delay_stands_by_is_believed(periods):
    plan = Plan(125, 20.0, [("missed trigger", 60)], late(periods, 125), 0.002)
    _, _, found = played(COUNT, plan)
    assert found["uncertain"] == 0
    plan.steps = [(60, -0.125)]
    _, _, found = played(COUNT, plan)
    assert found["uncertain"] >= 90 or periods < 1


def test_a_count_that_the_delay_stands_by_for_a_second_only_is_not_believed():
    """The transport is slower by a period just while an exposure was not counted."""
    plan = Plan(125, 20.0, [("uncounted exposure", 60)], 0.03, 0.002, [(60, 0.125), (68, -0.125)])
    _, _, found = played(COUNT, plan)
    assert found["certain and right"] == 160


def revoked(mode, faults):
    """From which frame on nothing is certain at the end, and how many frames were."""
    world, answers, _ = played(mode, Plan(125, 10.0, faults, 0.02, 0.002), 1)
    first = world.numbers.uncertain_from()
    assert ("it does not hold" in world.numbers.balance()) == (first is not None)
    return first, sum(a.is_certain for a in answers)


@pytest.mark.parametrize("mode", [BOTH, COUNT])
@pytest.mark.parametrize("kind", [None, "lost image", "missed trigger", "failed grab"])
def test_an_account_with_told_losses_holds(mode, kind):
    assert revoked(mode, [(kind, 30)] if kind else [])[0] is None


def test_an_exposure_that_only_the_timestamps_know_leaves_the_account():
    assert revoked(BOTH, [("uncounted exposure", 30)])[0] is None


def test_an_exposure_that_was_not_counted_and_no_timestamp_tells_breaks_the_account():
    first, certain = revoked(COUNT, [("uncounted exposure", 30)])
    assert certain > 60
    assert first in (0, 30)


def test_an_account_with_more_counts_than_exposures_does_not_hold():
    world, _, _ = played(COUNT, Plan(125, 10.0, [], 0.02, 0.002))
    assert world.numbers.uncertain_from() is None
    world.numbers._judge._off = -1  # no frame ends so: the witnesses tell it before
    assert world.numbers.uncertain_from() == 0


def test_what_was_exposed_in_lost_samples_breaks_no_account():
    faults = [("lost samples", 30), ("uncounted exposure", 30)]
    for seed in range(6):
        world, _, _ = played(COUNT, Plan(42, 10.0, faults, 0.02, 0.002), seed)
        assert world.numbers.uncertain_from() is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "seed"),
    [(MODES[0], 3), (MODES[0], 7), *((mode, seed) for mode in MODES[1:3] for seed in (22, 24))],
)
def test_no_frame_is_certain_and_wrong_after_ids_began_again(mode, seed):
    """A run of more images than 16 bits can number, with ids that begin with 0 and go on with 0 (3,
    22) or 1 (7, 24).
    """
    found = outcomes(World(seed, mode, Plan(42, 2760.0)).play())
    assert found["CERTAIN AND WRONG"] == found["outside its range"] == 0
    assert found["certain and right"] >= 65_530
