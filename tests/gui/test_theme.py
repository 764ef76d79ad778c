"""Both palettes can be read, also by those who see fewer colours."""

import itertools

import cv2
import numpy as np
import pytest
from PySide6.QtWidgets import QApplication, QLabel

from app.gui import theme
from app.gui.theme import DARK, LIGHT, Palette

CURVES = ("normal", "shear", "stick", "model", "apparent")
# Machado, Oliveira, Fernandes (2009), severity 1, on linear light
DEUTAN = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
PROTAN = np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]])


def linear(colour: str) -> np.ndarray:
    share = np.array([int(colour[n : n + 2], 16) for n in (1, 3, 5)]) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    """By WCAG 2.1."""
    light, dark = sorted(
        (float(linear(c) @ (0.2126, 0.7152, 0.0722)) for c in (one, other)), reverse=True
    )
    return (light + 0.05) / (dark + 0.05)


def lab(light: np.ndarray) -> np.ndarray:
    share = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.asarray(cv2.cvtColor(share.astype(np.float32)[None, None], cv2.COLOR_RGB2Lab)[0, 0])


@pytest.fixture(autouse=True)
def as_before(qapp: QApplication) -> object:
    name, sheet = theme.now().name, qapp.styleSheet()
    yield
    theme.apply(qapp, name)
    qapp.setStyleSheet(sheet)


def test_the_measure_of_contrast_is_right() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("palette", [DARK, LIGHT], ids=lambda p: p.name)
def test_all_text_can_be_read(palette: Palette) -> None:
    for ground in (palette.panel, palette.window):
        for colour in (palette.text, palette.muted, *palette.tones.values()):
            assert contrast(colour, ground) >= 4.5, (colour, ground)
    for name in CURVES:  # their names stand beside them
        assert contrast(palette.role(name), palette.panel) >= 4.5, name
    assert contrast(palette.text, palette.button) >= 4.5
    assert contrast("#ffffff", "#c8202b") >= 4.5  # STOP MOTION


@pytest.mark.parametrize("palette", [DARK, LIGHT], ids=lambda p: p.name)
@pytest.mark.parametrize("sight", [np.eye(3), DEUTAN, PROTAN], ids=["all", "deutan", "protan"])
def test_curves_can_be_told_apart(palette: Palette, sight: np.ndarray) -> None:
    seen = {name: lab(np.clip(sight @ linear(palette.role(name)), 0, 1)) for name in CURVES}
    for one, other in itertools.combinations(CURVES, 2):
        assert np.linalg.norm(seen[one] - seen[other]) > 15, (one, other)


def test_sizes_follow_the_systems_font(qapp: QApplication) -> None:
    small, large = (
        [line for line in theme.style(DARK, size).splitlines() if "font-size" in line]
        for size in (9, 18)
    )
    assert small
    for one, other in zip(small, large, strict=True):
        sizes = [float(line.split("font-size: ")[1].split("pt")[0]) for line in (one, other)]
        assert sizes[1] == pytest.approx(2 * sizes[0], rel=0.02)


def test_the_window_changes_its_palette_while_it_is_open(qapp: QApplication) -> None:
    text = QLabel("P")
    text.show()
    for name, palette in (("light", LIGHT), ("dark", DARK)):
        theme.apply(qapp, name)
        assert theme.now() is palette
        assert palette.text == theme.TEXT
        assert text.palette().windowText().color().name() == palette.text
    text.deleteLater()
