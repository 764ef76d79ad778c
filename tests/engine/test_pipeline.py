"""The pipeline alone, fed by hand with a recorded run."""

import math
import threading
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import short_run
from whole_runs import frames_of

from analysis.contact import registration
from analysis.contact.registration import background_tracker
from analysis.dic import Status
from app.evaluation import pipeline as pipeline_module
from app.evaluation.conclusions import conclude
from app.evaluation.pipeline import EFFORT, Pipeline
from app.records.effort import Effort
from app.records.legs import numbered_instants
from app.records.record_types import Phase
from app.settings import config
from tests.same_results import difference

OVERRIDES = (*short_run.SMALL, "run.travel=40")


@pytest.fixture(scope="module")
def recorded(small_run):
    """Settings, and the frames of a run until its drive has gone so far."""
    return config.load(None, OVERRIDES), [f for f in frames_of(small_run[0]) if not f[3].time_s > 8]


def analysed(used, frames):
    pipeline = Pipeline(used)
    snapshots = {frame[0]: pipeline.step(*frame) for frame in frames}
    pipeline.close()
    return snapshots, pipeline


@pytest.fixture(scope="module")
def whole(recorded):
    return analysed(*recorded)[0]


@pytest.mark.slow
def test_a_region_leaves_what_is_measured_in_it_as_it_is(recorded, whole):
    used, frames = recorded
    region = ("inside 60 20 420 20 420 340 60 340", "outside 60 20 130 20 130 90 60 90")
    part, _ = analysed(replace(used, dic=replace(used.dic, region=region)), frames[:45])
    grid = Pipeline(used).grid
    x, y = np.meshgrid(grid.x_px, grid.y_px)
    here = (x > 60) & (x < 420) & (y > 20) & (y < 340) & ~((x < 130) & (y < 90))
    compared = 0
    for n, snapshot in part.items():
        if snapshot.field is None:
            continue
        compared += 1
        assert (snapshot.field.status[~here] == Status.MASKED).all()
        for name in ("ux_px", "uy_px", "status"):
            found, expected = getattr(snapshot.field, name), getattr(whole[n].field, name)
            np.testing.assert_array_equal(found[here], expected[here])
    assert compared > 20
    assert np.isfinite(part[frames[44][0]].stick_radius[0])


def test_a_reference_whose_pattern_repeats_itself_is_noted_once(recorded):
    used, frames = recorded
    y, x = np.mgrid[: used.camera.height, : used.camera.width]
    grid = np.rint(110 + 30 * (np.cos(x * 0.7) + np.cos(y * 0.7))).astype(np.uint8)
    few = [f for f in frames if f[3].phase is not Phase.DRIVE] + frames[40:42]
    for picture, is_late, count in ((None, False, 0), (grid, False, 1), (grid, True, 1)):
        pictures = (f[2] if picture is None else picture for f in few)
        shown = [(f[0], f[1], one, f[3]) for f, one in zip(few, pictures, strict=True)]
        if is_late:  # the reference itself was not correlated: there was no time
            shown = [(*f, EFFORT if f[3].phase is Phase.DRIVE else Effort(0)) for f in shown]
        _, pipeline = analysed(used, shown)
        said = [note for note in pipeline.notes if "repeats itself every" in note]
        assert len(said) == count, pipeline.notes


@pytest.mark.slow
@pytest.mark.parametrize(
    "skipped",
    [
        {72},  # changes another field more than any other single frame does: 0.107
        {17, 25},
        {42, 63, 69},
        set(range(20, 80, 3)),
    ],
)
def test_skipped_frames_change_other_fields_by_a_small_part_of_their_uncertainty(
    recorded, whole, skipped
):
    used, frames = recorded
    assert all(f[3].phase is Phase.DRIVE for f in frames if f[0] in skipped)
    without, _ = analysed(used, [f for f in frames if f[0] not in skipped])
    for n, snapshot in without.items():
        if n < min(skipped):
            assert difference(whole[n], snapshot) == ""
            continue
        field, expected = snapshot.field, whole[n].field
        assert (field.status == expected.status).all()
        change = (field.ux_px - expected.ux_px) / expected.ux_std_px
        assert np.sqrt(np.nanmean(change**2)) < 0.12


@pytest.mark.slow
def test_skipped_frames_change_no_other_field_of_the_direct_search(recorded):
    _, frames = recorded
    direct = config.load(None, [*OVERRIDES, "dic.method=direct", "dic.search=16"])
    all_of_them, _ = analysed(direct, frames)
    without, _ = analysed(direct, [f for f in frames if f[3].phase is not Phase.DRIVE or f[0] % 3])
    assert len(without) < len(all_of_them) - 10
    assert [difference(all_of_them[n], s) for n, s in without.items()] == [""] * len(without)


def contact_numbers(pipeline):
    contact = pipeline.contact
    return (*contact.centre_px, *contact.shift_px, contact.apparent_radius_m, *contact.profile_grey)


