"""A folder of images as a camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from contracts import TRAIN
from driver_runs import ClockedCameraContract, end_of_a_waiting_read, pass_time, started
from PIL import Image

from drivers.cameras.image_folder import (
    FolderCamera,
    find,
    has_known_order,
    images_of,
    in_order_of_numbers,
)
from drivers.clock import SampleClock
from drivers.errors import DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import Frame, LostFrame
from drivers.settings import CameraSettings

SHAPE = (64, 80)


def save(folder, names, dtype=np.uint8, shape=SHAPE):
    images = [np.full(shape, 7 * n, dtype) for n in range(len(names))]
    for name, image in zip(names, images, strict=True):
        Image.fromarray(image).save(folder / name)
    return images


@pytest.fixture
def clock():
    return SampleClock(1000.0)


def make(folder, clock, **changes):
    size = {"height": SHAPE[0], "width": SHAPE[1]}
    return FolderCamera(CameraSettings(folder=str(folder), **(size | changes)), clock)


class TestFolderCamera(ClockedCameraContract):
    @pytest.fixture
    def camera(self, tmp_path, clock):
        save(tmp_path, [f"{n}.png" for n in range(6)])
        return make(tmp_path, clock)


def test_images_come_in_the_order_of_their_numbers(tmp_path, clock):
    names = ["shot1.png", "shot2.tif", "shot10.TIFF"]
    images = save(tmp_path, names)
    (tmp_path / "notes.txt").write_text("not an image")
    assert [path.name for path in images_of(tmp_path)] == names
    assert [(f.device, f.description) for f in find(str(tmp_path))] == [
        (str(tmp_path), "3 images, shot1.png to shot10.TIFF")
    ]
    assert find() == []
    camera = make(tmp_path, clock)
    camera.open()
    assert camera.describe() == f"3 images of '{tmp_path}': 80 x 64, uint8; one for each trigger"
    camera.start(TRAIN)
    pass_time(clock, 1000)
    for image in images:
        np.testing.assert_array_equal(camera.read(1.0).image, image)


@pytest.mark.parametrize(
    "names",
    [
        "0.125s 0.25s 0.375s 0.5s 0.625s 1.0s",
        "9,25N 10,5N",
        "0.05 0.1 0.15",
        "F0.10-t0.25 F0.10-t0.5 F0.20-t0.125",
        "v1.8 v1.9 v1.10 v1.11 v2.1",
        "run1.98 run1.99 run1.100 run1.101",
        "img.0001 img.0002 img.0010",
        "2024.05.01-2 2024.05.01-12 2024.10.01-1",
    ],
)
def test_what_stands_behind_a_point_is_decimal_or_a_count(names):
    paths = [Path(f"{name}.tif") for name in names.split()]
    assert has_known_order(paths)
    assert in_order_of_numbers(reversed(paths)) == paths


@pytest.mark.parametrize("names", ["v1.9 v1.11", "0.5 0.10", "1.5 1.100"])
def test_it_may_be_either(names):
    assert not has_known_order([Path(f"{name}.tif") for name in names.split()])


def test_16_bit_images(tmp_path, clock):
    image = np.arange(64 * 80, dtype=np.uint16).reshape(SHAPE) * 10
    for name in ("a.png", "b.tif"):
        cv2.imwrite(str(tmp_path / name), image)
    camera = started(make(tmp_path, clock, pixel_format="Mono16"))
    pass_time(clock, 1000)
    for _ in range(2):
        read = camera.read(1.0).image
        assert read.dtype == camera.dtype == np.uint16
        np.testing.assert_array_equal(read, image)


def test_files_that_can_not_be_used_and_the_end_are_losses(tmp_path, clock):
    save(tmp_path, ["1.png", "2.png", "4.png"])
    save(tmp_path, ["3.png"], shape=(4, 80))
    (tmp_path / "2.png").write_bytes(b"\x89PNG and then nothing")
    Image.new("RGB", (80, 64)).save(tmp_path / "5.png")
    camera = started(make(tmp_path, clock))
    pass_time(clock, 10_000)
    answers = [camera.read(1.0) for _ in range(7)]
    assert [(a.index, a.sample) for a in answers] == [(n, TRAIN.sample(n)) for n in range(7)]
    assert [type(answer) for answer in answers] == [
        Frame,
        LostFrame,
        LostFrame,
        Frame,
        *3 * [LostFrame],
    ]
    assert [answers[n].reason for n in (1, 2, 4, 5, 6)] == [
        "'2.png': not an image that can be read; give a PNG, TIFF or BMP file",
        "'3.png' is 80 x 4 uint8, not 80 x 64 uint8",
        "'5.png' is 80 x 64 x 3 uint8, not 80 x 64 uint8",
        *2 * ["the folder has only 5 images"],
    ]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"width": 90},
            "folder camera: '0.png' is 80 x 64 uint8, not 90 x 64 uint8; set camera.width",
        ),
        ({"pixel_format": "Mono12"}, "'0.png' is 80 x 64 uint8, not 80 x 64 uint16"),
    ],
)
def test_images_of_another_size_or_depth_are_refused(tmp_path, clock, changes, sentence):
    save(tmp_path, ["0.png"])
    with pytest.raises(OutOfLimits, match=sentence):
        make(tmp_path, clock, **changes).open()


@pytest.mark.parametrize("name", ["", "missing"])
def test_a_folder_that_is_empty_or_missing_is_refused(tmp_path, clock, name):
    with pytest.raises(
        DeviceNotFound, match=r"has no image \(\.png, \.tif, \.tiff, \.bmp\); set camera\.folder"
    ):
        make(tmp_path / name, clock).open()


def test_stop_ends_a_waiting_read(tmp_path, clock):
    save(tmp_path, ["0.png"])
    camera = started(make(tmp_path, clock))
    error = end_of_a_waiting_read(camera, camera.stop, clock, "wait_for")
    assert isinstance(error, DeviceTimeout)
