"""Where displacements are measured: the polygons of the settings."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from blobs import Speckle, way
from command_line import call
from matplotlib.path import Path as Outline
from short_run import SMALL
from whole_runs import done

from analysis.dic import Correlation, Status, compile_kernels, open_tracker
from analysis.region import measured
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config

SPECKLE = Speckle((240, 320))
IMAGES = [SPECKLE.image(noise=2, seed=1), SPECKLE.image(1.3, -0.4, noise=2, seed=2)]
SHAPES = ("inside 40 30 250 50 200 200 60 180", "inside 260 20 300 20 300 220 260 220",
          "outside 100 80 160 80 130 150")  # fmt: skip


def fields(method: str, region: tuple[str, ...]) -> list:
    tracker = open_tracker(Correlation(**way(method), threads=1, region=region), IMAGES[0])
    found = [tracker.track(image) for image in IMAGES]
    tracker.close()
    return found


def expected(x: np.ndarray, y: np.ndarray, shapes: tuple[str, ...] = SHAPES) -> np.ndarray:
    """Matplotlib's answer."""
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    inside, outside = np.zeros(len(points), bool), np.zeros(len(points), bool)
    for text in shapes:
        word, *numbers = text.split()
        found = Outline(np.array(numbers, float).reshape(-1, 2)).contains_points(points)
        if word == "inside":
            inside |= found
        else:
            outside |= found
    return (inside & ~outside).reshape(x.shape)


def test_points_lie_in_polygons_as_another_program_says() -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 320, (50, 40)), rng.uniform(0, 240, (50, 40))
    polygons = Correlation(region=SHAPES).polygons
    is_in = measured(polygons, x, y)
    assert (is_in == expected(x, y)).all()
    assert 0.2 < is_in.mean() < 0.8
    bow = ("inside 20 20 300 220 300 20 20 220",)  # its edges cross: two triangles
    assert (measured(Correlation(region=bow).polygons, x, y) == expected(x, y, bow)).all()
    assert measured((), x, y).all()
    left_out = measured(Correlation(region=SHAPES[2:]).polygons, x, y)
    assert left_out.sum() > is_in.sum()


@pytest.mark.parametrize("method", ["shared", "quadratic", "icgn"])
def test_inside_the_region_a_field_is_the_same_to_the_bit(method: str) -> None:
    for whole, part in zip(fields(method, ()), fields(method, SHAPES), strict=True):
        grid = open_tracker(Correlation(**way(method), threads=1), IMAGES[0]).grid
        x, y = np.meshgrid(grid.x_px, grid.y_px)
        here = expected(x, y)
        assert (part.status[~here] == Status.MASKED).all()
        assert np.isnan(part.ux_px[~here]).all()
        for name in ("ux_px", "uy_px", "zncc", "ux_std_px", "status"):
            np.testing.assert_array_equal(getattr(part, name)[here], getattr(whole, name)[here])
        assert (part.status[here] == Status.OK).mean() > 0.95


@pytest.mark.parametrize(
    ("region", "sentence"),
    [
        (("inside 1 2 3 4",), "'inside 1 2 3 4' cannot be read; write inside or outside"),
        (("within 1 2 3 4 5 6",), "cannot be read"),
        (("inside 1 2 3 4 5 6.5",), "cannot be read"),
        (("inside 1 2 3 4 5 6 7",), "cannot be read"),
        (("inside 1 2 3 4 5 6",) * 21, "has 21 polygons; 20 is the most"),
    ],
)
def test_a_region_that_can_not_be_read_is_refused(region: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=re.escape(sentence)):
        Correlation(region=region)


def test_the_direct_method_and_a_region_without_a_box_are_refused() -> None:
    with pytest.raises(ValueError, match=r"dic\.region asked with method 'direct'"):
        Correlation(method="direct", region=SHAPES)
    nowhere = Correlation(region=("inside 0 0 3 0 3 3",), threads=1)
    with pytest.raises(ValueError, match="no box of 20 px lies in the region"):
        open_tracker(nowhere, IMAGES[0])


def test_a_region_of_plain_files(tmp_path: Path) -> None:
    """Each polygon is an option of its own."""
    names = [str(tmp_path / f"{n}.png") for n in range(2)]
    for name, image in zip(names, IMAGES, strict=True):
        cv2.imwrite(name, image)
    output = tmp_path / "fields.npz"
    words = [word for text in SHAPES for word in ("--region", text)]
    done = call("dic", *names, "-o", output, *words)
    assert done.exit_code == 0, done.output
    with np.load(output) as found:
        x, y = np.meshgrid(found["x_px"], found["y_px"])
        masked = found["status"][0] == list(found["status_names"]).index("masked")
        assert (masked == ~expected(x, y)).all()
        assert SHAPES[0] in dict(found["settings"])["region"]


def test_a_polygon_is_written_as_it_is_read() -> None:
    for text in SHAPES:
        (polygon,) = Correlation(region=(text,)).polygons
        assert polygon.text == text


@pytest.mark.parametrize("part", ["all", "field", "search"])
@pytest.mark.parametrize(
    "settings",
    [
        {"region": ("inside 100 100 1500 100 1500 1100 100 1100",)},
        {"region": ("outside 0 0 200 0 200 200 0 200",)},
        {"max_saturated": 0.0, "full_scale": 1},
        {"min_contrast": 250.0, "min_correlation": 0.99},
        {"quality": "auto", "region": SHAPES},
        {"method": "icgn", "region": SHAPES},
    ],
    ids=str,
)
def test_kernels_are_compiled_whatever_is_asked_of_the_picture(part: str, settings: dict) -> None:
    """They are compiled on a small picture of its own."""
    compile_kernels(Correlation(threads=1, **settings), np.uint8, part)


@pytest.mark.slow
@pytest.mark.parametrize("way_off", [(340, 240, 470, 350), (250, 20, 470, 120)])
def test_a_live_run_measures_in_a_region_away_from_the_corner(
    tmp_path: Path, way_off: tuple[int, int, int, int]
) -> None:
    left, top, right, bottom = way_off
    region = f"inside {left} {top} {right} {top} {right} {bottom} {left} {bottom}"
    settings = config.load(None, [*SMALL, "run.travel=5", f"dic.region=['{region}']"])
    run = live.make_run(settings, tmp_path / "a.h5", pace=None)
    assert done(run).reason == "the drive of 5 um is complete"
    with SessionReader(tmp_path / "a.h5") as session:
        (*_, last) = (s for s in session.snapshots() if s.field is not None)
    x, y = np.meshgrid(run.grid_x_px, run.grid_y_px)
    here = (x > left) & (x < right) & (y > top) & (y < bottom)
    assert (last.field.status[here] == Status.OK).mean() > 0.9
    assert (last.field.status[~here] != Status.OK).all()
