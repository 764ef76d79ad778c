"""A map of the pixels, calibrated: used by a run, kept by its session, used again by all that
evaluates the session.
"""

import json
import zipfile
from datetime import UTC, datetime

import h5py
import msgspec
import numpy as np
import pytest
from short_run import SMALL
from whole_runs import done, ended, recorded, replayed

from app.bench_checks.bench_check import check
from app.evaluation.setup import pattern_of
from app.replay.browser import analysed_frame
from app.replay.reanalysis import Reanalysis
from app.replay.replay import Replay
from app.runs import live
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.receipt import verify
from app.session.repair import repair
from app.settings import certificates, config
from app.settings.certificates import CalibrationCertificate
from app.system.errors import ConfigError, UserError
from drivers.sim.images import Renderer

UNEQUAL = (*SMALL, "run.travel=12", "sim.unequal_pixels=4", "sim.dust=20")


def certify(path, **data):
    """A certificate of the pattern, with these arrays."""
    statement = CalibrationCertificate(
        what="pattern", title="pixels", made=datetime.now(UTC).isoformat(), valid_days=30,
        values=(), settings={},
    )  # fmt: skip
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(certificates.STATEMENT, msgspec.json.encode(statement))
        with archive.open(certificates.DATA, "w") as held:
            np.savez(held, **data)
    return path


def true_gain(settings):
    """What the simulated camera knows and no picture says."""
    return Renderer(live.scenario(config.load(None, settings)))._gain


def naming(*paths):
    return f"calibration.certificates={json.dumps([str(path) for path in paths])}"


def rings_of(path):
    with SessionReader(path) as session:
        return [s.rings.ux_m for s in session.snapshots() if s.rings is not None]


