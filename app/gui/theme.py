"""The look of the window: a dark palette, because benches are dim, and a light one.

`apply` chooses, and `now` is the one in use. What a widget of which name looks like is in
`style.qss`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Literal

from PySide6.QtGui import QColor, QPen
from PySide6.QtWidgets import QApplication

from app.gui.cells import Tone

Name = Literal["dark", "light"]


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours by what they are for. Those of curves can be told apart by the colour-blind."""

    name: Name
    window: str
    panel: str
    edge: str
    button: str
    hover: str  # under the pointer
    off: str  # what cannot be pressed
    start: str
    start_edge: str
    start_text: str
    text: str
    muted: str
    grid: str
    # a quantity has one colour everywhere: in curves, their legends and names, and in live numbers
    normal: str  # P
    shear: str  # Q, and the traction σ that it is the integral of
    friction: str  # Q/P and μ
    travel: str  # δ
    displacement: str  # u_x
    stick: str  # c
    apparent: str  # a
    model: str  # closed forms
    saturated: str
    tones: dict[Tone, str]

    def role(self, name: str) -> str:
        """The colour of a curve by what it shows; a colour, ``#rrggbb``, stays what it is."""
        colour: str = name if name.startswith("#") else getattr(self, name)
        return colour


DARK = Palette(
    name="dark",
    window="#14171c",
    panel="#1c2027",
    edge="#2d333d",
    button="#2a303a",
    hover="#343c48",
    off="#1f242b",
    start="#22603f",
    start_edge="#2f8457",
    start_text="#e4e7eb",
    text="#e4e7eb",
    muted="#98a2b0",
    grid="#5b6573",
    normal="#6cb2f0",
    shear="#f2a03d",
    friction="#c4734d",
    travel="#7b86ff",
    displacement="#e64fb8",
    stick="#35c9a5",
    apparent="#f1f3f5",
    model="#f7ee7a",
    saturated="#ff2020",
    tones={
        Tone.NEUTRAL: "#98a2b0",
        Tone.GOOD: "#52b788",
        Tone.BUSY: "#4f9fe8",
        Tone.WARN: "#e0a63a",
        Tone.BAD: "#f0655c",
        Tone.REPLAY: "#b48cf2",
    },
)
LIGHT = Palette(
    name="light",
    window="#e9ecf0",
    panel="#ffffff",
    edge="#c3c9d2",
    button="#f2f4f7",
    hover="#e2e6ec",
    off="#dfe3e8",
    start="#1f7a4d",
    start_edge="#1f7a4d",
    start_text="white",
    text="#1a1f27",
    muted="#525c6a",
    grid="#8a94a2",
    normal="#0b6bb8",
    shear="#b04a00",
    friction="#6d1e09",
    travel="#23239a",
    displacement="#8e1a78",
    stick="#00775a",
    apparent="#20252d",
    model="#5a1fe0",
    saturated="#e00000",
    tones={
        Tone.NEUTRAL: "#525c6a",
        Tone.GOOD: "#1a7045",
        Tone.BUSY: "#1666b0",
        Tone.WARN: "#8a5a00",
        Tone.BAD: "#c0271d",
        Tone.REPLAY: "#6a35c0",
    },
)
HERE = Path(__file__).parent
ICONS = (HERE / "icons").as_posix()
SHEET = Template((HERE / "style.qss").read_text(encoding="utf-8"))
SIZE = re.compile(r"(?<= )([\d.]+)size\b")  # times that of the system's font
PALETTES = {palette.name: palette for palette in (DARK, LIGHT)}
_used: list[Palette] = [DARK]


def now() -> Palette:
    """The palette in use."""
    return _used[0]


def mixed(colour: str, ground: str, share: float) -> str:
    """`colour` as it looks on `ground`, of which it lets all but a `share` through; ``#rrggbb``."""
    pairs = zip(bytes.fromhex(colour[1:]), bytes.fromhex(ground[1:]), strict=True)
    return "#" + bytes(round(share * a + (1 - share) * b) for a, b in pairs).hex()


def ring() -> QPen:
    """Draws the rectangle of a widget as the ring of two pixels of what has the focus."""
    return QPen(QColor(now().tones[Tone.BUSY]), 4)  # half of it lies outside


def apply(application: QApplication, name: Name) -> None:
    """Use a palette in all windows of the program, in sizes that follow the system's font."""
    _used[0] = PALETTES[name]
    sheet = style(now(), application.font().pointSizeF())
    if sheet != application.styleSheet():  # else all widgets of all windows are styled again
        application.setStyleSheet(sheet)


def style(palette: Palette, size: float) -> str:
    """The style sheet of a palette, about text of `size` points."""
    colours = {name: getattr(palette, name) for name in Palette.__slots__} | palette.tones
    sheet = SHEET.substitute(colours, icons=ICONS)
    return SIZE.sub(lambda times: f"{size * float(times[1]):.3g}pt", sheet)
