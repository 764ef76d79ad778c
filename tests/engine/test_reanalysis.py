"""A session analysed again: the same settings give the same bits, others a second file that
tells where it comes from.
"""

import hashlib
import math
import shutil
import sys
from itertools import pairwise

import h5py
import numpy as np
import pytest
import whole_runs
from whole_runs import PATIENCE_S, done, ended, replayed

from app.evaluation.pipeline import Pipeline
from app.records.effort import Effort, Product
from app.records.record_types import REFERENCE
from app.replay import browser
from app.replay.reanalysis import Reanalysis
from app.replay.replay import Replay
from app.session import layout
from app.session.files import RESERVE_BYTES
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.writer import SessionWriter
from app.settings import config
from app.settings.config import ConfigError
from app.study.one import run_result
from app.system.errors import MissingFile, UserError
from slipscope import Session
from tests.same_results import difference

SMALL = (
    "camera.width=320",
    "camera.height=240",
    "camera.pixel=16",
    "run.normal_force=0.1",
    "run.travel=15",
    "dic.threads=1",
)
FAULTS = (
    'sim.faults=["lost-trigger 40 2", "lost-trigger 61 9", "daq-overflow 5500 60"]',
    "forces.on_overflow=continue",
)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("recorded") / "a.h5"
    whole_runs.recorded(path, *SMALL, *FAULTS)
    return path


@pytest.fixture(scope="module")
def reanalysed(recorded):
    """Another analysis of it."""
    outcome, path = analysed(recorded, "b.h5", "dic.box=28")
    assert outcome.state == "done"
    return path


@pytest.fixture
def other(reanalysed, session):
    """Another analysis, beside the session."""
    return shutil.copy(reanalysed, session.with_name("b.h5"))


@pytest.fixture
def session(recorded, tmp_path):
    return shutil.copy(recorded, tmp_path / "a.h5")


def analysed(session, name, *overrides, **options):
    """The outcome of another analysis, and its file."""
    output = session.with_name(name)
    return ended(Reanalysis(session, output, pace=None, overrides=overrides, **options)), output


@pytest.mark.slow
def test_the_same_settings_give_the_same_bits_and_the_session_is_not_touched(session):
    before = hashlib.sha256(session.read_bytes()).digest()
    outcome, path = analysed(session, "again.h5")
    assert outcome.state == "done"
    assert hashlib.sha256(session.read_bytes()).digest() == before
    with SessionReader(session) as old, SessionReader(path) as new:
        pairs = list(zip(old.snapshots(), new.snapshots(), strict=True))
        assert len(pairs) > 20
        assert [difference(a, b) for a, b in pairs] == [""] * len(pairs)
        for name in ("volts", "forces"):
            a, b = getattr(old.forces(), name), getattr(new.forces(), name)
            np.testing.assert_array_equal(a, b)
        assert new.gaps() == old.gaps() == [(5500, 60)]
        assert new.lost_frames() == old.lost_frames()
        assert [lost[0] for lost in new.lost_frames()] == [40, 41, 61, 62]  # to the last trigger
        np.testing.assert_array_equal(new.triggers()["index"], old.triggers()["index"])
        assert new.outcome.counts == old.outcome.counts == outcome.counts
        assert new.contact().centre_px == old.contact().centre_px
        kept = [event for event in new.events() if event.kind != "analysis"]
        assert sorted(kept, key=str) == sorted(old.events(), key=str)
    assert path.stat().st_size < session.stat().st_size / 3  # the images are not there twice


def test_other_settings_make_another_set_of_results_that_says_how_it_came_about(session):
    outcome, path = analysed(session, "box.h5", "dic.box=28", "sample.young_modulus=3")
    assert outcome.state == "done"
    with Session(session) as old, Session(path) as new:
        assert new.settings["dic"]["box"] == 28
        assert new.settings["sample"]["young_modulus"] == 3
        assert new.settings["run"] == old.settings["run"]
        assert new.versions["slipscope"]
        assert new.versions["computer"]
        assert new.source.session == "a.h5"
        assert old.source is None
        assert old.analyses == [path]
        assert len(new.results) == len(old.results)
        assert not np.array_equal(new.fields[-1].ux_m, old.fields[-1].ux_m, equal_nan=True)
        assert [event.text for event in new.events if event.kind == "analysis"] == [
            "a.h5 analysed again, with dic.box=28, sample.young_modulus=3"
        ]
        np.testing.assert_array_equal(new.frames[50], old.frames[50])
        with pytest.raises(UserError, match="frame 40 was lost"):
            new.frames[40]
    comparison = replayed(path).comparison()
    assert comparison.all_identical
    assert comparison.frames == outcome.counts.frames_analysed


