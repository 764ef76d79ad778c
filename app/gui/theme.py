"""The look of the window: a dark palette, because benches are dim, and a light one.

`apply` chooses; `now` is the one in use, and so are `STYLE`, `TEXT`, `TONES` and the like.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

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
ALARM = """
QFrame#panel { background: #c8202b; border: 2px solid #ffb3b3; }
QLabel { color: white; font-weight: 700; }
"""
ICONS = (Path(__file__).parent / "icons").as_posix()
QUANTITIES = ("normal", "shear", "friction", "travel", "displacement", "stick")
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


def __getattr__(name: str) -> Any:
    if name == "STYLE":
        return style(now(), QApplication.font().pointSizeF())
    if name.isupper() and name.lower() in Palette.__slots__:
        return getattr(now(), name.lower())
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def style(palette: Palette, size: float) -> str:
    """The style sheet of a palette, about text of `size` points."""
    p, tones = palette, palette.tones
    is_dark = palette.name == "dark"
    hover, off = ("#343c48", "#1f242b") if is_dark else ("#e2e6ec", "#dfe3e8")
    start, start_edge, start_text = (
        ("#22603f", "#2f8457", p.text) if is_dark else ("#1f7a4d", "#1f7a4d", "white")
    )

    ring = f"border: 2px solid {tones[Tone.BUSY]};"  # about what has the focus
    # a label of a tone has its colour whatever its style
    styles = ("", "#name", "#muted", "#detail", "#count", "#heading", "#gauge", "#value")
    tints = "".join(
        f'QLabel{name}[tone="{tone}"] {{ color: {colour}; }}\n'
        for tone, colour in tones.items()
        for name in styles
    ) + "".join(
        f'QLabel#badge[tone="{tone}"] {{ background: {colour}; }}\n'
        for tone, colour in tones.items()
    )
    # and the name of a quantity that of its curves
    tints += "".join(
        f'QLabel#name[quantity="{name}"] {{ color: {p.role(name)}; }}\n' for name in QUANTITIES
    )

    def points(share: float) -> str:
        return f"{share * size:.3g}pt"

    return f"""
QMainWindow, QWidget#body, QDialog {{ background: {p.window}; }}
QWidget {{ color: {p.text}; font-size: {points(1.0)}; }}
QFrame#panel {{ background: {p.panel}; border: 1px solid {p.edge}; border-radius: 6px; }}
QLabel {{ background: transparent; border: none; }}
QLabel#title {{ font-size: {points(1.25)}; font-weight: 600; }}
QLabel#muted, QLabel#name {{ color: {p.muted}; font-size: {points(0.95)}; }}
QLabel#value, QLabel#old {{ font-size: {points(1.55)}; font-weight: 600; }}
QLabel#old {{ color: {p.muted}; }}
QLabel#gauge {{ font-size: {points(2.0)}; font-weight: 600; }}
QLabel#detail {{ color: {p.muted}; font-size: {points(0.95)}; }}
QLabel#count {{ font-size: {points(1.1)}; font-weight: 600; }}
QLabel#notice, QLabel#fault {{ font-size: {points(1.15)}; }}
QLabel#fault {{ font-weight: 600; color: {tones[Tone.BAD]}; }}
QLabel#heading {{ font-size: {points(1.0)}; font-weight: 600; }}
QLabel#badge {{ color: {p.window}; border-radius: 4px; padding: 2px 10px; font-weight: 700; }}
QPushButton {{ background: {p.button}; border: 1px solid {p.edge}; border-radius: 5px;
    padding: 8px 16px; }}
QPushButton:hover {{ background: {hover}; }}
QPushButton:focus {{ {ring} padding: 7px 15px; }}
QPushButton:disabled {{ color: {p.grid}; background: {off}; border-color: {p.edge}; }}
QPushButton#start {{ background: {start}; border-color: {start_edge}; color: {start_text};
    font-weight: 600; }}
QPushButton#start:disabled {{ background: {off}; border-color: {p.edge}; color: {p.grid}; }}
QPushButton#stop_motion {{ background: #c8202b; border: 2px solid #ff6b6b; border-radius: 6px;
    color: white; font-size: {points(1.55)}; font-weight: 700; padding: 6px 24px; }}
QPushButton#stop_motion:hover {{ background: #d02732; }}
QPushButton#stop_motion:pressed {{ background: #8f141d; }}
QToolButton {{ background: transparent; border: 1px solid transparent; border-radius: 4px;
    padding: 1px 5px; color: {p.muted}; }}
QToolButton:hover {{ background: {hover}; color: {p.text}; border-color: {p.edge}; }}
QToolButton:focus {{ {ring} padding: 0 4px; color: {p.text}; }}
QToolButton::menu-indicator {{ image: none; }}
QProgressBar {{ background: {p.window}; border: 1px solid {p.edge}; border-radius: 4px;
    height: 12px; }}
QProgressBar::chunk {{ background: {tones[Tone.BUSY]}; border-radius: 3px; }}
QProgressBar#queue[tone="warn"]::chunk {{ background: {tones[Tone.WARN]}; }}
QProgressBar#queue[tone="bad"]::chunk {{ background: {tones[Tone.BAD]}; }}
QProgressBar#queue::chunk {{ background: {tones[Tone.GOOD]}; }}
QCheckBox {{ spacing: 6px; border: 2px solid transparent; }}
QCheckBox::indicator {{ width: 12px; height: 12px; border: 1px solid {p.muted};
    border-radius: 3px; background: {p.window}; }}
