"""Calibrations on sessions of pictures that are made by hand, whose motion is known exactly."""

import math

import numpy as np
import pytest
from blobs import Speckle
from handmade import reader_of

from app.calibrations.lens_holder import LensHolder, LensHolderOptions

SHAPE, STRIP, PIXEL = (140, 160), 60, 10e-6
C = 6e-6  # m/N, of the holder


def pressed_on_a_marked_lens(angle):
    """Pictures of a block that follows its stage along `angle`, below marks on a lens that gives
    way to Q along it; positions and Q.
    """
    Q = 0.8 * np.abs(np.sin(np.linspace(0, 2 * np.pi, 44)))
    stage = 60e-6 * Q
    lens, block = Speckle(SHAPE, seed=1), Speckle(SHAPE, seed=2)
    x, y = math.cos(angle), math.sin(angle)
    pictures = []
    for q, way in zip(Q, stage, strict=True):
        marks = lens.grey(x * C * q / PIXEL, y * C * q / PIXEL, contrast=25, level=90)
        moved = block.grey(x * way / PIXEL, y * way / PIXEL, contrast=25, level=90)
        moved[:STRIP] = marks[:STRIP]
        pictures.append(np.rint(moved).astype(np.uint8))
    return pictures, stage, Q


@pytest.mark.parametrize("degrees", [30, -75, 180])
@pytest.mark.parametrize("angle_from", ["angle", "motion"])
def test_the_motion_of_the_lens_is_that_along_the_drive(degrees, angle_from):
    made = pressed_on_a_marked_lens(math.radians(degrees))
    told = degrees if angle_from == "angle" else 0
    settings = f"camera.angle={told}", f"camera.angle_from={angle_from}", "camera.pixel=10"
    reader = reader_of(*made, *settings, "dic.threads=1")
    edge = STRIP - 4
    marks = LensHolderOptions(region=(f"inside 0 0 160 0 160 {edge} 0 {edge}",))
    data = LensHolder()._seen(reader, marks)
    found = LensHolder().fit(data, marks)
    assert found.values[0].value == pytest.approx(C, rel=0.02)
    off = math.degrees(float(data["angle"])) - degrees
    assert abs((off + 180) % 360 - 180) < 2
    assert any("degrees in the picture" in remark for remark in found.remarks)


def test_a_block_that_does_not_move_tells_no_direction():
    pictures, stage, Q = pressed_on_a_marked_lens(0.0)
    reader = reader_of([pictures[0]] * len(Q), 0 * stage, Q, "camera.pixel=10", "dic.threads=1")
    with pytest.raises(ValueError, match=r"camera\.angle: the block moves by less"):
        LensHolder()._seen(reader, LensHolderOptions(region=("inside 0 0 160 0 160 50 0 50",)))