def test_the_background_is_prepared_while_the_block_is_pressed_and_changes_nothing(
    recorded, monkeypatch
):
    """Once, not at the reference, and only that of the last background."""
    used, frames = recorded
    opened = []

    def opening(background):
        opened.append(background)
        return background_tracker(background)

    for module in (pipeline_module, registration):
        monkeypatch.setattr(module, "background_tracker", opening)
    phases = [frame[3].phase for frame in frames]
    first = phases.index(Phase.REFERENCE)
    whole, background = Pipeline(used), frames[phases.index(Phase.CONTACT) - 1]
    for frame in frames[:first]:
        whole.step(*frame)
    assert [id(one) for one in opened] == [id(background[2])]
    whole.step(*frames[first])
    assert len(opened) == 1
    direct, other = Pipeline(used), (frames[0][0], frames[0][1], np.roll(frames[0][2], 9, axis=1))
    for frame in (background, frames[first]):
        direct.step(*frame)
    late = Pipeline(used)  # of which a background was prepared that was replaced then
    contact = frames[first - 1]
    for frame in ((*other, frames[0][3]), contact, background, frames[first]):
        late.step(*frame)
    assert len(opened) == 4
    expected = contact_numbers(direct)
    assert contact_numbers(whole) == expected
    assert contact_numbers(late) == expected
    for pipeline in (whole, direct, late):
        pipeline.close()


def test_an_unused_background_lets_its_threads_go(recorded, monkeypatch):
    """Of a run that ends before its reference."""
    used, frames = recorded
    until = [frame[3].phase for frame in frames].index(Phase.REFERENCE)
    tracker, closed = background_tracker(frames[0][2]), []
    monkeypatch.setattr(tracker, "close", lambda: closed.append(True))
    monkeypatch.setattr(pipeline_module, "background_tracker", lambda background: tracker)
    pipeline = Pipeline(used)
    for frame in frames[:until]:
        pipeline.step(*frame)
    assert not closed
    pipeline.close()
    assert closed


def test_replaced_references_are_noted(recorded):
    _, frames = recorded
    updated = config.load(None, [*OVERRIDES, "dic.update=every", "dic.update_every=30"])
    snapshots, pipeline = analysed(updated, frames)
    fields = [s.field for s in snapshots.values() if s.field is not None]
    assert f"dic: the reference was replaced {len(fields) // 30} times" in pipeline.notes[-1]
    assert np.nanmedian(fields[-1].ux_std_px) > 1.2 * np.nanmedian(fields[20].ux_std_px)


def test_threads_change_nothing(recorded, whole):
    _, frames = recorded
    more = config.load(None, [*OVERRIDES, "dic.threads=3"])
    shared, _ = analysed(more, frames)
    assert all(difference(whole[n], s) == "" for n, s in shared.items())


def test_without_a_background_a_is_nan_and_a_note_says_so(recorded):
    used, frames = recorded
    snapshots, pipeline = analysed(used, [f for f in frames if f[3].phase is not Phase.BACKGROUND])
    assert math.isnan(pipeline.contact.apparent_radius_m)
    assert "no background image" in pipeline.notes[0]
    assert pipeline.contact.centre_px == ((480 - 1) / 2, (360 - 1) / 2)
    summary = conclude(used, list(snapshots.values()), pipeline.contact, pipeline.notes).summary
    assert math.isnan(summary.apparent_radius_m)
    assert pipeline.notes[0] in summary.notes
    assert summary.mu_s == pytest.approx(0.93, rel=0.02)


def test_a_gap_in_the_forces_costs_its_frames_and_no_result(recorded):
    """The reference, four frames of the drive and one that is shown lie in it."""
    used, frames = recorded
    rest = [f[0] for f in frames if f[3].phase is Phase.REFERENCE]
    driven = [f[0] for f in frames if f[3].phase is Phase.DRIVE]
    hidden = {rest[0], *driven[20:24], driven[-1]}
    unknown = {"normal_force_n": math.nan, "shear_force_n": math.nan}
    found = {}
    for name, gap in (("whole", set()), ("with a gap", hidden)):
        seen = [(*f[:3], replace(f[3], **unknown)) if f[0] in gap else f for f in frames]
        snapshots, pipeline = analysed(used, seen)
        shown = list(snapshots.values())
        found[name] = conclude(used, shown, pipeline.contact, pipeline.notes).summary
        instants = {shown[i].frame for i in numbered_instants(shown, None)}
        assert (driven[-1] in instants) == (not gap)
        assert pipeline.reference_frame == rest[bool(gap)]
    whole, parted = found["whole"], found["with a gap"]
    for name in ("normal_force_n", "hertz_radius_m", "mu_s", "mu_d"):
        assert getattr(parted, name) == pytest.approx(getattr(whole, name), rel=0.01), name
    assert parted.budget_quantities == whole.budget_quantities


def test_images_without_any_forces_have_their_fields(recorded):
    used, frames = recorded
    unknown = {"normal_force_n": math.nan, "shear_force_n": math.nan}
    early = [(*f[:3], replace(f[3], **unknown)) for f in frames[:45]]
    snapshots, pipeline = analysed(used, early)
    rest = [f[0] for f in frames if f[3].phase is Phase.REFERENCE]
    assert pipeline.reference_frame == rest[0]
    assert snapshots[frames[44][0]].field is not None


