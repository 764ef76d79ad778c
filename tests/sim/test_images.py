"""The simulated camera's pictures: exact blobs, the fast renderer against them, micro-contacts,
light and noise.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import ndimage
from worlds import scenario

from benchmarks.render import apparent_shift_px
from drivers.errors import DeviceFault
from drivers.sim import speckle, warp
from drivers.sim.images import LIGHT, Renderer, dust
from drivers.sim.world import World

PIXEL = 40e-6  # a whole contact in a small picture; gradients keep their size
SHAPE = (233, 317)
SCENARIO = scenario(width=SHAPE[1], height=SHAPE[0], pixel=PIXEL, press_time=0.0, press_samples=1)


@dataclass(frozen=True)
class Block:
    """A state with a smooth made-up elastic displacement (pixels): g0 = A (1 + q)^-1, g2 = B q (1 +
    q)^-2 with q = (r / 60)^2.
    """

    rigid: tuple[float, float] = (0.0, 0.0)
    radius: float = 0.0
    g: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (150.3, 112.8)
    angle: float = 0.0
    rough: None = None

    @property
    def drive(self):
        return math.cos(self.angle), math.sin(self.angle)

    @property
    def rigid_m(self):
        return self.rigid[0] * PIXEL, self.rigid[1] * PIXEL

    @property
    def lens_centre_m(self):
        return self.centre[0] * PIXEL, self.centre[1] * PIXEL

    @property
    def apparent_radius_m(self):
        return self.radius * PIXEL

    def radial(self, r_m):
        q = (np.asarray(r_m) / PIXEL / 60) ** 2
        return PIXEL * self.g[0] / (1 + q), PIXEL * self.g[1] * q / (1 + q) ** 2

    def displacement(self, x, y):
        """Elastic displacement at (x, y) from the centre, written in cosines."""
        g0, g2 = self.radial(np.hypot(x, y) * PIXEL)
        theta = np.arctan2(y, x) - self.angle
        along = (g0 + g2 * np.cos(2 * theta) + 1j * g2 * np.sin(2 * theta)) / PIXEL
        turned = along * np.exp(1j * self.angle)
        return turned.real, turned.imag


@pytest.fixture(scope="module")
def renderer():
    return Renderer(SCENARIO)


@pytest.fixture(scope="module")
def drive():
    """States of a drive: pressed, partial slip, sliding."""
    world = World(SCENARIO, pace=None)
    world.start()
    world.advance(2)
    world.move(300e-6, 5e-6)
    world.advance(40_000)
    states = {
        "pressed": world.state(2),
        "partial slip": world.state(15_000),
        "sliding": world.state(40_000),
    }
    assert 0.3 < states["partial slip"].stick_radius_m / states["partial slip"].hertz_radius_m < 0.7
    assert states["sliding"].stick_radius_m == 0
    return states


# ------------------------------------------------------------------ exact blobs


@pytest.mark.parametrize("rho", [0.0, 0.03, -0.05])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_blob_is_integrated_over_every_pixel(rho, dtype):
    x, y, sx, sy = 11.37, 9.81, 0.9, 1.3
    cov = np.array([[sx * sx, rho * sx * sy], [rho * sx * sy, sy * sy]])
    image = np.zeros((20, 24), dtype)
    speckle.add_blobs(
        image, *(np.array([v]) for v in (x, y, cov[0, 0], cov[0, 1], cov[1, 1], 100.0))
    )
    node, weight = np.polynomial.legendre.leggauss(8)
    dx = (np.arange(24)[:, None] + node / 2).ravel() - x
    dy = (np.arange(20)[:, None] + node / 2).ravel() - y
    p = np.linalg.inv(cov)
    value = np.exp(
        -0.5 * (p[0, 0] * dx**2 + 2 * p[0, 1] * dx * dy[:, None] + p[1, 1] * dy[:, None] ** 2)
    )
    expected = 100 * np.einsum("jaib,a,b->ji", value.reshape(20, 8, 24, 8), weight / 2, weight / 2)
    np.testing.assert_allclose(image, expected, atol=1e-4)


def test_blobs_across_the_border_are_cut_there():
    centres = np.array([-1.2, 5.0, 30.0]), np.array([3.0, 9.6, 3.0])
    one, none = np.ones(3), np.zeros(3)
    wide = np.zeros((30, 30))
    speckle.add_blobs(wide, centres[0] + 10, centres[1] + 10, one, none, one, one)
    image = np.zeros((10, 10))
    speckle.add_blobs(image, *centres, one, none, one, one)
    np.testing.assert_allclose(image, wide[10:20, 10:20], atol=1e-12)


def test_a_period_of_the_pattern_continues_itself():
    rng = np.random.default_rng(0)
    n = 400
    rows, columns = speckle.period((10, 20))
    blobs = speckle.Blobs(
        rng.uniform(0, columns, n),
        rng.uniform(0, rows, n),
        rng.uniform(0.8, 1.6, n),
        rng.uniform(1, 2, n),
    )
    moved = replace(blobs, x=(blobs.x + 50) % columns, y=(blobs.y + 91) % rows)
    np.testing.assert_allclose(
        speckle.spline_coefficients(moved, (10, 20)),
        np.roll(speckle.spline_coefficients(blobs, (10, 20)), (182, 100), (0, 1)),
        atol=1e-4,
    )


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_blobs_are_seen_where_the_map_brings_them_and_deformed_by_its_gradient(angle):
    block = Block(rigid=(7.3, -2.6), g=(2.0, 0.9), angle=angle)
    rng = np.random.default_rng(0)
    x, y, sigma = (
        rng.uniform(0, SHAPE[1], 500),
        rng.uniform(0, SHAPE[0], 500),
        rng.uniform(0.7, 1.5, 500),
    )
    period = speckle.period(SHAPE)
    move = warp.motion(block, PIXEL, SHAPE, speckle.HALO_PX, 64)
    px, py, xx, xy, yy = warp.place(
        warp.as_if_rigid(x, y, move, period, speckle.HALO_PX), sigma, move
    )
    gx, gy = block.displacement(px, py)
    np.testing.assert_allclose(px + block.centre[0] - block.rigid[0] + gx, x, atol=1e-5)
    np.testing.assert_allclose(py + block.centre[1] - block.rigid[1] + gy, y, atol=1e-5)
    h = 1e-4
    dx = [
        (a - b) / (2 * h)
        for a, b in zip(block.displacement(px + h, py), block.displacement(px - h, py), strict=True)
    ]
    dy = [
        (a - b) / (2 * h)
        for a, b in zip(block.displacement(px, py + h), block.displacement(px, py - h), strict=True)
    ]
    assert max(np.abs(g).max() for g in dx + dy) > 0.02
    inverse = np.linalg.inv(np.array([[1 + dx[0], dy[0]], [dx[1], 1 + dy[1]]]).transpose(2, 0, 1))
    covariance = sigma[:, None, None] ** 2 * inverse @ inverse.transpose(0, 2, 1)
    np.testing.assert_allclose(
        np.stack([xx, xy, yy]), covariance[:, [0, 0, 1], [0, 1, 1]].T, atol=2e-4
    )


def test_the_exact_picture_of_a_block_moved_by_whole_pixels_is_the_same_picture_moved(renderer):
    light = _light()
    still, moved = (
        renderer.grey(Block(rigid=r), exact=True) / light for r in ((0.0, 0.0), (7.0, -3.0))
    )
    # the light is kept in single precision
    np.testing.assert_allclose(moved[:-3, 7:], still[3:, :-7], atol=1e-4)


def _light():
    """The light alone, an image of its definition."""
    x, y = np.linspace(-0.5, 0.5, SHAPE[1]), np.linspace(-0.5, 0.5, SHAPE[0])
    return (
        1
        - LIGHT
        + 2 * LIGHT * np.cos(0.8 * np.pi * (x - 0.1)) * np.cos(0.8 * np.pi * (y + 0.12))[:, None]
    )


# ------------------------------------------------------------------ fast against exact


@pytest.mark.parametrize("exact", [True, False])
def test_the_picture_moves_with_the_block(renderer, exact):
    reference = renderer.grey(Block(), exact=True)
    shift = apparent_shift_px(reference, renderer.grey(Block(rigid=(0.03, -0.02)), exact))
    np.testing.assert_allclose(np.median(shift, axis=(1, 2)), (0.03, -0.02), atol=1e-3)


@pytest.mark.parametrize(
    "state",
    [
        "pressed",
        "partial slip",
        "sliding",
        Block(rigid=(0.5, 0.5)),
        Block(rigid=(5003.37, -411.71), radius=80, g=(2.0, 0.9)),
    ],
    ids=["pressed", "partial slip", "sliding", "half a pixel", "far away"],
)
def test_the_fast_picture_is_the_exact_one_within_a_fifth_of_a_thousandth_of_a_pixel(
    renderer, drive, state
):
    state = drive[state] if isinstance(state, str) else state
    exact, fast = renderer.grey(state, exact=True), renderer.grey(state, exact=False)
    shift = apparent_shift_px(exact, fast)
    assert np.sqrt(np.mean(shift**2)) <= 0.0002
    assert np.abs(shift).max() <= 0.002
    assert np.std(fast - exact) < 0.05


def test_what_renderers_share_can_not_be_written_to():
    first, second = Renderer(SCENARIO), Renderer(SCENARIO)
    for name in ("_normals", "_coefficients"):
        shared = getattr(first, name)
        assert getattr(second, name) is shared
        with pytest.raises(ValueError, match="read-only"):
            shared[0] = 0


def exact_half_pixels(grains, shape):
    """A period of the free block at every half pixel, of exact blobs."""
    rows, columns = speckle.period(shape)
    fine = np.zeros((2 * rows, 2 * columns))
    ones, variance = np.ones(9), np.tile(grains.sigma**2, 9)
    down, across = (a.ravel() for a in np.meshgrid((-rows, 0, rows), (-columns, 0, columns)))
    for top, left in np.ndindex(2, 2):
        x, y = np.add.outer(across, grains.x) - left / 2, np.add.outer(down, grains.y) - top / 2
        one = np.zeros((rows, columns))
        peak = np.outer(ones, grains.peak).ravel()
        speckle.add_blobs(one, x.ravel(), y.ravel(), variance, 0 * variance, variance, peak)
        fine[top::2, left::2] = one
    return fine


def test_the_table_holds_the_cubic_spline_of_exact_half_pixels():
    shape = 20, 33
    grains, _ = speckle.speckle(shape, 3)
    exact = ndimage.spline_filter(exact_half_pixels(grains, shape), order=3, mode="grid-wrap")
    made = speckle.spline_coefficients(grains, shape)
    np.testing.assert_allclose(made, exact, atol=0.01)  # of 50 grey levels
    assert np.std(made - exact) < 2e-4
    table = warp.table(made)
    for half in (0, 1):
        kept = table[:, half] * warp.STEP_GREY
        np.testing.assert_allclose(kept[:, :-2], made[:, half::2], atol=warp.STEP_GREY / 2)
        np.testing.assert_array_equal(kept[:, -2:], kept[:, :2])


def test_levels_beyond_the_range_of_the_table_saturate_instead_of_wrapping():
    table = warp.table(np.float32([[-1e4, -600.0, 600.0, 1e4], [-511.0, 0.0, 0.01, 511.0]]))
    low, high = -(1 << 15), (1 << 15) - 1
    assert table[:, 0].tolist() == [[low, high] * 2, [-511 * 64, 1] * 2]
    assert table[:, 1].tolist() == [[low, high] * 2, [0, 511 * 64] * 2]


def test_the_warp_is_the_cubic_spline_of_the_pattern_at_the_mapped_points():
    block = Block(rigid=(7.3, -2.6), g=(2.0, 0.9), angle=-0.4)
    grains, _ = speckle.speckle(SHAPE, 1)
    move = warp.motion(block, PIXEL, SHAPE, speckle.HALO_PX)
    out = np.empty(SHAPE, np.float32)
    warp.warp(warp.table(speckle.spline_coefficients(grains, SHAPE)), move, out)
    y, x = np.indices(SHAPE).astype(float)
    gx, gy = block.displacement(x - block.centre[0], y - block.centre[1])
    expected = ndimage.map_coordinates(
        exact_half_pixels(grains, SHAPE),
        [2 * (y - block.rigid[1] + gy), 2 * (x - block.rigid[0] + gx)],
        order=3,
        mode="grid-wrap",
    )
    np.testing.assert_allclose(out, expected, atol=0.02)
    assert np.std(out - expected) < 0.004


@pytest.mark.parametrize("exact", [True, False])
def test_the_block_may_travel_any_way(renderer, exact):
    rows, columns = speckle.period(SHAPE)
    here, there = (
        Block(rigid=(3.25, 1.5), radius=80, g=(2.0, 0.5)),
        Block(rigid=(3.25 - 3 * columns, 1.5 + 2 * rows), radius=80, g=(2.0, 0.5)),
    )
    np.testing.assert_allclose(renderer.grey(there, exact), renderer.grey(here, exact), atol=1e-3)


def test_both_renderers_take_the_same_noise(renderer, drive):
    exact = Renderer(scenario(SCENARIO, renderer="exact")).image(drive["partial slip"], 5)
    fast = renderer.image(drive["partial slip"], 5)
    # two roundings are 0.41, independent noise of 1.4 grey levels would be 2
    assert np.std(exact.astype(float) - fast) < 0.8


# ------------------------------------------------------------------ the scene


def test_the_free_block_has_the_stated_grey_levels(renderer):
    grey = renderer.grey(Block(), exact=True) / _light()
    assert abs(grey.mean() - 90) < 1.5
    assert 22 < grey.std() < 27  # pixels blur it a little


def test_exposure_and_gain_of_the_camera_multiply_the_light():
    camera = Renderer(scenario(width=96, height=64, pixel=PIXEL))
    usual_s = type(SCENARIO.camera)().exposure
    plain = camera.grey(Block(), exact=False)
    for exposure, gain_db, factor in ((1.0, 20.0, 10.0), (0.5, 0.0, 0.5), (2.0, 6.0206, 4.0)):
        camera.adjust(exposure * usual_s, gain_db)
        np.testing.assert_allclose(camera.grey(Block(), exact=False), factor * plain, rtol=1e-4)


def test_the_light_stays_in_the_lab_and_varies_by_its_share(renderer):
    light = _light()
    assert light.max() == pytest.approx(1 + LIGHT, abs=0.01)
    assert light.min() == pytest.approx(1 - LIGHT, abs=0.02)


def test_micro_contacts_shine_inside_the_apparent_contact_only(renderer):
    state = Block(rigid=(4.2, 0.3), radius=80.0)
    bright = (
        renderer.grey(state, exact=True) - renderer.grey(replace(state, radius=0.0), exact=True)
    ) / _light()
    y, x = np.indices(SHAPE)
    r = np.hypot(x - state.centre[0], y - state.centre[1])
    reach = 5.5 * speckle.SPOT_SIGMA_PX[1] + 1
    assert np.all(bright[r > state.radius + reach] == 0)
    assert bright.max() > 80


def test_micro_contacts_bring_the_light_of_their_number():
    low, high = speckle.SPOT_SIGMA_PX
    mass = 2 * np.pi * (low * low + low * high + high * high) / 3 * np.mean(speckle.SPOT_GREY)
    # integral of the pressure less half the ramp
    lit = np.pi * 100**2 * (2 / 3 - speckle.SPOT_RAMP / 2)
    found = []
    for seed in range(8):
        one = Renderer(scenario(SCENARIO, seed=seed))
        with_contact, free = Block(radius=100.0), Block()
        found.append(
            np.sum((one.grey(with_contact, exact=False) - one.grey(free, exact=False)) / _light())
        )
    # 80 spots in each: +-4 % for their number, and a little for their size
    assert np.mean(found) == pytest.approx(speckle.SPOTS_PER_PX2 * mass * lit, rel=0.15)


def test_every_micro_contact_that_moves_into_the_contact_is_lit(renderer):
    state = Block(radius=60.0, g=(25.0, 0.0))
    spots = speckle.micro_contacts(SHAPE, SCENARIO.sim.seed)
    move = warp.motion(state, PIXEL, SHAPE, speckle.HALO_PX)
    base = warp.as_if_rigid(
        spots.blobs.x, spots.blobs.y, move, speckle.period(SHAPE), speckle.HALO_PX
    )
    x, y, xx, xy, yy = warp.place(base, spots.blobs.sigma, move)
    lit = speckle.brightness(np.hypot(x, y), 60.0, spots.threshold)
    assert np.any(lit[np.hypot(*base) > 60] > 0)
    expected = np.zeros(SHAPE)
    speckle.add_blobs(
        expected, x + state.centre[0], y + state.centre[1], xx, xy, yy, spots.blobs.peak * lit
    )
    bright = (
        renderer.grey(state, exact=True) - renderer.grey(replace(state, radius=0.0), exact=True)
    ) / _light()
    np.testing.assert_allclose(bright, expected, atol=1e-3)


def test_the_density_of_lit_micro_contacts_follows_the_hertz_pressure_and_ends_at_the_radius():
    threshold = np.linspace(0, 1, 20_001)
    for q in (0.0, 0.5, 0.9, 0.99):
        lit = speckle.brightness(np.full_like(threshold, q * 300), 300.0, threshold)
        # a smooth ramp over w leaves the pressure less w / 2
        assert lit.mean() == pytest.approx(np.sqrt(1 - q * q) - speckle.SPOT_RAMP / 2, abs=1e-3)
    assert speckle.brightness(np.array([299.99, 300.0, 300.1]), 300.0, np.zeros(3)).astype(
        bool
    ).tolist() == [True, False, False]
    assert np.all(speckle.brightness(np.zeros(3), 0.0, np.zeros(3)) == 0)


# ------------------------------------------------------------------ the sensor


def test_noise_is_shot_noise_plus_read_noise(renderer):
    noisy = Renderer(scenario(SCENARIO, read_noise=2.0, full_well=6000.0))
    grey = noisy.grey(Block(), exact=False)
    noise = np.stack([noisy.image(Block(), k) - grey for k in range(6)])
    for low, high in ((60, 70), (85, 95), (120, 140)):
        here = (grey > low) & (grey < high)
        variance = 2.0**2 + grey[here].mean() * 255 / 6000 + 1 / 12
        count = 6 * here.sum()
        assert noise[:, here].var() == pytest.approx(variance, rel=5 * np.sqrt(2 / count))
        assert abs(noise[:, here].mean()) < 5 * np.sqrt(variance / count)
    correlation = np.corrcoef(noise.reshape(6, -1)) - np.eye(6)
    # rows that start at the same place of the table are rare
    assert np.abs(correlation).max() < 5 / np.sqrt(grey.size) + 0.01
    neighbours = (
        np.mean(noise[:, :, 1:] * noise[:, :, :-1]) / noise.var(),
        np.mean(noise[:, 1:] * noise[:, :-1]) / noise.var(),
    )
    assert max(np.abs(neighbours)) < 0.01


def test_without_noise_a_picture_is_the_rounded_grey_level(drive):
    clean = Renderer(scenario(SCENARIO, read_noise=0.0, full_well=0.0))
    image, grey = clean.image(drive["sliding"], 0), clean.grey(drive["sliding"], exact=False)
    assert np.abs(image - np.clip(grey, 0, 255)).max() < 0.501


def test_the_sensor_saturates_instead_of_wrapping():
    image = Renderer(scenario(SCENARIO, full_well=0.3)).image(Block(), 0)
    assert 0.3 < np.mean(image == 0) < 0.5
    assert 0.2 < np.mean(image == 255) < 0.4


def test_few_pixels_saturate(renderer, drive):
    assert np.mean(renderer.image(drive["sliding"], 0) == 255) < 1e-3


def test_one_seed_and_frame_give_one_picture(renderer, drive):
    state = drive["partial slip"]
    first = renderer.image(state, 3)
    kept = first.copy()
    assert first.shape == SHAPE
    assert first.dtype == np.uint8
    assert first.flags.c_contiguous
    assert not np.array_equal(renderer.image(state, 4), first)
    renderer.image(drive["sliding"], 3)
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(Renderer(SCENARIO).image(state, 3), first)
    assert (
        np.corrcoef(Renderer(scenario(SCENARIO, seed=2)).image(state, 3).ravel(), first.ravel())[
            0, 1
        ]
        < 0.2
    )


# ------------------------------------------------------------------ what cannot be drawn


def test_an_unknown_renderer_is_refused():
    with pytest.raises(ValueError, match="renderer must be 'fast' or 'exact'; found 'blurry'"):
        scenario(SCENARIO, renderer="blurry")


def test_an_elastic_displacement_beyond_the_pattern_is_refused(renderer):
    with pytest.raises(DeviceFault, match="33 px cannot be drawn, 32 px is the limit"):
        renderer.image(Block(g=(33.0, 0.0)), 0)


def test_dust_stays_where_it_is_and_takes_its_share_of_the_light(renderer):
    clean = {"read_noise": 0.0, "full_well": 0.0}
    passed = dust(SHAPE, 40, SCENARIO.sim.seed)
    for state in (Block(), Block(rigid=(3.3, -1.7))):
        seen = Renderer(scenario(SCENARIO, dust=40, **clean)).image(state, 0).astype(float)
        grey = Renderer(scenario(SCENARIO, **clean)).grey(state, exact=False)
        assert np.abs(seen - np.clip(grey * passed, 0, 255)).max() < 0.6
    assert 0.4 < passed.min() < 0.8
    assert passed.max() > 1.1
    dark, bright = passed < 0.95, passed > 1.05
    assert dark.sum() > 2 * bright.sum() > 0
    _, marks = ndimage.label(np.abs(passed - 1) > 0.02)
    assert 25 < marks <= 40
    assert (dust(SHAPE, 0, 1) == 1).all()