def field_of(path, number):
    with SessionReader(path) as session:
        return next(s.field.ux_px for s in session.snapshots() if s.frame == number)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of even pixels, of unequal ones, and of these with their map, whose file is gone."""
    folder = tmp_path_factory.mktemp("pattern")
    gain = true_gain(UNEQUAL)
    certify(folder / "pattern.zip", gain=gain, dark=np.zeros_like(gain))
    recorded(folder / "even.h5", *UNEQUAL, "sim.unequal_pixels=0", "sim.dust=0")
    recorded(folder / "raw.h5", *UNEQUAL)
    recorded(folder / "mapped.h5", *UNEQUAL, naming(folder / "pattern.zip"))
    (folder / "pattern.zip").rename(folder / "gone.zip")
    return folder


def off_m(folder, name):
    """How far the mean displacements of rings are from those of even pixels, rms over frames."""
    pairs = zip(rings_of(folder / name), rings_of(folder / "even.h5"), strict=True)
    return np.sqrt(np.mean([np.nanmean((a[: len(b)] - b[: len(a)]) ** 2) for a, b in pairs]))


@pytest.mark.slow
def test_unequal_pixels_pull_displacements_and_their_map_undoes_it(folder):
    assert off_m(folder, "mapped.h5") < 0.25 * off_m(folder, "raw.h5")
    with SessionReader(folder / "mapped.h5") as session:
        notes = [note for note in session.outcome.summary.notes if note.startswith("picture: ")]
    assert notes == ["picture: dark level and gain of the pixels are undone in every image"]


def test_a_session_keeps_the_map_and_replays_to_the_bit_without_its_certificate(folder):
    with SessionReader(folder / "mapped.h5") as session:
        np.testing.assert_array_equal(session.pattern().gain, true_gain(UNEQUAL))
        assert not session.pattern().dark.any()
        raw = session.frame(0)[2]
    with SessionReader(folder / "raw.h5") as session:
        np.testing.assert_array_equal(session.frame(0)[2], raw)  # pictures are kept as they came
        assert session.pattern() is None
    comparison = replayed(folder / "mapped.h5").comparison()
    assert comparison.all_identical, comparison.first_difference


def test_a_further_analysis_uses_and_keeps_the_map_unless_another_is_named(folder):
    for name, settings, is_kept in (("again.h5", (), True), ("without.h5", (naming(),), False)):
        named = {"overrides": settings, "overwrite": True}
        done(Reanalysis(folder / "mapped.h5", folder / name, pace=None, **named))
        with SessionReader(folder / name) as session:
            assert (session.pattern() is not None) == is_kept
    for a, b in (("again.h5", "mapped.h5"), ("without.h5", "raw.h5")):
        pairs = zip(rings_of(folder / a), rings_of(folder / b), strict=True)
        assert all(np.nanmax(np.abs(x - y)) < 2e-9 for x, y in pairs)
    named = Replay(folder / "raw.h5", pace=None, overrides=(naming(folder / "gone.zip"),))
    np.testing.assert_array_equal(named._analysis.pipeline.pattern.gain, true_gain(UNEQUAL))


def test_a_frame_that_is_analysed_later_is_seen_through_the_map(folder):
    with SessionReader(folder / "mapped.h5") as session:
        number = max(session.analysed_frames())
        again = analysed_frame(session, number).field.ux_px
    mapped, raw = (field_of(folder / name, number) for name in ("mapped.h5", "raw.h5"))
    assert np.nanmean(np.abs(again - mapped)) < 0.3 * np.nanmean(np.abs(again - raw))


def test_a_session_that_was_cut_short_is_repaired_with_its_map(folder, tmp_path):
    path = tmp_path / "cut.h5"
    settings = (*UNEQUAL, "run.travel=1", naming(folder / "gone.zip"))

    def cut(session):
        raise UserError("the computer lost its power")

    run = live.make_run(config.load(None, [*settings]), path, pace=None, make=cut)
    ended(run)
    assert journal_of(path).exists()
    repair(path, tmp_path / "whole.h5")
    with SessionReader(tmp_path / "whole.h5") as session:
        np.testing.assert_array_equal(session.pattern().gain, true_gain(UNEQUAL))
    with h5py.File(tmp_path / "whole.h5", "r+") as file:
        file["entry/instrument/camera/data"][3, 2, 1] ^= 1  # which its checksum tells
    repair(tmp_path / "whole.h5", tmp_path / "copy.h5")
    with SessionReader(tmp_path / "copy.h5") as session:
        np.testing.assert_array_equal(session.pattern().gain, true_gain(UNEQUAL))


def test_a_damaged_map_is_told_of(folder, tmp_path):
    path = tmp_path / "damaged.h5"
    path.write_bytes((folder / "mapped.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        del file["entry/pattern/gain"]
        file["entry/pattern/gain"] = np.ones((3, 4), np.float32)
    with pytest.raises(UserError, match=r"damaged at /entry/pattern/gain: its shape is \(3, 4\)"):
        Replay(path, pace=None)
    with pytest.raises(UserError, match="damaged at /entry/pattern/gain"):
        verify(path)


SHAPE = (360, 480)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"gain": np.ones((360, 481)), "dark": np.zeros((360, 481))}, "481 x 360 px and .* 480 x"),
        ({"gain": np.ones(SHAPE)}, "it holds no map of the pixels"),
        ({"gain": np.zeros(SHAPE), "dark": np.zeros(SHAPE)}, "no pixel shows anything"),
        ({"gain": np.full(SHAPE, "1"), "dark": np.full(SHAPE, "x")}, "no map of the pixels"),
    ],
)
def test_a_map_that_cannot_be_used_is_refused_before_anything_moves(data, words, tmp_path):
    path = certify(tmp_path / "pattern.zip", **data)
    with pytest.raises(ConfigError, match=words):
        live.make_run(config.load(None, [*SMALL, naming(path)]), tmp_path / "a.h5", pace=None)
    assert not list(tmp_path.glob("a.h5*"))


def test_two_maps_are_refused(tmp_path):
    held = {"gain": np.ones(SHAPE), "dark": np.zeros(SHAPE)}
    paths = [certify(tmp_path / f"{name}.zip", **held) for name in "ab"]
    with pytest.raises(ConfigError, match=r"a\.zip and .*b\.zip both say"):
        pattern_of(config.load(None, [*SMALL, naming(*paths)]))


def test_pixels_that_no_light_tells_apart_show_nothing(tmp_path):
    gain = np.ones(SHAPE)
    gain[3, 4], gain[5, 6], gain[7, 8] = 0, np.inf, -1
    path = certify(tmp_path / "pattern.zip", gain=gain, dark=np.full(SHAPE, 2.0))
    found = pattern_of(config.load(None, [*SMALL, naming(path)]))
    assert sorted(zip(*np.nonzero(np.isnan(found.gain)), strict=True)) == [(3, 4), (5, 6), (7, 8)]
    assert found.gain.dtype == found.dark.dtype == np.float32


def test_a_check_of_the_bench_finds_a_map_of_another_size(tmp_path):
    path = certify(tmp_path / "a.zip", gain=np.ones((360, 481)), dark=np.zeros((360, 481)))
    settings = config.load(None, [*SMALL, "sim.press_time=600", naming(path)])
    bench = live.make_bench(settings, None)
    found = {f.label: f for f in check(settings, lambda: bench, home=False, move_um=0.0)}
    assert not found["calibration pattern"].is_fine
    assert "repeat `slipscope calibrate pattern`" in found["calibration pattern"].value