QCheckBox::indicator:checked {{ background: {tones[Tone.BUSY]}; border-color: {tones[Tone.BUSY]};
    image: url("{ICONS}/tick.svg"); }}
QComboBox, QSpinBox, QDoubleSpinBox {{ background: {p.window}; color: {p.text};
    border: 1px solid {p.edge}; border-radius: 3px; padding: 1px 6px; min-width: 34px; }}
QComboBox::drop-down {{ border: none; width: 16px; }}
QComboBox::down-arrow {{ image: url("{ICONS}/down.svg"); width: 8px; height: 8px; }}
QAbstractSpinBox::up-button, QAbstractSpinBox::down-button {{ border: none; width: 16px; }}
QAbstractSpinBox::up-arrow {{ image: url("{ICONS}/up.svg"); width: 8px; height: 8px; }}
QAbstractSpinBox::down-arrow {{ image: url("{ICONS}/down.svg"); width: 8px; height: 8px; }}
QComboBox:focus {{ border-color: {tones[Tone.BUSY]}; }}
QSpinBox:focus, QDoubleSpinBox:focus {{ {ring} padding: 0 5px; }}
QCheckBox:focus, QSlider:focus {{ {ring} }}
QSlider {{ border: 2px solid transparent; }}
QComboBox QAbstractItemView::item:disabled {{ color: {p.grid}; }}
QComboBox QAbstractItemView {{ background: {p.panel}; color: {p.text};
    selection-background-color: {hover}; selection-color: {p.text}; }}
QLineEdit, QPlainTextEdit, QTextBrowser {{ background: {p.window}; color: {p.text};
    border: 1px solid {p.edge}; border-radius: 3px; padding: 2px 4px;
    selection-background-color: {tones[Tone.BUSY]}; }}
QLineEdit:disabled {{ color: {p.grid}; background: {off}; }}
QLineEdit:focus, QPlainTextEdit:focus {{ {ring} padding: 1px 3px; }}
QToolButton#framed {{ background: {p.button}; border: 1px solid {p.edge}; border-radius: 4px;
    padding: 3px 8px; color: {p.text}; }}
QToolButton#framed:hover, QToolButton#framed:checked {{ background: {hover}; }}
QToolButton#bare {{ padding: 2px; }}
QToolButton#framed:focus {{ {ring} padding: 2px 7px; }}
QToolButton#bare:focus {{ {ring} padding: 1px; }}
QWidget#page {{ background: {p.panel}; }}
QScrollBar {{ background: transparent; border: none; }}
QScrollBar:vertical {{ width: 10px; }}
QScrollBar:horizontal {{ height: 10px; }}
QScrollBar::handle {{ background: {p.grid}; border-radius: 4px; min-height: 24px;
    min-width: 24px; }}
QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
QSlider::groove:horizontal {{ height: 4px; background: {p.edge}; border-radius: 2px; }}
QSlider::handle:horizontal {{ width: 14px; height: 14px; margin: -5px 0; border-radius: 7px;
    background: {p.muted}; }}
QSplitter::handle {{ background: {p.window}; }}
QMenuBar, QMenu, QStatusBar {{ background: {p.window}; }}
QMenuBar::item:selected, QMenu::item:selected {{ background: {hover}; }}
QMenu::item:disabled {{ color: {p.grid}; }}
QMenu {{ border: 1px solid {p.edge}; }}
QStatusBar::item {{ border: none; }}
QDockWidget::title {{ background: {p.panel}; padding: 4px 8px; }}
QTabBar {{ qproperty-drawBase: 0; }}
QTabBar::tear {{ width: 0; border: none; }}
QTabBar QToolButton {{ background: {p.panel}; border: 1px solid {p.edge}; border-radius: 0; }}
QTabBar::tab {{ background: {p.panel}; color: {p.muted}; border: 1px solid {p.edge};
    padding: 4px 10px; }}
QTabBar::tab:selected {{ background: {p.edge}; color: {p.text}; }}
QTabBar::tab:focus {{ {ring} padding: 3px 9px; }}
QScrollArea, QScrollArea > QWidget > QWidget {{ background: {p.window}; border: none; }}
QListView {{ background: {p.window}; border: 1px solid {p.edge}; }}
QListWidget, QTreeView, QTableView {{
    background: {p.window}; border: 1px solid {p.edge}; padding: 1px; }}
QListWidget:focus, QTreeView:focus, QTableView:focus {{
    {ring} padding: 0; }}
QTreeView#rows::item {{ padding: 3px 0; }}
QHeaderView::section {{ background: {p.panel}; border: 1px solid {p.edge}; padding: 3px 6px; }}
{tints}
QLineEdit[tone="bad"], QPlainTextEdit[tone="bad"] {{ border-color: {tones[Tone.BAD]}; }}
QToolTip {{ background: {p.panel}; color: {p.text}; border: 1px solid {p.edge}; padding: 4px; }}
"""
