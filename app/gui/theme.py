"""The look of the window: dark, because benches are dim and the image must be seen."""

from __future__ import annotations

from typing import Any

import pyqtgraph as pg

from app.gui.cells import Tone

WINDOW = "#14171c"
PANEL = "#1c2027"
EDGE = "#2d333d"
TEXT = "#e4e7eb"
MUTED = "#98a2b0"
GRID = "#5b6573"

NORMAL = "#6cb2f0"  # P
SHEAR = "#f2b05e"  # Q
STICK = "#7fd68a"  # c
APPARENT = "#f1f3f5"  # a
MODEL = "#c6a8f0"  # closed forms

TONES = {
    Tone.NEUTRAL: MUTED,
    Tone.GOOD: "#52b788",
    Tone.BUSY: "#4f9fe8",
    Tone.WARN: "#e0a63a",
    Tone.BAD: "#f0655c",
    Tone.REPLAY: "#b48cf2",
}

# a label of a tone has its colour whatever its style
_TINTS = "".join(
    f'QLabel[tone="{tone}"], QLabel#name[tone="{tone}"], QLabel#muted[tone="{tone}"],'
    f' QLabel#detail[tone="{tone}"], QLabel#count[tone="{tone}"] {{ color: {colour}; }}\n'
    for tone, colour in TONES.items()
)
ALARM = """
QFrame#panel { background: #c8202b; border: 2px solid #ffb3b3; }
QLabel { color: white; font-size: 18px; font-weight: 700; }
"""