def test_a_run_that_never_slid_has_no_onset_and_says_why(recorded):
    used, frames = recorded
    early = [f for f in frames if not f[3].time_s > 4]
    snapshots, pipeline = analysed(used, early)
    summary = conclude(used, list(snapshots.values()), pipeline.contact, pipeline.notes).summary
    assert math.isnan(summary.onset_time_s)
    assert math.isnan(summary.mu_s)
    assert any("onset" in note for note in summary.notes)


def test_the_lens_displacement_counts_from_the_reference(recorded, whole):
    _, frames = recorded
    reference = next(now.shear_force_n for _, _, _, now in frames if now.phase is Phase.REFERENCE)
    for index, _, _, now in frames:
        if whole[index].motion is not None:
            assert whole[index].motion.lens_m == pytest.approx(
                0.68e-6 * (now.shear_force_n - reference), abs=1e-15
            )
        else:
            assert now.phase in (Phase.BACKGROUND, Phase.CONTACT)


def test_no_field_before_the_reference(recorded, whole):
    _, frames = recorded
    for index, _, _, now in frames:
        before = now.phase in (Phase.BACKGROUND, Phase.CONTACT)
        assert (whole[index].field is None) == before
    reference = next(i for i, _, _, now in frames if now.phase is Phase.REFERENCE)
    # the reference against itself
    assert np.abs(whole[reference].field.ux_px).max() < 1e-4
    assert (whole[reference].field.status == 0).all()


def test_a_drive_the_other_way_is_the_same_drive_turned_by_half_a_turn(recorded):
    _, frames = recorded
    traction = "stress.method=axisymmetric", "stress.field=true", "sample.lens_compliance=0.5"
    some = [f for f in frames if f[3].phase is not Phase.DRIVE or f[0] % 8 == 0]
    turned = [(n, sample, image[::-1, ::-1].copy(), now) for n, sample, image, now in some]
    there, _ = analysed(config.load(None, [*OVERRIDES, *traction]), some)
    back, _ = analysed(config.load(None, [*OVERRIDES, *traction, "run.travel=-40"]), turned)
    last = some[-1][0]
    a, b = there[last], back[last]
    assert b.motion.centre_ux_m == pytest.approx(a.motion.centre_ux_m, rel=2e-3)
    assert b.motion.lens_m == a.motion.lens_m > 0
    assert np.nanmean(b.field.ux_px) == pytest.approx(-np.nanmean(a.field.ux_px), rel=0.01)
    assert b.traction.stress_force_n == pytest.approx(a.traction.stress_force_n, rel=0.02)
    assert np.nanmean(b.stress_field_pa) == pytest.approx(np.nanmean(a.stress_field_pa), rel=0.05)
    np.testing.assert_allclose(b.rings.ux_m[:10], a.rings.ux_m[:10], rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "more", [(), ("camera.readout=0.03",), ("dic.update=every", "dic.update_every=7")]
)
def test_a_field_that_is_begun_ahead_has_the_same_bits(recorded, monkeypatch, more):
    used, frames = config.load(None, [*OVERRIDES, *more]), recorded[1][:45]
    expected, _ = analysed(used, frames)
    track, threads = Pipeline._track, []

    def noted(self, *arguments):
        threads.append(threading.current_thread().name)
        return track(self, *arguments)

    monkeypatch.setattr(Pipeline, "_track", noted)
    pipeline = Pipeline(used)
    for frame, after in pairwise(frames):
        snapshot = pipeline.step(*frame, following=(*after[:3], EFFORT))
        assert difference(expected[frame[0]], snapshot) == ""
    pipeline.close()
    assert threads.count(threading.current_thread().name) == 1
    assert len([name for name in threads if name.startswith("ahead")]) > 25


def test_what_was_begun_ahead_serves_its_own_frame_alone(recorded, whole):
    used, frames = recorded
    blind = np.zeros_like(frames[0][2])
    pipeline = Pipeline(used)
    for frame in frames[:30]:
        pipeline.step(*frame)
    pipeline.step(*frames[29], following=(*frames[30][:2], blind, EFFORT))
    for frame in frames[29:31]:
        found = pipeline.step(*frame).field
        np.testing.assert_array_equal(found.status, whole[frame[0]].field.status)
    pipeline.close()


def test_a_restart_waits_for_what_was_begun(recorded, monkeypatch):
    used, frames = recorded
    track, order = Pipeline._track, []

    def slowly(self, *arguments):
        time.sleep(0.1)
        order.append("field")
        return track(self, *arguments)

    pipeline = Pipeline(used)
    for frame in frames[:30]:
        pipeline.step(*frame)
    monkeypatch.setattr(Pipeline, "_track", slowly)
    close = pipeline._tracker.close
    pipeline._tracker.close = lambda: (order.append("closed"), close())
    pipeline.step(*frames[30], following=(*frames[31][:3], EFFORT))
    pipeline.restart()
    pipeline.close()
    assert order[:3] == ["field", "field", "closed"]
