"""The passes over the whole image: against exact images, against an obvious oracle, and without the
compiler.
"""

from __future__ import annotations

import inspect
import json

import numpy as np
import pytest
from blobs import Speckle
from numpy.polynomial.polynomial import polyval
from python_program import python
from trackers import inner, tracker_at_rest

from analysis.dic import Correlation, Grid, compile_kernels, open_tracker, quadratic, strips
from analysis.dic.passes import SharedPasses
from analysis.dic.spectrum import gradient, interpolation, texture
from analysis.dic.threads import Threads
from analysis.dic.tracker import ReferenceImage
from benchmarks.speckle import ExactMotion, Pattern, camera

SPECKLE = Speckle((240, 320))


def track(reference, image, **options):
    tracker = tracker_at_rest(reference, **options)
    field = tracker.track(image)
    tracker.close()
    return tracker.grid, field


@pytest.mark.parametrize("ux", [0.25, 0.5, 0.9, -1.3])
def test_the_bias_of_a_fraction_of_a_pixel_is_below_two_thousandths(ux: float) -> None:
    misses = [
        inner(
            track(
                SPECKLE.image(noise=2, seed=2 * n), SPECKLE.image(ux, 0.3, noise=2, seed=2 * n + 1)
            )[1].ux_px
        )
        - ux
        for n in range(4)
    ]
    assert abs(np.mean(misses)) < 0.002
    # the floor of this texture at box 20 and noise 2, see benchmarks.speckle.noise_floor
    assert np.std(misses) < 1.07 * 0.00547


@pytest.mark.parametrize("ux", [0.35, 0.5])
def test_without_noise_little_but_rounding_is_left(ux: float) -> None:
    _, field = track(SPECKLE.image(), SPECKLE.image(ux, -0.2))
    assert np.sqrt(np.mean((inner(field.ux_px) - ux) ** 2)) < 0.0012
    assert np.sqrt(np.mean((inner(field.uy_px) + 0.2) ** 2)) < 0.0012


