"""Unequal pixels: told by the background and the reference, and undone in what follows from u_x;
a picture without them is left as it is.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from short_run import SMALL
from whole_runs import frames_of, recorded

from analysis.contact.apparent import background_difference
from analysis.contact.registration import rigid_shift
from analysis.dic import Correlation, open_tracker
from analysis.dic.fixed_pattern import Pull, fixed_pattern, pull_of
from app.evaluation.pipeline import Pipeline
from app.settings import config

SHAPE, SHIFT = (480, 640), (3.3, -1.7)
GRAIN_PX, LEVEL, CONTRAST, NOISE = 1.3, 100.0, 20.0, 2.0


def picture(shift: tuple[float, float], gain: np.ndarray, number: int) -> np.ndarray:
    """Band-limited speckle, moved exactly, under a gain of each pixel."""
    rng = np.random.default_rng(5)
    ky, kx = np.fft.fftfreq(SHAPE[0])[:, None], np.fft.rfftfreq(SHAPE[1])
    spectrum = np.fft.rfft2(rng.normal(size=SHAPE))
    spectrum *= np.exp(-2 * (np.pi * GRAIN_PX) ** 2 * (kx**2 + ky**2))
    scale = np.fft.irfft2(spectrum, SHAPE).std()
    moved = np.fft.irfft2(spectrum * np.exp(-2j * np.pi * (kx * shift[0] + ky * shift[1])), SHAPE)
    grey = (LEVEL + CONTRAST * moved / scale) * gain
    noise = np.random.default_rng([6, number]).normal(0, NOISE, SHAPE)
    return np.clip(np.round(grey + noise), 0, 255).astype(np.uint8)


def gain_of(share: float) -> np.ndarray:
    return 1 + share * np.random.default_rng(1).standard_normal(SHAPE)


def pictures(gain: np.ndarray):
    background, reference = picture((0, 0), gain, 0), picture(SHIFT, gain, 1)
    shift = rigid_shift(background, reference)
    difference, known = background_difference(background, reference, shift)
    return reference, difference, fixed_pattern(background, difference, known, shift)


@pytest.mark.parametrize("share", [0.01, 0.03])
def test_how_unequal_the_pixels_are_is_found(share: float) -> None:
    *_, found = pictures(gain_of(share))
    assert found is not None
    assert found.is_certain
    assert abs(found.share - share) < 3 * found.share_sd


def test_a_block_that_has_not_moved_tells_no_pattern() -> None:
    gain = gain_of(0.03)
    background, still = picture((0, 0), gain, 0), picture((0.3, 0), gain, 1)
    difference, known = background_difference(background, still, (0.3, 0.0))
    assert fixed_pattern(background, difference, known, (0.3, 0.0)) is None


def test_equal_pixels_have_no_pattern() -> None:
    *_, found = pictures(np.ones(SHAPE))
    assert found is not None
    assert not found.is_certain


def test_the_pull_towards_zero_is_undone() -> None:
    gain = gain_of(0.03)
    reference, difference, found = pictures(gain)
    assert found is not None
    pull = pull_of(found, Correlation(), reference, difference)
    tracker = open_tracker(Correlation(), reference)
    for n, way in enumerate((0.2, 0.5, 0.7, 1.0, 1.3)):
        field = tracker.track(picture((SHIFT[0] + way, SHIFT[1]), gain, 2 + n))
        good = field.status == 0
        x, y = field.ux_px[good], field.uy_px[good]
        before, after = x.mean() - way, pull.corrected(x, y)[0].mean() - way
        assert before < -0.015
        assert abs(after) < 0.25 * abs(before), way
    tracker.close()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ((), ()),
        (("sim.unequal_pixels=3",), ("% of its grey levels", "fixed_pattern=undo")),
        (("sim.unequal_pixels=3", "camera.fixed_pattern=undo"), ("are corrected",)),
        (("sim.unequal_pixels=3", "camera.fixed_pattern=ignore"), ()),
        (("sim.dust=60",), (" marks (dust) stay", "is looked for", "fixed_pattern=undo")),
        (("sim.dust=60", "camera.fixed_pattern=undo"), (" marks (dust) stay", "every image")),
    ],
)
def test_a_run_tells_a_pattern_and_undoes_it_where_it_is_asked_to(
    settings: tuple[str, ...], words: tuple[str, ...], tmp_path: Path
) -> None:
    size = ("camera.width=640", "camera.height=480", "run.travel=10")
    outcome = recorded(tmp_path / "a.h5", *SMALL, *size, *settings)
    assert outcome.summary is not None
    told = [note for note in outcome.summary.notes if note.startswith("picture: ")]
    assert len(told) == bool(words)
    assert all(word in told[0] for word in words)


@pytest.mark.slow
def test_a_pattern_is_undone_in_the_frames_of_the_run_itself(tmp_path: Path) -> None:
    """The way of the contact's centre is nearer to that of a camera with equal pixels."""
    size = ("camera.width=640", "camera.height=480", "run.travel=40")
    way_m = {}
    for share in (0, 3):
        settings = (*SMALL, *size, f"sim.unequal_pixels={share}")
        recorded(tmp_path / f"{share}.h5", *settings)
        used = config.load(None, settings)
        for asked in ("tell", "undo")[: 1 + share]:
            asking = replace(used, camera=replace(used.camera, fixed_pattern=asked))
            with closing(Pipeline(asking)) as pipeline:
                *_, last = (pipeline.step(*f) for f in frames_of(tmp_path / f"{share}.h5"))
            way_m[share, asked] = last.motion.centre_ux_m
    equal, found, undone = way_m.values()
    assert abs(undone - equal) < 0.5 * abs(found - equal)


def test_displacements_get_back_what_is_missing_of_them():
    """In their own direction, by what is missing of their length."""
    pull = Pull(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.1, 0.0]), 0.1)
    ux, uy = pull.corrected(np.array([0.6, -1.0, 0.0, 3.0]), np.array([0.8, 0.0, 0.0, 4.0]))
    np.testing.assert_allclose(ux, [0.66, -1.1, 0.0, 3.0])
    np.testing.assert_allclose(uy, [0.88, 0.0, 0.0, 4.0])
