"""The paper's direct correlation against exact images and a slow, obvious version of itself."""

from contextlib import closing

import numpy as np
import pytest
from blobs import Speckle

from analysis.dic import Correlation, Status, open_tracker


@pytest.fixture(scope="module")
def speckle():
    return Speckle((240, 320))


def opened(reference, **options):
    correlation = Correlation(**{"method": "direct", "search": 16, **options})
    return closing(open_tracker(correlation, reference))


def track_all(images, **options):
    with opened(images[0], **options) as tracker:
        return [tracker.track(image) for image in images[1:]]


def same_bits(a, b, where=...):
    return all(
        getattr(a, n)[where].tobytes() == getattr(b, n)[where].tobytes()
        for n in ("ux_px", "uy_px", "zncc", "status")
    )


def is_ok(field):
    return field.status == Status.OK


def slow_point(reference, image, top, left, box, search):
    """Displacement and correlation of one box: the definition, with no regard for time."""

    def zncc(a, b):
        a, b = a - a.mean(), b - b.mean()
        return (a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum())

    reference, image = reference.astype(float), image.astype(float)
    template = reference[top : top + box, left : left + box]
    c = {}
    for y in range(-search, search + 1):
        for x in range(-search, search + 1):
            if (
                top + y >= 0
                and left + x >= 0
                and top + y + box <= image.shape[0]
                and left + x + box <= image.shape[1]
            ):
                c[x, y] = zncc(template, image[top + y : top + y + box, left + x : left + x + box])
    x0, y0 = max(c, key=c.get)
    offsets = [(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    terms = np.array([[1, x, y, x * x, x * y, y * y] for x, y in offsets], float)
    logs = np.log([c[x0 + x, y0 + y] for x, y in offsets])
    _, b, cc, d, e, f = np.linalg.lstsq(terms, logs, rcond=None)[0]
    dx, dy = np.linalg.solve([[2 * d, e], [e, 2 * f]], [-b, -cc])
    return x0 + dx, y0 + dy, c[x0, y0]


@pytest.mark.parametrize(
    ("box", "dtype"), [(20, np.uint8), (21, np.uint8), (13, np.uint16), (32, np.float32)]
)
def test_a_point_agrees_with_the_definition_of_the_method(speckle, box, dtype):
    scale = {np.uint8: 1, np.uint16: 200, np.float32: 0.37}[dtype]
    reference, image = (
        (a * float(scale)).astype(dtype)
        for a in (speckle.image(noise=2), speckle.image(-2.3, 3.6, noise=2, seed=1))
    )
    with opened(reference, box=box, step=11, search=6, min_contrast=0.5) as tracker:
        field = tracker.track(image)
        for i, j in [(2, 3), (7, 11), (12, 20)]:
            slow = slow_point(reference, image, tracker.grid.top[i], tracker.grid.left[j], box, 6)
            assert [field.ux_px[i, j], field.uy_px[i, j], field.zncc[i, j]] == pytest.approx(
                slow, abs=1e-5
            )


@pytest.mark.parametrize(
    ("ux", "uy"), [(0, 0), (0.25, -0.4), (-3.75, 2.5), (11.3, -9.8), (-15.2, 15.1)]
)
def test_a_uniform_displacement_is_found_at_once_over_the_whole_field(speckle, ux, uy):
    (field,) = track_all([speckle.image(), speckle.image(ux, uy)])
    inner = np.s_[2:-2, 2:-2]
    assert is_ok(field)[inner].all()
    assert np.abs(field.ux_px[inner] - ux).max() < 0.12
    assert np.abs(field.uy_px[inner] - uy).max() < 0.12
    assert abs(field.ux_px[inner].mean() - ux) < 0.004
    assert abs(field.uy_px[inner].mean() - uy) < 0.004


def test_the_resolution_is_the_papers_or_better():
    """Section 2.3.2: standard deviation 0.033 px at box 20 over displacements from 0.14 to 14 px;
    larger boxes resolve more.
    """
    speckle = Speckle((200, 320), seed=2)
    shifts = np.linspace(0.14, 14, 8)
    images = [speckle.image(noise=2)] + [
        speckle.image(ux, noise=2, seed=k) for k, ux in enumerate(shifts, 1)
    ]
    sigma = {}
    for box in (12, 20, 40):
        fields = track_all(images, box=box)
        sigma[box] = np.concatenate(
            [(f.ux_px - ux)[is_ok(f)] for f, ux in zip(fields, shifts, strict=True)]
        ).std()
    assert sigma[20] < 0.033
    assert sigma[40] < sigma[20] < sigma[12]


@pytest.mark.parametrize(("contrast", "level"), [(40, 60), (20, 20), (20, 110), (60, 5)])
def test_light_and_contrast_are_no_displacement(speckle, contrast, level):
    reference = speckle.grey().astype(np.float32)
    same, changed = (
        track_all([reference, speckle.grey(1.3, -0.6, *light).astype(np.float32)])[0]
        for light in [(40, 20), (contrast, level)]
    )
    assert np.array_equal(same.status, changed.status)
    for name in ("ux_px", "uy_px", "zncc"):
        np.testing.assert_allclose(getattr(changed, name), getattr(same, name), atol=2e-4)


def test_a_box_without_contrast_says_so(speckle):
    reference, image = speckle.image(), speckle.image(0.5)
    reference[:60, :60] = 100
    image[160:, 240:] = 100
    image[160:, 240::2] += 1
    (field,) = track_all([reference, image])
    assert (field.status[:4, :4] == Status.LOW_CONTRAST).all()
    assert (field.status[-4:, -4:] == Status.LOW_CONTRAST).all()
    assert np.isnan(field.ux_px[:4, :4]).all()
    assert is_ok(field)[6:14, 8:20].all()


def test_a_dark_frame_leaves_no_trace(speckle):
    """Not even beyond the reach of a cold start."""
    reference, *images = (speckle.image(ux) for ux in (0, 12, 20.3, 20.8, 21.3))
    clear = track_all([reference, *images])
    before, far, dark, *after = track_all(
        [reference, *images[:2], np.zeros_like(reference), *images[2:]]
    )
    assert same_bits(before, clear[0])
    assert same_bits(far, clear[1])
    assert (dark.status == Status.LOW_CONTRAST).all()
    for field, same in zip(after, clear[2:], strict=True):
        assert is_ok(field)[3:-3, 3:-3].all()
        assert same_bits(field, same, np.s_[3:-3, 3:-3])


def test_a_box_that_leaves_the_image_says_so(speckle):
    fields = track_all([speckle.image(), speckle.image(6.3), speckle.image(8.4)])
    assert (fields[0].status[1:-1, -1] == Status.OUT_OF_IMAGE).all()
    assert (fields[1].status[1:-1, -1] == Status.OUT_OF_IMAGE).all()
    assert is_ok(fields[1])[1:-1, 1:-1].all()


def test_a_lost_point_says_so_and_comes_back_by_itself(speckle):
    images = [speckle.image(1.1 * n, -0.6 * n, noise=2, seed=n) for n in range(6)]
    hidden = np.s_[80:150, 100:190]
    stranger = Speckle((240, 320), seed=99, grain=(0.75, 1.25))
    for n in (2, 3):
        images[n] = images[n].copy()
        images[n][hidden] = stranger.image(seed=n)[hidden]
    fields = track_all(images)
    lost = np.s_[10:13, 12:17]
    assert is_ok(fields[0])[lost].all()
    for field in fields[1:3]:
        assert (field.status[lost] == Status.DECORRELATED).mean() > 0.9
        assert np.isnan(field.ux_px[~is_ok(field)]).all()
    for n in (4, 5):
        assert is_ok(fields[n - 1])[2:-2, 2:-2].all()
        assert np.abs(fields[n - 1].ux_px[2:-2, 2:-2] - 1.1 * n).max() < 0.15


def test_a_skipped_frame_changes_no_other_field(speckle):
    images = [speckle.image(1.4 * n, -0.9 * n, noise=2, seed=n) for n in range(7)]
    full = track_all(images)
    for skipped in range(1, 6):
        fields = track_all(images[:skipped] + images[skipped + 1 :])
        for with_all, with_less in zip(full[: skipped - 1] + full[skipped:], fields, strict=True):
            assert is_ok(with_less)[2:-2, 2:-2].all()
            both = is_ok(with_all) & is_ok(with_less)
            assert same_bits(with_all, with_less, both)


@pytest.mark.parametrize("threads", [2, 5])
def test_the_number_of_threads_changes_no_bit(speckle, threads):
    images = [
        speckle.image(),
        speckle.image(3.4, 1),
        speckle.image(-12, 8, noise=4),
        speckle.image(-11.2, 8.3),
    ]
    images[2][90:140, 60:200] = 7
    for one, more in zip(
        track_all(images, threads=1), track_all(images, threads=threads), strict=True
    ):
        assert same_bits(one, more)


def test_a_tracker_starts_from_a_given_field_or_from_nothing(speckle):
    reference, before, image = (
        speckle.image(),
        speckle.image(17.6, -13.2),
        speckle.image(18.7, -13.9),
    )
    with opened(reference, search=3) as tracker:
        ux = np.full(tracker.grid.shape, np.nan)
        ux[9, 12] = 17.6
        tracker.start_from(ux, -13.2 / 17.6 * ux)
        tracker.track(before)
        started = tracker.track(image)
        tracker.reset()
        assert not is_ok(tracker.track(image))[5:-5, 5:-5].any()
        tracker.reset()
        assert same_bits(tracker.track(reference), track_all([reference, reference], search=3)[0])
    assert is_ok(started)[3:-3, 3:-3].all()
    assert np.abs(started.ux_px[3:-3, 3:-3] - 18.7).max() < 0.12


def test_the_images_are_not_kept_or_changed(speckle):
    reference, image = speckle.image(), speckle.image(0.7)
    reference.flags.writeable = image.flags.writeable = False
    with opened(reference) as tracker:
        first = tracker.track(image)
        kept = [a.copy() for a in (first.ux_px, first.uy_px, first.zncc, first.status)]
        tracker.track(speckle.image(1.5))
        for before, now in zip(
            kept, (first.ux_px, first.uy_px, first.zncc, first.status), strict=True
        ):
            assert before.tobytes() == now.tobytes()


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((240, 319), np.uint8), "319 x 240 px found, the reference has 320 x 240"),
        (np.zeros((240, 320, 3), np.uint8), "one grey level per pixel"),
        (np.zeros((240, 320), np.int32), "int32 found"),
        (np.zeros((240, 320), np.uint16), "uint16 found, the reference has uint8"),
        (np.full((240, 320), np.nan, np.float32), "not finite"),
    ],
)
def test_an_image_that_can_not_be_used_is_refused(speckle, image, words):
    with opened(speckle.image()) as tracker, pytest.raises(ValueError, match=words):
        tracker.track(image)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"box": 149}, "do not fit"),
        ({"step": 0}, "step must be"),
        ({"search": 0}, "search"),
        ({"threads": 0}, "threads"),
    ],
)
def test_options_that_can_not_be_used_are_refused(speckle, options, words):
    with pytest.raises(ValueError, match=words):
        opened(speckle.image()[:150], **options)
