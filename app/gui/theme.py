"""The look of the window: a dark palette, because benches are dim, and a light one.

`apply` chooses, and `now` is the one in use. What a widget of which name looks like is in
`style.qss`.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from string import Template

from PySide6.QtGui import QColor, QPen
from PySide6.QtWidgets import QApplication

from app.gui.cells import Tone


@dataclass(frozen=True, slots=True)
class Palette:
    """Colours by what they are for. Those of curves can be told apart by the colour-blind."""

    name: str
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
    tones: dict[str, str]  # by their `Tone`

    def role(self, name: str) -> str:
        """The colour of a curve by what it shows; a colour, ``#rrggbb``, stays what it is."""
        colour: str = name if name.startswith("#") else getattr(self, name)
        return colour


HERE = Path(__file__).parent
ICONS = (HERE / "icons").as_posix()
SHEET = Template((HERE / "style.qss").read_text(encoding="utf-8"))
SIZE = re.compile(r"(?<= )([\d.]+)size\b")  # times that of the system's font
PALETTES = {
    name: Palette(name, **colours)
    for name, colours in tomllib.loads((HERE / "palettes.toml").read_text(encoding="utf-8")).items()
}
DARK, LIGHT = PALETTES["dark"], PALETTES["light"]
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


def apply(application: QApplication, name: str) -> None:
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