def by_hand(reference, image, grid, u, order):
    """Displacements after one linear step from a uniform prediction u: box by box, tap by tap, by
    numpy's least squares; with order 2 of a quadratic.
    """
    place = (np.arange(grid.box_px) - (grid.box_px - 1) / 2) / (grid.box_px / 2)
    y, x = (axis.ravel() for axis in np.meshgrid(place, place, indexing="ij"))
    terms = np.stack([x**0, x, y, x * x, x * y, y * y][: 6 if order == 2 else 1], axis=1)
    grain = texture(reference.astype(np.float32))
    across, down = interpolation(grain.power_x), interpolation(grain.power_y)
    f = reference.astype(float)
    slope_x, slope_y = (np.zeros_like(f) for _ in range(2))
    for k, (x, y) in enumerate(
        zip(
            gradient(grain.power_x, grain.noise_share),
            gradient(grain.power_y, grain.noise_share),
            strict=True,
        )
    ):
        slope_x += x * np.roll(f, 4 - k, axis=1)
        slope_y += y * np.roll(f, 4 - k, axis=0)
    whole, part = np.floor(u).astype(int), np.asarray(u) - np.floor(u)
    read = np.zeros_like(f)
    for i, wy in enumerate(polyval(part[1], down.T)):
        for j, wx in enumerate(polyval(part[0], across.T)):
            read += (
                wx
                * wy
                * np.roll(image.astype(float), (3 - i - whole[1], 3 - j - whole[0]), axis=(0, 1))
            )
    out = np.empty((2, *grid.shape))
    for i, top in enumerate(grid.top):
        for j, left in enumerate(grid.left):
            box = np.s_[top : top + grid.box_px, left : left + grid.box_px]
            columns = np.hstack(
                [
                    np.ones((grid.box_px**2, 1)),
                    f[box].reshape(-1, 1),
                    slope_x[box].reshape(-1, 1) * terms,
                    slope_y[box].reshape(-1, 1) * terms,
                ]
            )
            solved = np.linalg.lstsq(columns, read[box].ravel(), rcond=None)[0]
            gain, px, py = solved[[1, 2, 2 + terms.shape[1]]]
            out[:, i, j] = u[0] - px / gain, u[1] - py / gain
    return out


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("box", "step", "u"),
    [
        (20, 10, (0.3, -0.2)),
        (21, 10, (2.0, 1.45)),
        (9, 5, (0.3, -0.2)),
        (16, 30, (2.0, 1.45)),
        (34, 17, (0.3, -0.2)),
    ],
)
def test_one_pass_is_what_least_squares_gives_box_by_box(
    box: int, step: int, u: tuple[float, float], order: int
) -> None:
    reference, image = (
        SPECKLE.image(noise=2, seed=1),
        SPECKLE.image(u[0] + 0.04, u[1] - 0.03, noise=2, seed=2),
    )
    grid = Grid.cover(reference.shape, box, step)
    prepared = ReferenceImage(reference, grid, Threads(1))
    grain = texture(reference.astype(np.float32))
    passes = SharedPasses(prepared, grain, max_passes=1, is_quadratic=order == 2)
    start = np.broadcast_to(np.array(u)[:, None, None], (2, *grid.shape)).copy()
    image.flags.writeable = False  # as a tracker gives it
    found = passes.refine(image, start, np.ones(grid.shape, bool)).u
    expected = by_hand(reference, image, grid, u, order)
    margin = -(-8 // step)
    # 8-bit gradients, single precision
    most = 4e-4 * (20 / box) ** 2 * (3 if order == 2 else 1)
    assert np.abs(inner(found, margin) - inner(expected, margin)).max() < most


def small_fields() -> list[list[list[list[float]]]]:
    """Displacement, correlation and uncertainty of both orders in a small picture."""
    speckle, found = Speckle((52, 60)), []
    for order in (1, 2):
        settings = Correlation(box=16, step=8, threads=1, order=order)
        tracker = open_tracker(settings, speckle.image(noise=1, seed=1))
        tracker.start_from(*np.zeros((2, *tracker.grid.shape)))
        field = tracker.track(speckle.image(0.4, 0.2, noise=1, seed=2))
        found.append([part.tolist() for part in (field.ux_px, field.zncc, field.ux_std_px)])
    return found


@pytest.mark.slow
def test_kernels_give_the_same_without_the_compiler() -> None:
    code = f"""
import json, numpy as np
from analysis.dic import Correlation, open_tracker
from blobs import Speckle
{inspect.getsource(small_fields)}
print(json.dumps(small_fields()))
"""
    done = python("-W", "ignore", "-c", code, environment={"NUMBA_DISABLE_JIT": "1"})
    assert done.returncode == 0, done.stderr
    without = np.array(json.loads(done.stdout.splitlines()[-1]))
    np.testing.assert_allclose(without, small_fields(), atol=2e-5)


def ring_errors(noise: float, **options) -> tuple[float, float]:
    """Root mean square errors of u_x in the graded zone of a contact whose slope reaches 1.9 %, and
    outside.
    """
    pattern, rng = Pattern((360, 480), 3), np.random.default_rng(4)
    motion = ExactMotion(inside=0.0, outside=1.5, stick=30.0, radius=150.0, centre=(240.0, 180.0))
    reference, image = (
        camera(pattern.grey(m), noise, rng) for m in (ExactMotion.uniform(0.0), motion)
    )
    grid, field = track(reference, image, **options)
    x, y = np.meshgrid(grid.x_px, grid.y_px)
    miss, ring = inner(field.ux_px - motion(x, y)[0]), inner(motion.ring(x, y))
    return float(np.sqrt(np.mean(miss[ring] ** 2))), float(np.sqrt(np.mean(miss[~ring] ** 2)))


def test_gradients_do_not_hide_displacements() -> None:
    ring, outside = ring_errors(noise=0)
    assert ring < 0.003
    assert outside < 0.0015


def test_noise_is_not_amplified_where_the_field_is_graded() -> None:
    ring, outside = ring_errors(noise=2)
    assert ring < 0.0072
    assert outside < 0.0064


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("box", "step", "noise"), [(10, 10, 1), (20, 5, 4), (21, 10, 2), (40, 10, 2), (24, 30, 1)]
)
def test_stated_uncertainties_have_unit_variance(
    box: int, step: int, noise: float, order: int
) -> None:
    errors = []
    for n in range(4):
        ux, uy = 0.37 + 0.2 * n, -0.61
        reference, image = (
            SPECKLE.image(noise=noise, seed=10 * n),
            SPECKLE.image(ux, uy, noise=noise, seed=10 * n + 1),
        )
        _, field = track(reference, image, box=box, step=step, order=order)
        keep = -(-6 // step)
        errors += [
            inner((field.ux_px - ux) / field.ux_std_px, keep),
            inner((field.uy_px - uy) / field.uy_std_px, keep),
        ]
    values = np.concatenate([e.ravel() for e in errors])
    assert np.nanstd(values) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize(
    ("dtype", "factor"), [(np.uint16, 16), (np.uint16, 257), (np.float32, 1 / 255)]
)
def test_the_depth_of_the_images_does_not_matter(dtype: type, factor: float) -> None:
    reference, image = SPECKLE.image(noise=2, seed=1), SPECKLE.image(0.4, noise=2, seed=2)
    _, eight = track(reference, image)
    _, other = track(
        *((picture * float(factor)).astype(dtype) for picture in (reference, image)),
        min_contrast=0.001,
    )
    assert np.abs(inner(eight.ux_px - other.ux_px)).max() < 1e-3
    np.testing.assert_allclose(inner(other.ux_std_px), inner(eight.ux_std_px), rtol=0.02)


@pytest.mark.parametrize(("box", "step"), [(4, 3), (5, 7), (63, 20), (100, 25), (200, 10)])
def test_boxes_from_4_to_200_px(box: int, step: int) -> None:
    _, field = track(SPECKLE.image(), SPECKLE.image(0.3), box=box, step=step, min_correlation=0.0)
    ok = field.status == 0
    assert ok.mean() > (0.6 if box > 5 else 0.1)
    assert np.median(np.abs(field.ux_px[ok] - 0.3)) < 0.02 / box + 0.0005


@pytest.mark.parametrize("order", [1, 2])
def test_no_image_makes_a_kernel_compile_during_a_run(order: int) -> None:
    compile_kernels(Correlation(order=order))
    kernels = strips.load_rows, strips.sum_cells, quadratic.solve_quadratics
    compiled = {kernel: len(kernel.signatures) for kernel in kernels}
    image = SPECKLE.image()
    locked = image.copy()
    locked.flags.writeable = False
    for target in (image, locked, np.asfortranarray(image), np.pad(image, 4)[4:-4, 4:-4]):
        track(locked, target, order=order)
    track(locked[:16], image[:16], order=order, box=14)  # one strip of rows
    assert {kernel: len(kernel.signatures) for kernel in compiled} == compiled
