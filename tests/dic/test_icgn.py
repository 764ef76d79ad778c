"""Inverse-compositional Gauss-Newton against exact images and slow, obvious versions of itself."""

from functools import partial

import numpy as np
import pytest
from blobs import Speckle
from regression import box_pixels, slow_newton, taylor
from scipy.ndimage import convolve1d
from scipy.optimize import least_squares

from analysis.dic import icgn, interpolants, reading
from analysis.dic.icgn import PARAMETERS, IcgnSolver, Solution
from analysis.dic.spectrum import interpolation, texture
from analysis.dic.status import Status
from analysis.grid import Grid

SHAPE = (100, 120)
# derivative, exact to the 8th power
SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
WEIGHTS = interpolation(texture(Speckle(SHAPE, seed=4).grey().astype(np.float32)).power)


@pytest.fixture(scope="module")
def speckle():
    return Speckle(SHAPE, seed=4)


def slopes(image):
    return tuple(convolve1d(image, -SLOPE, axis=axis, mode="mirror") for axis in (1, 0))


def read(image, x, y):
    """Grey levels between the pixels, by `WEIGHTS`."""
    i, j = np.floor(y).astype(int), np.floor(x).astype(int)
    down, across = (np.polynomial.polynomial.polyval(t, WEIGHTS.T) for t in (y - i, x - j))
    taps = range(len(WEIGHTS))
    return sum(down[m] * across[k] * image[i + m - 3, j + k - 3] for m in taps for k in taps)


def solver(reference, box=20, step=10, **options):
    reference = np.asarray(reference, np.float64)
    grid = grid_of(reference, box, step)
    return IcgnSolver(reference, slopes(reference), grid, WEIGHTS, **options)


def grid_of(image, box, step):
    """A grid that leaves 8 px free all round."""
    grid = Grid.cover((image.shape[0] - 14, image.shape[1] - 14), box, step)
    return Grid(box, step, grid.x_px + 7, grid.y_px + 7)


def solve(solver, image, shape, start=(0, 0), bands=1):
    begin = np.zeros((PARAMETERS, *shape))
    begin[:2] = np.reshape(start, (2, 1, 1))
    result = Solution.empty(shape)
    solver.load(np.asarray(image))
    for rows in np.array_split(np.arange(shape[0]), bands):
        solver.solve((int(rows[0]), int(rows[-1]) + 1), begin, result)
    return result


def run(reference, image, box=20, step=10, start=(0, 0), **options):
    shape = grid_of(reference, box, step).shape
    return solve(solver(reference, box, step, **options), image, shape, start)


def deformed(speckle, *, ux=0.0, uy=0.0, gradient=(0, 0, 0, 0)):
    """The image after a field given by its Taylor coefficients in the middle of the image, and that
    field as a function.
    """
    middle_y, middle_x = (size / 2 for size in SHAPE)

    def field(x, y):
        x, y = x - middle_x, y - middle_y
        return ux + gradient[0] * x + gradient[1] * y, uy + gradient[2] * x + gradient[3] * y

    return speckle.grey(*field(speckle.x, speckle.y)), field


def noisy(image, noise, seed):
    return image + noise * np.random.default_rng(seed).normal(size=image.shape)


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_a_point_agrees_with_regression_after_regression(speckle, masked, monkeypatch):
    reference = noisy(speckle.grey(), 2, 1)
    image = noisy(
        deformed(speckle, ux=0.4, uy=-0.3, gradient=(0.01, -0.004, 0.006, -0.012))[0], 2, 2
    )
    usable = np.ones(SHAPE, np.bool_)
    if masked:
        usable[:, 50:56] = usable[40:44] = False
    grid = grid_of(reference, 21, 16)
    mask = usable if masked else None
    single = run(reference, image, 21, 16, usable=mask)
    monkeypatch.setattr(icgn, "KIND", np.float64)
    found = run(reference, image, 21, 16, usable=mask, tolerance_px=1e-8, max_iterations=60)
    for i, j in [(0, 0), (1, 2), (2, 3)]:
        p, zncc, std = slow_newton(
            reference, partial(read, image), slopes(reference), grid, i, j, 1, usable
        )
        half = 10.5 ** np.array([0, 0, 1, 1, 1, 1])
        assert found.parameters[:, i, j] * half == pytest.approx(p * half, abs=1e-6)
        assert found.zncc[i, j] == pytest.approx(zncc, abs=1e-8)
        assert found.std[:, i, j] == pytest.approx(std, rel=1e-4)
    assert np.abs(single.parameters[:2] - found.parameters[:2]).max() < 1e-3 / 3
    assert (found.status == Status.OK).all()