RETIRED = 'method = "icgn"\norder = 2\ninterpolant = "bspline3"\nprecision = "single"'


def test_a_session_correlated_as_no_version_does_now_shows_its_fields(session):
    """Made by an earlier version: order 2 of each box by itself, with a cubic spline."""
    with h5py.File(session, "r+") as file:
        toml = file["/entry/settings/toml"]
        text = toml.asstr()[()]
        assert text.count('method = "shared"') == text.count("order = 1\n") == 1
        toml[()] = text.replace("order = 1\n", "").replace('method = "shared"', RETIRED)
    sentence = (
        "dic: interpolant bspline3, order 2 in icgn asked, which only earlier versions did; set"
        " dic.interpolant=matched, dic.order=1, or a dic.preset, to correlate now"
    )
    with SessionReader(session) as held:
        recorded = list(held.snapshots())
    replay = Replay(session, pace=None)
    assert replay.config.dic.noise_box_px < replay.config.dic.box  # still that of a quadratic
    outcome = ended(replay)
    assert (outcome.state, outcome.reason) == ("failed", sentence)
    assert replay.is_refused
    for one in (recorded[0], recorded[-1]):
        replay.show(one.frame)
        assert difference(replay.browsed(), one) == ""
        assert replay.latest_image() is not None
    unmeasured = next(n for n in range(5, 99) if not replay.timeline.has_results(n))
    with pytest.raises(UserError, match="dic: interpolant bspline3"):
        replay.analyse(unmeasured)
    outcome, path = analysed(session, "as_it_was.h5")
    assert (outcome.state, outcome.reason) == ("failed", sentence)
    assert not path.exists()
    one_of_two = analysed(session, "half.h5", "dic.order=1")[0]
    assert one_of_two.reason.startswith("dic: interpolant bspline3 asked")
    for name, *now in (
        ("each.h5", "dic.interpolant=matched", "dic.order=1", "dic.step=40"),
        ("preset.h5", "dic.preset=fast", "dic.step=40"),
    ):
        outcome, path = analysed(session, name, *now)
        assert outcome.state == "done"
        with SessionReader(path) as new:
            assert "interpolant" not in new.header.config_toml


def test_what_the_operator_said_can_be_put_right(session):
    _, path = analysed(session, "named.h5", "about.sample=PDMS-7", "about.note=dusty, far left")
    with h5py.File(path) as file:
        said = [file[f"entry/{name}"][()] for name in ("sample/name", "notes/description")]
    assert said == [b"PDMS-7", b"dusty, far left"]
    with SessionReader(session) as old, SessionReader(path) as new:
        assert (old.header.sample, new.header.sample, new.header.operator) == ("", "PDMS-7", "")


def test_forces_follow_the_constants_of_the_sensors(session):
    with SessionReader(session) as old:
        forces = config.from_record(old.header.config_toml, "").forces
        before = old.forces().forces
    twice = [
        f"forces.stiffness_{name}={2 * getattr(forces, f'stiffness_{name}')}"
        for name in ("normal", "shear")
    ]
    _, path = analysed(session, "stiff.h5", *twice)
    with SessionReader(path) as new:
        np.testing.assert_allclose(new.forces().forces, 2 * before, rtol=1e-12)


@pytest.mark.slow
def test_an_analysis_of_an_analysis_refers_to_the_images_too(other):
    outcome, second = analysed(other, "c.h5", "dic.step=12")
    assert outcome.state == "done"
    with SessionReader(second) as reader:
        settings = config.from_record(reader.header.config_toml, "")
        assert (settings.dic.box, settings.dic.step) == (28, 12)
        assert reader.header.source.session == "a.h5"
    assert replayed(second).comparison().all_identical


def test_frames_that_were_not_analysed_in_the_run_are_now(session, tmp_path):
    with h5py.File(session, "r+") as file:
        for name in ("results", "rings", "stress"):
            for column in layout.columns_in(f"/entry/{name}"):
                file[column.path].resize(10, axis=0)
    outcome, path = analysed(session, "all.h5")
    with SessionReader(session) as old, SessionReader(path) as new:
        assert len(old.analysed_frames()) == 10
        assert new.analysed_frames() == [
            int(n) for n in old.triggers()["index"][old.triggers()["received"]]
        ]
    assert outcome.counts.frames_skipped == 0


