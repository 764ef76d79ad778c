"""`slipscope tradeoff` as a user calls it, on small pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import refused
from tradeoff.grains import Speckle
from typer.testing import Result

Command = Callable[..., Result]
SHAPE = (200, 260)


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    """A reference and two pictures at rest, noise of 4 grey levels."""
    speckle = Speckle(SHAPE, seed=6, grain=(1.0, 1.6), density=0.1)
    paths = [tmp_path / f"rest_{n}.png" for n in range(3)]
    for n, path in enumerate(paths):
        cv2.imwrite(str(path), speckle.image(noise=4, seed=n))
    return paths


def test_the_trade_of_somebodys_pictures(slipscope: Command, pictures: list[Path]) -> None:
    command = ["tradeoff", "--quick", "--method", "shared", "--box", "16", "--box", "24"]
    command += [pictures[0], "--rest", *pictures, "--json", "t.json", "-o", "t.png"]
    done = slipscope(*command)
    assert done.exit_code == 0, done.output
    assert "noise 4" in done.stderr.replace("noise 3.9", "noise 4")
    assert "by 3 pictures at rest" in done.stderr
    assert "for 23.8 frames/s on this machine with 50% of it free" in done.stdout
    held = json.loads(Path("t.json").read_text())
    assert held["about"]["picture"] == "260 x 200 uint8"
    by_box = {row["name"]: row for row in held["variants"]}
    fine, coarse = by_box["shared, box 16"], by_box["shared, box 24"]
    # twice the pixels, and the noise of both pictures: as one over the side of the box
    assert fine["sigma_px"] / coarse["sigma_px"] == pytest.approx(24 / 16, rel=0.25)
    assert 0.85 < coarse["over_floor"] < 1.3
    assert cv2.imread("t.png").std() > 5
    again = slipscope(*command, "--overwrite")
    assert again.exit_code == 0
    assert json.loads(Path("t.json").read_text()) == held
    other = slipscope(*command[:-8], "--json", "t.json")  # without the pictures at rest
    refused_at_the_end(other, "t.json: measured with another", "--overwrite")
    assert json.loads(Path("t.json").read_text()) == held


def refused_at_the_end(result: Result, *words: str) -> None:
    assert result.exit_code == 2
    last = result.stderr.splitlines()[-1]
    assert all(word in last for word in words), last


def test_ctrl_c_leaves_what_was_measured(
    slipscope: Command, pictures: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from app.tradeoff.correlation_study import VariantTimer

    measure, calls = VariantTimer.measure, []

    def interrupted(bench: VariantTimer, variant: object) -> dict[str, float]:
        calls.append(variant)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return measure(bench, variant)

    monkeypatch.setattr(VariantTimer, "measure", interrupted)
    command = ["tradeoff", "--quick", "--method", "shared", "--box", "20", pictures[0]]
    left = slipscope(*command, "--json", "t.json")
    assert left.exit_code == 1
    assert "t.json: the same command goes on from there" in left.stderr
    assert len(json.loads(Path("t.json").read_text())["variants"]) == 1
    done = slipscope(*command, "--json", "t.json")
    assert done.exit_code == 0
    names = [variant.name for variant in calls]
    assert names.count(names[0]) == 1
    assert names.count(names[1]) == 2


def test_pictures_that_can_not_be_used(
    slipscope: Command, pictures: list[Path], tmp_path: Path
) -> None:
    speckle = cv2.imread(str(pictures[0]), cv2.IMREAD_GRAYSCALE)
    for name, image in {
        "small.png": speckle[:100, :100],
        "other.png": speckle[:180],
        "flat.png": np.full(SHAPE, 90, np.uint8),
        "colour.png": np.dstack([speckle, speckle, speckle // 2]),
    }.items():
        cv2.imwrite(str(tmp_path / name), image)
    reference = pictures[0]
    for words, said in {
        ("nowhere.png",): "nowhere.png",
        ("small.png",): "128 px or more",
        ("flat.png",): "flat.png: no speckle found",
        ("colour.png",): "convert it to grey levels",
        (reference, "other.png"): "the reference is 260 x 200",
        (reference, "--rest", "nowhere.png"): "nowhere.png",
        ("--rest", reference): "there is no reference",
        (reference, "-o", "t.bmp"): "the ending '.bmp' is not known",
        (reference, "-o", reference): "this is the picture itself",
        (reference, "--json", "nowhere/t.json"): "does not exist",
    }.items():
        refused_at_the_end(slipscope("tradeoff", "--quick", *words), said)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rate", "0"], "a rate above 0"),
        (["--rate", "nan"], "--rate: a finite number is needed; found nan"),
        (["--free", "1"], "less than 1"),
        (["--period", "-3"], "--period"),
        (["--method", "guess"], "--method guess: not known"),
        (["--box", "3"], "--box 3: a whole number at least 4"),
    ],
)
def test_options_that_can_not_be_used(slipscope: Command, words: list[str], said: str) -> None:
    refused(slipscope("tradeoff", *words), said)


def test_a_box_that_does_not_fit(slipscope: Command, pictures: list[Path]) -> None:
    refused_at_the_end(
        slipscope("tradeoff", pictures[0], "--box", "150"), "--box 150", "120 px is its limit"
    )