def test_the_minimum_of_the_criterion_is_the_same_for_a_general_minimiser(speckle):
    """Forward, with all parameters free and numerical derivatives: the images agree but for
    interpolation, so the minima do.
    """
    true = (0.004, 0.002, -0.003, 0.005)
    reference, image = speckle.grey(), deformed(speckle, ux=0.37, uy=0.21, gradient=true)[0]
    grid, (i, j) = grid_of(reference, 25, 20), (1, 1)
    x, y, dx, dy = box_pixels(grid, i, j)

    def normalised(a):
        return ((a - a.mean()) / np.sqrt(((a - a.mean()) ** 2).sum())).ravel()

    def residual(scaled):
        ux, uy = taylor(1, scaled / scale, dx, dy)
        return normalised(reference[y, x]) - normalised(read(image, x + ux, y + uy))

    scale = 12.5 ** np.array([0, 0, 1, 1, 1, 1])
    best = least_squares(residual, np.zeros(scale.size), xtol=1e-12, ftol=1e-12, gtol=1e-12).x
    found = run(reference, image, 25, 20, tolerance_px=1e-5)
    assert found.parameters[:2, i, j] == pytest.approx(best[:2], abs=3e-4)
    assert found.parameters[:, i, j] * scale == pytest.approx(best, abs=2e-3)
    assert found.zncc[i, j] == pytest.approx(1 - (residual(best) ** 2).sum() / 2, abs=1e-5)


@pytest.mark.parametrize(("box", "step"), [(4, 9), (5, 7), (20, 10), (33, 20), (84, 1)])
def test_a_shift_is_found_with_any_box(speckle, box, step):
    found = run(speckle.grey(), speckle.grey(1.4, -0.7), box, step, start=(1, -1))
    ok = found.status == Status.OK
    assert ok.mean() > (0.99 if box > 5 else 0.6)
    limit = {4: 0.05, 5: 0.05}.get(box, 0.006)
    error = found.parameters[:2, ok] - np.array([[1.4], [-0.7]])
    assert np.median(np.abs(error)) < limit
    if box > 5:
        assert np.abs(error).max() < limit
        assert np.abs(found.parameters[2:, ok]).max(initial=0) < 2e-3
        assert found.zncc.min() > 0.9995


def test_the_largest_boxes_are_solved_in_pieces():
    speckle = Speckle((230, 240), seed=8)
    found = run(speckle.grey(), speckle.grey(0.4, -3.3), 200, 10, start=(0, -3))
    assert (found.status == Status.OK).all()
    assert np.abs(found.parameters[:2] - np.array([[[0.4]], [[-3.3]]])).max() < 1e-3


def test_affine_boxes_recover_gradients(speckle):
    """2 % along x, and shear; the blobs themselves do not stretch, which takes their share, about 1
    %, off the gradient.
    """
    true = np.array([0.02, -0.01, 0.006, 0.015])
    image, field = deformed(speckle, ux=0.3, uy=0.4, gradient=true)
    found = run(speckle.grey(), image, 41, 10)
    grid = grid_of(image, 41, 10)
    assert (found.status == Status.OK).all()
    expected = field(*np.meshgrid(grid.x_px, grid.y_px))
    assert np.abs(found.parameters[:2] - expected).max() < 0.01
    assert found.parameters[2:].mean(axis=(1, 2)) == pytest.approx(true, abs=5e-4)