STYLE = f"""
QMainWindow, QWidget#body {{ background: {WINDOW}; }}
QWidget {{ color: {TEXT}; font-size: 13px; }}
QFrame#panel {{ background: {PANEL}; border: 1px solid {EDGE}; border-radius: 6px; }}
QLabel {{ background: transparent; border: none; }}
QLabel#title {{ font-size: 16px; font-weight: 600; }}
QLabel#muted, QLabel#name {{ color: {MUTED}; font-size: 12px; }}
QLabel#value {{ font-size: 20px; font-weight: 600; }}
QLabel#detail {{ color: {MUTED}; font-size: 12px; }}
QLabel#count {{ font-size: 14px; font-weight: 600; }}
QLabel#heading {{ font-size: 13px; font-weight: 600; }}
QPushButton {{ background: #2a303a; border: 1px solid #3b4350; border-radius: 5px;
    padding: 8px 16px; }}
QPushButton:hover {{ background: #343c48; }}
QPushButton:focus {{ border-color: #7fb4ec; }}
QPushButton:disabled {{ color: #626b78; background: #1f242b; border-color: {EDGE}; }}
QPushButton#start {{ background: #22603f; border-color: #2f8457; font-weight: 600; }}
QPushButton#start:hover {{ background: #2a744d; }}
QPushButton#start:disabled {{ background: #1f242b; border-color: {EDGE}; }}
QPushButton#stop_motion {{ background: #c8202b; border: 2px solid #ff6b6b; border-radius: 6px;
    color: white; font-size: 20px; font-weight: 700; padding: 6px 24px; }}
QPushButton#stop_motion:hover {{ background: #dd2c37; }}
QPushButton#stop_motion:pressed {{ background: #8f141d; }}
QProgressBar {{ background: #12151a; border: 1px solid {EDGE}; border-radius: 4px; height: 12px; }}
QProgressBar::chunk {{ background: {TONES[Tone.BUSY]}; border-radius: 3px; }}
QProgressBar#queue[tone="warn"]::chunk {{ background: {TONES[Tone.WARN]}; }}
QProgressBar#queue[tone="bad"]::chunk {{ background: {TONES[Tone.BAD]}; }}
QProgressBar#queue::chunk {{ background: {TONES[Tone.GOOD]}; }}
QCheckBox {{ spacing: 6px; }}
QCheckBox::indicator {{ width: 12px; height: 12px; border: 1px solid {MUTED}; border-radius: 3px;
    background: {WINDOW}; }}
QCheckBox::indicator:checked {{ background: {TONES[Tone.BUSY]}; border-color: {TONES[Tone.BUSY]}; }}
QComboBox {{ background: {WINDOW}; color: {TEXT}; border: 1px solid {EDGE}; border-radius: 3px;
    padding: 1px 6px; min-width: 34px; }}
QComboBox QAbstractItemView {{ background: {PANEL}; color: {TEXT};
    selection-background-color: {EDGE}; }}
QLineEdit, QPlainTextEdit {{ background: {WINDOW}; color: {TEXT}; border: 1px solid {EDGE};
    border-radius: 3px; padding: 2px 4px; selection-background-color: {TONES[Tone.BUSY]}; }}
QLineEdit:focus, QPlainTextEdit:focus, QComboBox:focus {{ border-color: #7fb4ec; }}
QToolButton#framed {{ background: #2a303a; border: 1px solid #3b4350; border-radius: 4px;
    padding: 3px 8px; }}
QToolButton#framed:hover, QToolButton#framed:checked {{ background: #343c48; }}
QToolButton#framed:focus {{ border-color: #7fb4ec; }}
QToolButton#framed::menu-indicator {{ image: none; }}
QToolButton#bare {{ background: transparent; border: 1px solid transparent; padding: 2px; }}
QToolButton#bare:hover {{ background: #2a303a; }}
QToolButton#bare:focus {{ border-color: #7fb4ec; }}
QWidget#page {{ background: {PANEL}; }}
QScrollBar {{ background: transparent; border: none; }}
QScrollBar:vertical {{ width: 10px; }}
QScrollBar:horizontal {{ height: 10px; }}
QScrollBar::handle {{ background: {GRID}; border-radius: 4px; min-height: 24px; min-width: 24px; }}
QScrollBar::add-line, QScrollBar::sub-line {{ width: 0; height: 0; }}
QSlider::groove:horizontal {{ height: 4px; background: {EDGE}; border-radius: 2px; }}
QSlider::handle:horizontal {{ width: 14px; height: 14px; margin: -5px 0; border-radius: 7px;
    background: {MUTED}; }}
QSplitter::handle {{ background: {WINDOW}; }}
QMenuBar, QMenu, QStatusBar {{ background: {WINDOW}; }}
QMenuBar::item:selected, QMenu::item:selected {{ background: {EDGE}; }}
QMenu::item:disabled {{ color: #626b78; }}
QMenu {{ border: 1px solid {EDGE}; }}
QStatusBar::item {{ border: none; }}
QDockWidget::title {{ background: {PANEL}; padding: 4px 8px; }}
QTabBar {{ qproperty-drawBase: 0; }}
QTabBar::tab {{ background: {PANEL}; color: {MUTED}; border: 1px solid {EDGE}; padding: 4px 10px; }}
QTabBar::tab:selected {{ background: {EDGE}; color: {TEXT}; }}
QScrollArea, QScrollArea > QWidget > QWidget {{ background: {WINDOW}; border: none; }}
QSpinBox, QDoubleSpinBox, QListView, QTreeView, QTableView {{
    background: {WINDOW}; border: 1px solid {EDGE}; }}
QHeaderView::section {{ background: {PANEL}; border: 1px solid {EDGE}; padding: 3px 6px; }}
{_TINTS}
QLineEdit[tone="bad"], QPlainTextEdit[tone="bad"] {{ border-color: {TONES[Tone.BAD]}; }}
QToolTip {{ background: {PANEL}; color: {TEXT}; border: 1px solid {EDGE}; padding: 4px; }}
"""


def displacement_map() -> Any:
    """Blue for negative values, near-white for 0, red for positive ones, perceptually uniform."""
    return pg.colormap.get("CET-D1")


def plot_widget(bottom: str, left: str) -> Any:
    """An empty plot with these axis labels, which name the units."""
    widget = pg.PlotWidget(background=PANEL)
    plot = widget.getPlotItem()
    for side, text in (("bottom", bottom), ("left", left)):
        axis = plot.getAxis(side)
        axis.enableAutoSIPrefix(False)
        axis.setLabel(text, **{"color": TEXT, "font-size": "9.5pt"})
        axis.setPen(GRID)
        axis.setTextPen(MUTED)
        # each grid line is blended over the plot: minor ones make a repaint take four times as long
        axis.setStyle(maxTickLevel=0)
    plot.showGrid(x=True, y=True, alpha=0.18)
    plot.setMenuEnabled(False)
    return widget
