"""What people pass to the functions on plain arrays: the right number, or one sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

import analysis
from analysis.arrays import floats, in_step

N = 24
X = np.linspace(0.1, 3.0, N)
AXIS = np.linspace(-4e-3, 4e-3, 41)
RADII = np.hypot(*np.meshgrid(AXIS, AXIS))
BLOCK = {"E": 3.4e6, "nu": 0.5}
SHEARED = {"Q": 0.3, "mu": 0.9, "P": 0.5, "a": 2.4e-3}
PROFILE = analysis.cattaneo_mindlin.traction(X * 1e-3, **SHEARED)
FIELD = 20e-6 - analysis.cattaneo_mindlin.field(AXIS, AXIS, **BLOCK, **SHEARED)[1]
JKR = analysis.jkr.contact_radius(X, w=0.05, R=0.13, **BLOCK)
SLIP = X[:, None] * np.ones(3) * 1e-6

# a function, and the arguments that belong together
TOGETHER: list[tuple[Callable[..., Any], list[Any]]] = [
    (analysis.fit_ageing, [X, 0.02 * np.log1p(X), np.full(N, 1e-3)]),
    (
        lambda r, sigma, sd: analysis.stress_peak(r, sigma, sd, reach=3e-4),
        [X * 1e-3, PROFILE, 1e2 + 0 * X],
    ),
    (
        lambda r, u, sd: analysis.fit_stick_radius(r, u, sd, 2.4e-3),
        [X * 1e-3, 2e-5 - PROFILE * 1e-10, 1e-8 + 0 * X],
    ),
    (lambda s, sd, Q: analysis.balance_modulus(s, sd, Q, 3.4e6), [X, 1e-3 + 0 * X, 1.1 * X]),
    (analysis.sliding_onset, [X, np.maximum(X - 1, 0), np.minimum(X, 1), 0.5 + 0 * X]),
    (analysis.loop_work, [X, X**2]),
    (lambda x, Q: analysis.masing_deviation(x, Q, 2 * X, 2 * X**0.5), [X, X**0.5]),
    (lambda x, Q: analysis.masing_deviation(X, X, x, Q), [2 * X, 2 * X]),
    (lambda t, s: analysis.precursor_slip(t, s, 2.0), [X, SLIP]),
    (lambda s, sigma: analysis.local_work([1e-4, 3e-4, 5e-4], s, sigma), [SLIP, 1e10 * SLIP]),
    (
        lambda s, p, sd: analysis.interface_stiffness(s, p, sd, soft=1e-6)[0],
        [SLIP, 3e10 * SLIP, 1e2 + 0 * SLIP],
    ),
    (lambda r, u: analysis.ring_means(r, u, 5e-4, 3e-3).mean, [RADII, FIELD]),
    (
        lambda r, theta, u: analysis.central_value(r, theta, u, 2e-3),
        [RADII, np.arctan2(*np.meshgrid(AXIS, AXIS)), FIELD],
    ),
    (lambda a, P: analysis.adhesion_test(a, P, 0.13, 0.5, a_sd=1e-6, P_sd=1e-4), [JKR, X]),
    (
        lambda P, a: analysis.radius_law(P, a, 0.13, 6e-7, 0.5, P_sd=1e-3, a_sd=1e-5),
        [X, JKR],
    ),
    (
        lambda t, x: analysis.stage_motion.steady_velocity(t, x, 5e-6),
        [np.arange(99.0), 5e-6 * np.arange(99.0)],
    ),
    (
        lambda u, sd: analysis.as_seen(u, sd, 1e-4)[0],
        [np.full((6, 7), 1e-4), np.full((6, 7), 1e-8)],
    ),
    (
        lambda u, v: analysis.drive_direction(u, v, RADII > 2e-3, least=1e-9),
        [FIELD, 1e-3 * FIELD],
    ),
]


@pytest.mark.parametrize(("function", "arguments"), TOGETHER)
@pytest.mark.filterwarnings("error")
def test_what_belongs_together_has_one_shape(
    function: Callable[..., Any], arguments: list[Any]
) -> None:
    function(*arguments)
    for place, argument in enumerate(arguments):
        for odd in (argument[:-1], argument[:1], argument[:0], argument[None]):
            with pytest.raises(ValueError, match=r"^[a-zA-Z' -]+: .*; (found|give) .*"):
                function(*arguments[:place], odd, *arguments[place + 1 :])
        for odd in (argument + 1j, ["one"] * N, None):
            with pytest.raises(TypeError, match="real numbers are needed"):
                function(*arguments[:place], odd, *arguments[place + 1 :])


@pytest.mark.parametrize(("function", "arguments"), TOGETHER)
@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e3])
@pytest.mark.filterwarnings("error")
def test_what_is_masked_or_infinite_was_not_measured(
    function: Callable[..., Any], arguments: list[Any], value: float
) -> None:
    for place, argument in enumerate(arguments):
        unknown, given = argument.copy(), argument.copy()
        unknown.flat[N // 2], given.flat[N // 2] = np.nan, value
        masked = np.ma.masked_array(given, mask=np.isnan(unknown))
        expected = function(*arguments[:place], unknown, *arguments[place + 1 :])
        assert str(function(*arguments[:place], masked, *arguments[place + 1 :])) == str(expected)
        if np.isinf(value):
            found = function(*arguments[:place], given, *arguments[place + 1 :])
            assert str(found) == str(expected)


@pytest.mark.filterwarnings("error")
def test_masked_points_of_fields_are_not_measured() -> None:
    hidden = RADII < 4e-4
    unknown, spoiled = (np.where(hidden, value, FIELD) for value in (np.nan, 1e-3))
    masked = np.ma.masked_array(spoiled, mask=hidden)
    of = {"P": 0.5, "R": 0.13, **BLOCK}
    known = analysis.invert(AXIS, AXIS, unknown, **of)
    assert analysis.invert(AXIS, AXIS, masked, **of).Q == known.Q == pytest.approx(0.3, rel=0.05)
    assert analysis.invert(AXIS, AXIS, np.where(hidden, np.inf, FIELD), **of).Q == known.Q
    with pytest.raises(ValueError, match="inversion: arrays of one shape are needed; found ux"):
        analysis.invert(AXIS, AXIS, FIELD, np.ones(4), **of)
    with pytest.raises(ValueError, match="all of them finite"):
        analysis.invert(np.where(AXIS > 3e-3, np.inf, AXIS), AXIS, FIELD, **of)


def test_masks_of_several_fields_are_kept() -> None:
    fields: Any = [np.ma.masked_greater([1, 9], 5), np.ma.masked_array([3.0, 4.0])]
    expected = np.array([[1, np.nan], [3, 4]])
    assert np.array_equal(floats(fields), expected, equal_nan=True)


def test_an_array_of_double_precision_is_itself_and_single_numbers_hold_for_all() -> None:
    values = np.arange(3.0)
    assert floats(values) is values
    assert in_step("one", a=values, b=2)[1].tolist() == [2, 2, 2]


def test_a_reversal_is_found_beside_frames_without_a_travel() -> None:
    travel = np.append(np.arange(0, 50e-6, 5e-6), np.arange(50e-6, 0, -5e-6))
    travel[0] = np.nan
    assert analysis.branches(travel, least=3e-6) == [slice(0, 11), slice(10, 20)]


@pytest.mark.filterwarnings("error")
def test_pictures_of_any_form_or_a_sentence() -> None:
    picture = np.random.default_rng(0).normal(size=(80, 90)).astype(np.float32)
    picture[40, 50] = 90
    rows: Any = picture.tolist()
    assert analysis.micro_contacts(rows)[0].tolist() == [50.0]
    odds: list[Any] = [picture[:0], picture[0], 1.0]
    for odd in odds:
        with pytest.raises(ValueError, match="micro-contacts: a difference of shape"):
            analysis.micro_contacts(odd)
        with pytest.raises(ValueError, match="give two of one camera"):
            analysis.background_difference(picture, odd, (0.0, 0.0))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: analysis.interface_stiffness(SLIP, SLIP, SLIP, soft=0.0), "positive length"),
        (lambda: analysis.local_work([1e-4], SLIP, SLIP), r"over the radii \(nr,\)"),
        (lambda: analysis.stress_peak(X, X, np.eye(3), reach=1.0), r"shapes \(n,\) and \(n, n\)"),
        (lambda: analysis.stress_peak(X, X, X, reach=np.nan), "a positive reach"),
    ],
)
def test_the_sentence_says_what_to_give(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        call()


PICTURE = np.random.default_rng(3).integers(20, 200, (80, 90)).astype(np.float32)
LEVELS = analysis.photon_transfer.NoiseLevels(
    np.linspace(10.0, 200, 20), 0.0125 * np.linspace(10.0, 200, 20) + 1, np.full(20, 1e4)
)
CAMERA = analysis.photon_transfer.photon_transfer(LEVELS, 255)

# a function of pictures; one of them is given
OF_PICTURES: list[Callable[..., Any]] = [
    lambda image: analysis.correlate(image, PICTURE, box=12, step=6),
    lambda image: analysis.correlate(PICTURE, image, box=12, step=6),
    lambda image: analysis.photon_transfer.noise_levels(image, PICTURE, top=255),
    lambda image: analysis.photon_transfer.best_exposure(image, 0.01, CAMERA, 255),
    lambda image: analysis.pixel_map.dark_levels([PICTURE] * 9 + [image]),
    lambda image: analysis.pixel_map.map_of_flat([PICTURE] * 9 + [image]),
    lambda image: analysis.pixel_map.map_of_motion([image] * 12, np.ones((12, 2))),
    lambda image: analysis.dic_noise.noise_floor(image, 16),
    lambda image: analysis.dic_noise.correlation_map(PICTURE, image, 30, 30, 20, 8),
    lambda image: analysis.targets.scale_of_checkerboard(image, (10, 7), 1e-4),
    lambda image: analysis.targets.scale_of_lines(image, 1e-4, 7e-6),
]


@pytest.mark.parametrize("function", OF_PICTURES)
@pytest.mark.filterwarnings("error")
def test_a_pixel_without_a_grey_level_is_refused(function: Callable[..., Any]) -> None:
    unknown = PICTURE.copy()
    unknown[40, 50] = np.nan
    masked = np.ma.masked_array(PICTURE, mask=np.isnan(unknown))
    for odd in (masked, unknown, np.where(np.isnan(unknown), np.inf, PICTURE)):
        with pytest.raises(ValueError, match=r"^[a-zA-Z -]+: .*(masked|not finite).* found"):
            function(odd)
    for odd in (PICTURE[None], PICTURE[0], PICTURE[:0]):
        with pytest.raises(ValueError, match=r"^[a-zA-Z -]+: .*"):
            function(odd)


@pytest.mark.filterwarnings("error")
def test_masked_heights_are_not_known() -> None:
    heights = cv2.GaussianBlur(np.random.default_rng(0).normal(size=(128, 128)), (0, 0), 3) * 1e-5
    hidden = np.hypot(*np.indices(heights.shape)) < 40
    spoiled = np.ma.masked_array(np.where(hidden, 1e-3, heights), mask=hidden)
    found = analysis.roughness(spoiled, 1e-6)
    assert str(found) == str(analysis.roughness(np.where(hidden, np.nan, heights), 1e-6))
    assert np.isnan(found.residual[hidden]).all()


TIME = np.arange(60.0)
FORTH = np.minimum(TIME, 59 - TIME) * 1e-6
ACROSS, DOWN = np.meshgrid(np.arange(20.0, 400, 20), np.arange(20.0, 300, 20))
MOVED = np.ones((60, *ACROSS.shape)) * FORTH[:, None, None] / 7e-6
STILL, SHAPE = 0 * MOVED, (320, 420)
PRESSED = np.column_stack([TIME, 0.01 * TIME])
OF_A_RATE: list[Callable[[float], Any]] = [
    lambda rate: analysis.timing.exposure_lag([2] * 40, rate),
    lambda rate: analysis.timing.channel_skew(np.arange(4000.0), np.arange(4000.0), rate),
    lambda rate: analysis.timing.clock_drift(TIME, TIME, rate),
    lambda rate: analysis.sensor_noise(TIME, rate),
    lambda rate: analysis.pressed_share(PRESSED, rate),
]


@pytest.mark.parametrize("call", OF_A_RATE)
@pytest.mark.parametrize("rate", [0.0, -1000.0, np.nan, np.inf])
@pytest.mark.filterwarnings("error")
def test_a_rate_that_is_none_is_refused(call: Callable[[float], Any], rate: float) -> None:
    with pytest.raises(ValueError, match=r"rate_hz = .* found; give a finite number above 0"):
        call(rate)


ONE_UNKNOWN = np.where(TIME == 30, np.nan, TIME)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: analysis.compliance.holder_compliance(0 * TIME, FORTH * 1e6, FORTH), "all the sa"),
        (lambda: analysis.stage_motion.backlash(0 * TIME, FORTH, FORTH), "all the same"),
        (lambda: analysis.timing.clock_drift(ONE_UNKNOWN, TIME, 1.0), "is not known"),
        (lambda: analysis.timing.clock_drift(TIME[None], TIME, 1.0), "one shape"),
        (lambda: analysis.timing.exposure_lags(ONE_UNKNOWN, 0, 10), "one finite count"),
        (lambda: analysis.timing.exposure_lags([], 0, 10), "one finite count"),
        (lambda: analysis.timing.channel_skew(np.zeros(4000), np.arange(4000.0), 1e3), "in common"),
        (
            lambda: analysis.scale.scale_of_travels(FORTH[1:], ACROSS, DOWN, MOVED, STILL, SHAPE),
            "finite travel and time for each",
        ),
        (
            lambda: analysis.scale.scale_of_travels(
                FORTH, ACROSS, DOWN, MOVED, STILL, SHAPE, time_s=ONE_UNKNOWN
            ),
            "finite travel and time for each",
        ),
        (
            lambda: analysis.distortion_of_translation(ACROSS, DOWN, MOVED, STILL[:, 1:], SHAPE),
            r"give \(n, ny, nx\)",
        ),
        (
            lambda: analysis.distortion_of_translation(
                np.where(ACROSS > 300, np.nan, ACROSS), DOWN, MOVED, STILL, SHAPE
            ),
            "finite places",
        ),
        (lambda: analysis.scale.is_mirrored(0.0, STILL, 20.0 + STILL[1:]), "one shape"),
        (
            lambda: analysis.dic_noise.noise_by_box([PICTURE] * 9, ONE_UNKNOWN[26:35], [16]),
            "9 pictures at 8 times",
        ),
        (lambda: analysis.dic_noise.noise_floor(PICTURE, 0), "one that fits"),
        (lambda: analysis.targets.scale_of_checkerboard(PICTURE, (10, 7), 0.0), "above 0"),
        (lambda: analysis.targets.scale_of_checkerboard(PICTURE, (1, 7), 1e-4), "3 or more"),
        (lambda: analysis.targets.scale_of_lines(PICTURE, -1e-4, 7e-6), "above 0"),
        (lambda: analysis.targets.scale_of_lines(PICTURE, 1.0, 7e-6), "several fit"),
        (
            lambda: analysis.pixel_map.map_of_motion([PICTURE] * 12, np.ones((11, 2))),
            "a finite pair",
        ),
        (
            lambda: analysis.photon_transfer.photon_transfer(
                LEVELS, 255, mean_level=[10, 50, 100], exposure_s=[1, 5]
            ),
            "linearity: arrays of one shape",
        ),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_a_calibration_cannot_use_is_refused(call: Callable[[], Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        call()


@pytest.mark.filterwarnings("error")
def test_an_exposure_that_is_not_known_does_not_count_for_the_linearity() -> None:
    levels, exposures = [10.0, 50, 100, 150], [1.0, 5, 10, np.nan]
    found = analysis.photon_transfer.photon_transfer(
        LEVELS, 255, mean_level=levels, exposure_s=exposures
    )
    assert found.nonlinearity < 1e-9