@pytest.mark.parametrize("scale", [1, 200])
def test_light_and_contrast_change_nothing(speckle, scale):
    """Gain 0.75 and 20 grey levels more; 16-bit levels likewise."""
    reference, image = (
        noisy(a, 1, k) * scale for k, a in enumerate((speckle.grey(), speckle.grey(0.6, 0.3)))
    )
    same = run(reference, image)
    other = run(reference, 0.75 * image + 20 * scale)
    assert np.abs(other.parameters[:2] - same.parameters[:2]).max() < 1e-4
    assert np.abs(other.zncc - same.zncc).max() < 1e-5
    assert other.std == pytest.approx(same.std, rel=0.02)


@pytest.mark.parametrize(
    ("levels", "limit"),
    [(lambda a: np.rint(a * 200).astype(np.uint16), 1e-4), (lambda a: a + 60000, 1e-3)],
    ids=["sixteen bits", "a pedestal"],
)
def test_finer_steps_and_a_pedestal_of_grey_levels_change_nothing(speckle, levels, limit):
    pair = [noisy(a, 1, k) for k, a in enumerate((speckle.grey(), speckle.grey(0.6, 0.3)))]
    same, other = run(*pair), run(*map(levels, pair))
    assert np.abs(other.parameters[:2] - same.parameters[:2]).max() < limit
    assert np.abs(other.zncc - same.zncc).max() < 1e-4


def test_rows_solved_apart_are_the_same_to_the_bit(speckle):
    reference, image = noisy(speckle.grey(), 2, 1), noisy(speckle.grey(0.6, 0.3), 2, 2)
    one = solver(reference)
    shape = grid_of(reference, 20, 10).shape
    whole, parts = (solve(one, image, shape, bands=n) for n in (1, shape[0]))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, parts, strict=True))


def test_points_that_leave_the_image_say_so(speckle):
    found = run(speckle.grey(), speckle.grey(14, 0), start=(14, 0))
    assert (found.status[:, -1] == Status.OUT_OF_IMAGE).all()
    assert (found.status[:, :-3] == Status.OK).all()
    assert np.isnan(found.parameters[:, :, -1]).all()
    assert np.isnan(found.zncc[:, -1]).all()
    far = run(speckle.grey(), speckle.grey(), start=(-1e300, 1e300))
    assert (far.status == Status.OUT_OF_IMAGE).all()


def test_a_flat_box_has_no_displacement(speckle):
    reference = speckle.grey()
    reference[:50, :60] = 77
    one = solver(reference)
    found = solve(one, speckle.grey(0.5, 0), grid_of(reference, 20, 10).shape)
    assert found.status[0, 0] == Status.NOT_CONVERGED
    assert np.isnan(found.parameters[:, 0, 0]).all()
    assert one.contrast[0, 0] == pytest.approx(0, abs=1e-9)
    assert one.contrast[-1, -1] == pytest.approx(reference[-28:-8, -28:-8].std(), rel=0.5)
    assert (found.status[:, -1] == Status.OK).all()
    blank = solve(one, np.full(SHAPE, 128.0), found.status.shape)
    assert (blank.status == Status.NOT_CONVERGED).all()


def test_masked_boxes_and_points_that_are_not_asked_for(speckle):
    usable = np.ones(SHAPE, np.bool_)
    usable[:, :24] = False
    grid = grid_of(np.empty(SHAPE), 20, 10)
    reference = speckle.grey()
    reference[~usable] = 200  # must not matter
    one = IcgnSolver(reference, slopes(speckle.grey()), grid, WEIGHTS, usable=usable)
    one.load(speckle.grey(0.4, 0))
    result, start = Solution.empty(grid.shape), np.zeros((6, *grid.shape))
    start[3, 0, 5] = np.nan
    result.parameters[:, 0, 5], result.status[0, 5] = 7, 99
    one.solve((0, grid.shape[0]), start, result)
    share = np.array([usable[0, left : left + 20].mean() for left in grid.left])
    assert (result.status[1] == np.where(share < 0.5, Status.MASKED, Status.OK)).all()
    assert np.nanmax(np.abs(result.parameters[0, 1:] - 0.4)) < 0.01
    assert (result.parameters[:, 0, 5] == 7).all()
    assert result.status[0, 5] == 99