@pytest.mark.parametrize(
    "setting",
    [
        "run.travel=3",
        "camera.divisor=250",
        "forces.sample_rate=2000",
        "sim.seed=7",
        "limits.travel=1000",
    ],
)
def test_what_was_measured_can_not_be_changed(session, setting):
    with pytest.raises(
        ConfigError,
        match=f"--set: {setting.split('=')[0]} is .* in the session, as it was measured",
    ):
        analysed(session, "b.h5", setting)
    assert not session.with_name("b.h5").exists()


def test_the_session_itself_is_never_the_output(session, other):
    for name in ("a.h5", f"../{session.parent.name}/a.h5"):
        with pytest.raises(UserError, match="this is the session itself"):
            Reanalysis(other, session.with_name("x").parent / name, pace=None, overwrite=True)
    with pytest.raises(UserError, match="this is the session itself"):
        Reanalysis(other, other, pace=None, overwrite=True)


def test_it_lies_beside_its_session(session, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(UserError, match="lies beside its session"):
        Reanalysis(session, tmp_path / "elsewhere/b.h5", pace=None)


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name")
@pytest.mark.parametrize("name", ["a\ab.h5", "\udcff.h5"])
def test_a_session_whose_name_no_file_can_hold_is_refused_at_once(session, name):
    """Its analysis would not find its images again, which was said after all was computed."""
    renamed = session.rename(session.with_name(name))
    with pytest.raises(UserError, match="rename the session"):
        Reanalysis(renamed, session.with_name("b.h5"), pace=None)


def test_without_its_session_the_numbers_can_be_read_and_the_images_can_not(
    session, other, tmp_path
):
    session.rename(tmp_path / "moved.h5")
    with Session(other) as analysis:
        assert len(analysis.results) > 20
        assert analysis.fields[-1].ux_m.shape
        with pytest.raises(
            UserError, match=r"b\.h5: its images are in a\.h5, which does not lie beside it"
        ):
            analysis.frames[0]
    for use in (lambda: Replay(other, pace=None), lambda: verify(other)):
        with pytest.raises(UserError, match="does not lie beside it") as refused:
            use()
        assert refused.type is MissingFile  # and not the error for altered data


def test_another_session_of_that_name_is_not_taken_for_it(session, other):
    with h5py.File(session, "r+") as file:
        file["entry/start_time"][()] = "2001-01-01T00:00:00+00:00"
    with pytest.raises(UserError, match=r"a\.h5 is not the session that was analysed"):
        Replay(other, pace=None)


def test_an_image_that_has_changed_is_not_taken_for_the_one_that_was_analysed(session, other):
    with h5py.File(session, "r+") as file:
        file["entry/instrument/camera/data"][7, 100, 100] += 1
    with SessionReader(other) as reader:
        reader.frame(6)
        with pytest.raises(
            UserError, match="the image of trigger 7 is not the one that was analysed"
        ):
            reader.frame(7)


def test_an_image_that_was_altered_is_not_analysed_further(session):
    """A new analysis would give it the checksum of what it is now."""
    with h5py.File(session, "r+") as file:
        file["entry/instrument/camera/data"][7, 100, 100] += 1
    outcome, output = analysed(session, "b.h5", "dic.box=28")
    assert (outcome.state, output.exists()) == ("failed", False)
    assert outcome.reason == (
        f"{session}: the image of trigger 7 is not the one that was recorded; `slipscope repair`"
        " makes a session of the others"
    )


def test_frames_before_one_that_was_altered_are_analysed(session):
    """That it is read ahead changes nothing of them."""
    with h5py.File(session, "r+") as file:
        file["entry/instrument/camera/data"][7, 100, 100] += 1
    analysis = Reanalysis(session, session.with_name("b.h5"), pace=None)
    assert ended(analysis).state == "failed"
    assert [one.frame for one in analysis.look(0).snapshots] == list(range(7))


def test_the_next_frame_is_begun_where_it_has_no_time_of_its_own(session, monkeypatch):
    """In replays as fast as the machine, and in analyses of sessions, across lost frames."""
    step, begun = Pipeline.step, []

    def stepped(pipeline, index, sample, image, now, effort, following=None):
        if following is not None:
            products = following[3].products == effort.products
            begun.append((index, *following[:2], following[2].sum(), products))
        return step(pipeline, index, sample, image, now, effort, following)

    monkeypatch.setattr(Pipeline, "step", stepped)
    with SessionReader(session) as reader:
        frames = [(n, sample, image.sum(), True) for n, sample, image in reader.frames()]
    expected = [(before[0], *after) for before, after in pairwise(frames)]
    assert analysed(session, "b.h5")[0].state == "done"
    assert begun == expected
    begun.clear()
    assert replayed(session).comparison().all_identical
    assert begun == expected
    begun.clear()
    assert len(run_result(session, threads=1).frames) == len(frames)
    assert [one[:4] for one in begun] == [one[:4] for one in expected if one[1] == one[0] + 1]
    begun.clear()
    replay = Replay(session, pace=None)
    efforts = {n: Effort(int(Product.CONTACT), took_s=n) for n, *_ in frames[::2]}
    monkeypatch.setattr(replay, "_efforts", efforts)
    done(replay)
    assert [one[-1] for one in begun] == [False] * (len(frames) - 1)
    begun.clear()
    done(Replay(session, pace=1e6))
    assert begun == []


@pytest.mark.parametrize("name", ["../a.h5", "/etc/passwd", "", "..", "b.h5"])
def test_a_foreign_analysis_leads_to_no_file_elsewhere(session, other, name):
    (session.parent / "in").mkdir()
    other = other.rename(session.parent / "in" / "b.h5")
    with h5py.File(other, "r+") as file:
        file["entry/source/session"][()] = name
    with (
        SessionReader(other) as reader,
        pytest.raises(UserError, match=r"does not lie beside it|is damaged|is not the session"),
    ):
        reader.frame(0)


def test_one_that_is_stopped_holds_what_was_done_until_then(session):
    analysis = Reanalysis(session, session.with_name("b.h5"), pace=None)
    analysis.playback.pause()
    for _ in range(43):
        analysis.playback.step()
    analysis.start()
    while len(analysis.look(0).snapshots) < 43:
        assert analysis.wait(0.01) is None
    assert not analysis.can_browse
    analysis.request_stop("enough")
    outcome = analysis.wait(PATIENCE_S)
    told = "enough; 43 frames were analysed of 59, and the numbers are of these alone"
    assert (outcome.state, outcome.reason) == ("done", told)
    assert analysis.can_browse
    with SessionReader(analysis.output) as reader:
        assert reader.analysed_frames() == [n for n in range(45) if n not in (40, 41)]
        assert reader.outcome.counts == outcome.counts
        assert len(reader.triggers()) == outcome.counts.triggers == 45
        assert math.isnan(reader.outcome.summary.mu_d)
    for wanted, shown in ((30, 30), (44, 44), (58, 44)):
        analysis.show(wanted)
        assert (analysis.frame, analysis.browsed().frame) == (shown, shown)
    assert [analysis.has_results(frame) for frame in (44, 45)] == [True, False]
    analysis.browser.close()


def test_one_that_is_stopped_before_its_first_frame_shows_none(session):
    analysis = Reanalysis(session, session.with_name("b.h5"), pace=None)
    analysis.playback.pause()
    analysis.start()
    analysis.request_stop("enough")
    assert analysis.wait(PATIENCE_S).state == "done"
    assert not analysis.can_browse


def test_a_full_disk_fails_by_name_and_leaves_nothing(session, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(SessionWriter, "_append_snapshot", full)
    outcome, path = analysed(session, "b.h5")
    assert outcome.state == "failed"
    assert "No space left on device" in outcome.reason
    assert sorted(p.name for p in session.parent.iterdir()) == ["a.h5"]
    path.write_bytes(b"earlier")
    outcome, _ = analysed(session, "b.h5", overwrite=True)
    assert outcome.state == "failed"
    assert {p.name: p.read_bytes() == b"earlier" for p in session.parent.iterdir()} == {
        "a.h5": False,
        "b.h5": True,
    }


def test_the_last_of_the_disk_is_left_alone(session, monkeypatch):
    free = iter([1 << 40] * 2 + [RESERVE_BYTES - 1] * 10**6)
    usage = shutil.disk_usage(session.parent)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=next(free)))
    outcome, _ = analysed(session, "b.h5")
    assert outcome.state == "failed"
    assert "the disk is full" in outcome.reason
    assert sorted(p.name for p in session.parent.iterdir()) == ["a.h5"]


def test_a_frame_whose_reference_has_no_results_is_not_measured_and_that_is_a_sentence(
    recorded, monkeypatch
):
    rows_of = browser._rows_of
    with SessionReader(recorded) as reader:
        reference = next(e.number for e in reader.events() if e.kind == REFERENCE)
        last = reader.analysed_frames()[-1]
        monkeypatch.setattr(
            browser,
            "_rows_of",
            lambda session: {f: row for f, row in rows_of(session).items() if f != reference},
        )
        with pytest.raises(UserError, match=f"frame {reference}, the reference, has no row"):
            browser.analysed_frame(reader, last)