def test_few_steps_suffice(speckle):
    assert run(speckle.grey(), speckle.grey(0.45, 0.2), 31).iterations.max() <= 4


def test_steps_are_composed_to_first_order_in_the_step():
    """The places x + u(x), read at x - d(x) for a tiny d: Taylor coefficients from a fit."""
    rng, half = np.random.default_rng(5), 8.0
    u, d = rng.normal(size=(2, 3)), 1e-6 * rng.normal(size=(2, 3))
    x, y = rng.uniform(-1, 1, (2, 60))

    def field(c, x, y):
        return c @ np.stack([np.ones_like(x), x, y])

    back = field(d, x, y)
    value = field(u, x - back[0] / half, y - back[1] / half) - back
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    expected = np.linalg.lstsq(terms, value.T, rcond=None)[0].T[:, :3]
    composed = u.copy()
    icgn.compose(composed, d, half)
    assert composed - u == pytest.approx(expected - u, abs=1e-11)
    assert np.abs(composed - u + d).max() > 1e-8


def test_what_does_not_come_to_rest_says_so(speckle):
    reference = speckle.grey()
    assert (
        run(reference, speckle.grey(0.5, 0), max_iterations=1).status == Status.NOT_CONVERGED
    ).all()
    assert (
        run(reference, speckle.grey(0.5, 0), furthest_px=0.3).status == Status.NOT_CONVERGED
    ).all()
    other = run(reference, Speckle(SHAPE, seed=99).grey())
    assert (other.status != Status.OK).mean() > 0.9
    assert (other.zncc[other.status == Status.OK] < 0.8).all()


def test_normalised_errors_have_unit_variance():
    """Noise of 2 grey levels in both images, five shifts; the curve of the spline at these shifts
    keeps most of the noise.
    """
    speckle = Speckle((220, 260), seed=6)
    reference = noisy(speckle.grey(), 2, 0)
    one, shape = solver(reference, 20, 12), grid_of(reference, 20, 12).shape
    normalised = []
    for k, (ux, uy) in enumerate([(0.1, 0.6), (0.35, 0.2), (0.5, 0.5), (0.8, 0.9), (0, 0.3)], 1):
        found = solve(one, noisy(speckle.grey(ux, uy), 2, k), shape)
        normalised.append((found.parameters[:2] - np.array([[[ux]], [[uy]]])) / found.std)
    assert np.mean(np.square(normalised)) == pytest.approx(1, abs=0.1)


def test_the_same_without_the_compiler(speckle, monkeypatch):
    monkeypatch.setattr(icgn, "KIND", np.float64)
    reference, image = speckle.grey(), speckle.grey(0.4, 0.2)
    grid = Grid(5, 5, np.array([40.0, 60]), np.array([50.0]))
    fast, slow = Solution.empty(grid.shape), Solution.empty(grid.shape)
    one = IcgnSolver(reference, slopes(reference), grid, WEIGHTS)
    one.load(image)
    start = np.zeros((PARAMETERS, *grid.shape))
    one.solve((0, 1), start, fast)
    for module in (icgn, interpolants, reading):
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
    one.solve((0, 1), start, slow)
    assert (fast.status == slow.status).all()
    assert fast.parameters == pytest.approx(slow.parameters, abs=1e-9, nan_ok=True)
    assert fast.std == pytest.approx(slow.std, rel=1e-6, nan_ok=True)
