"""The curves of a loading experiment: Q(delta), c(Q), sigma(r), and P and Q against time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLabel, QSizePolicy, QWidget

from app.gui import theme
from app.gui.frame_results import TractionProfile
from app.gui.run_curves import ForceStrips, model_curve
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import Panel, column, label
from app.records import F64
from app.steps import reach

STRIP_STEP_S = 0.2  # the strips are redrawn for so much more: they take most of a redraw's time
NOTHING: F64 = np.empty(0)


class Band:
    """A band of one standard uncertainty on either side of a curve in `plot`."""

    def __init__(self, plot: Any, colour: str) -> None:
        self.low, self.high = pg.PlotCurveItem(pen=None), pg.PlotCurveItem(pen=None)
        faint = pg.mkColor(colour)
        faint.setAlpha(70)
        between = pg.FillBetweenItem(self.low, self.high, brush=pg.mkBrush(faint))
        for item in (self.low, self.high, between):
            plot.addItem(item, ignoreBounds=True)

    def show(self, x: F64, y: F64, sd: F64) -> None:
        """Draw the band about y(x)."""
        self.low.setData(x, y - sd)
        self.high.setData(x, y + sd)


class CurvesView(QWidget):
    """Loading curve and stick radius above the shear traction and the two force strips."""

    def __init__(self) -> None:
        super().__init__()
        # what is drawn
        self._loading: F64 | None = None
        self._sticking: F64 | None = None
        self._forces: ForceStrips | None = None
        self._profile: TractionProfile | None = None
        self._build_loading()
        self._build_sticking()
        self._build_traction()
        self._build_strips()
        self._build_layout()

    def show_setup(self, setup: Setup) -> None:
        """Empty the curves for a new run; the travel axis spans the travel of the drive."""
        self._loading = self._sticking = self._forces = None
        for plot in (self.loading, self.sticking, self.traction, self.normal, self.shear):
            for curve in plot.getPlotItem().listDataItems():
                curve.setData([], [])
        self.stick_band.show(NOTHING, NOTHING, NOTHING)
        self._show_profile(None)
        for line in (self.static_line, self.onset_line, self.apparent_line):
            line.hide()
        self.sticking.enableAutoRange(y=True)
        low, high = reach(setup.config.run.protocol)
        furthest = max(high, -low)  # along the drive, as it is plotted
        self.loading.setXRange(0, furthest * 1e6, padding=0.03)

    @property
    def parts(self) -> tuple[Callable[[ViewState], None], ...]:
        """One function for each plot, which draws it if it has changed.

        They are called one by one, so that a key need not wait for all of them.
        """
        return self._draw_loading, self._draw_sticking, self._draw_traction, self._draw_strips

    def _draw_loading(self, view: ViewState) -> None:
        if view.curves.loading is not self._loading:
            self._loading = view.curves.loading
            self.loading_curve.setData(*view.curves.loading.T)
        if view.summary is not None:
            _move_line(self.static_line, view.summary.static_force_n)

    def _draw_sticking(self, view: ViewState) -> None:
        curves, apparent_mm = view.curves, view.circles.apparent_mm
        if curves.sticking is not self._sticking:
            self._sticking = curves.sticking
            order = np.argsort(curves.sticking[:, 0], kind="stable")
            shear_n, stick_mm, sd_mm = curves.sticking[order].T
            self.stick_curve.setData(shear_n, stick_mm)
            self.stick_band.show(shear_n, stick_mm, sd_mm)
            self.peak_curve.setData(*curves.peaks.T)
        if math.isfinite(apparent_mm) and not self.apparent_line.isVisible():
            _move_line(self.apparent_line, apparent_mm)
            self.sticking.setYRange(0, 1.15 * apparent_mm, padding=0)
        if view.summary is not None:
            self.model_curve.setData(*model_curve(view.summary))

    def _draw_traction(self, view: ViewState) -> None:
        profile = view.frame.profile if view.frame else None
        if profile is not self._profile:
            self._show_profile(profile)

    def _show_profile(self, profile: TractionProfile | None) -> None:
        self._profile = profile
        r = sigma = sd = model = NOTHING
        if profile is not None:
            r, sigma, model = profile.radius_mm, profile.stress_kpa, profile.model_kpa
            sd = np.nan_to_num(profile.sd_kpa)
        self.stress_curve.setData(r, sigma)
        self.stress_band.show(r, sigma, sd)
        self.stress_model.setData(r, model, connect="finite")
        _move_line(self.stick_line, profile.stick_mm if profile else math.nan)
        _move_line(self.peak_line, profile.peak_mm if profile else math.nan)
        self.traction_caption.setText(profile.caption if profile else "")

    def _draw_strips(self, view: ViewState) -> None:
        if view.ended or self._strips_are_old(view.forces):
            self._forces = view.forces
            self.normal_curve.setData(view.forces.time_s, view.forces.normal_n)
            self.shear_curve.setData(view.forces.time_s, view.forces.shear_n)
            axis = self.shear.getPlotItem().getAxis("bottom")
            if axis.labelText != view.forces.time_label:
                axis.setLabel(view.forces.time_label)
                axis.resizeEvent()  # centres the new label
        if view.summary is not None:
            _move_line(self.onset_line, view.summary.onset_time_s)

    def _strips_are_old(self, forces: ForceStrips) -> bool:
        shown = self._forces
        if shown is None or not len(shown.time_s) or shown.time_label != forces.time_label:
            return bool(len(forces.time_s))
        return bool(forces.time_s[-1] - shown.time_s[-1] >= STRIP_STEP_S)

    def _build_loading(self) -> None:
        self.loading = theme.plot_widget("travel δ (µm)", "shear force Q (N)")
        self.loading_curve = self.loading.plot(pen=pg.mkPen(theme.SHEAR, width=2), antialias=True)
        self.static_line = _guide(self.loading, 0, "Qₛ")

    def _build_sticking(self) -> None:
        self.sticking = theme.plot_widget("shear force Q (N)", "stick radius c (mm)")
        filled = {"symbol": "o", "symbolSize": 4, "symbolBrush": theme.STICK, "symbolPen": None}
        crosses = {"symbol": "+", "symbolSize": 5, "symbolBrush": None, "symbolPen": theme.SHEAR}
        self.stick_curve = pg.PlotDataItem(
            pen=None, antialias=True, name="fitted profile ± sd", **filled
        )
        self.peak_curve = pg.PlotDataItem(pen=None, name="c: largest σ", **crosses)
        self.model_curve = _model_curve("Cattaneo–Mindlin, μP = Qₛ")
        self.apparent_line = _guide(self.sticking, 0, "a")
        _add_legend(self.sticking)
        self.stick_band = Band(self.sticking, theme.STICK)
        for curve in (self.peak_curve, self.stick_curve, self.model_curve):
            self.sticking.addItem(curve)
        self.model_curve.setZValue(-1)
        self.sticking.getPlotItem().getViewBox().setLimits(yMin=0)

    def _build_traction(self) -> None:
        self.traction = theme.plot_widget(
            "distance from the centre r (mm)", "shear traction σ (kPa)"
        )
        _add_legend(self.traction)
        pen = pg.mkPen(theme.SHEAR, width=2)
        self.stress_curve = pg.PlotDataItem(pen=pen, antialias=True, name="inverted ± sd")
        self.stress_model = _model_curve("Cattaneo–Mindlin, fitted")
        self.stress_band = Band(self.traction, theme.SHEAR)
        for curve in (self.stress_curve, self.stress_model):
            self.traction.addItem(curve)
        self.stick_line = _guide(self.traction, 90, "fit")
        self.peak_line = _guide(self.traction, 90, "c")
        self.traction_caption = label("", "muted")
        # a long caption is cut short instead of making the plot wider
        self.traction_caption.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)

    def _build_strips(self) -> None:
        self.normal = theme.plot_widget("", "P (N)")
        self.normal_curve = self.normal.plot(pen=pg.mkPen(theme.NORMAL, width=1))
        self.shear = theme.plot_widget("time (s)", "Q (N)")
        self.shear_curve = self.shear.plot(pen=pg.mkPen(theme.SHEAR, width=1))
        self.onset_line = _guide(self.shear, 90, "tₛ")
        self.shear.setXLink(self.normal)
        for strip in (self.normal, self.shear):
            strip.getPlotItem().getAxis("left").setWidth(58)
        self.normal.getPlotItem().getAxis("bottom").setStyle(showValues=False)

    def _build_layout(self) -> None:
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(8)
        grid.addWidget(_titled("Loading curve Q(δ)", self.loading), 0, 0)
        grid.addWidget(_titled("Stick radius c(Q)", self.sticking), 0, 1)
        traction = _titled("Shear traction σ(r)", self.traction, caption=self.traction_caption)
        grid.addWidget(traction, 1, 0)
        grid.addWidget(_titled("Forces", self.normal, self.shear), 1, 1)
        for k in (0, 1):
            grid.setRowStretch(k, 1)
            grid.setColumnStretch(k, 1)


def _model_curve(name: str) -> Any:
    return pg.PlotDataItem(pen=pg.mkPen(theme.MODEL, width=1.5), antialias=True, name=name)


def _add_legend(plot: Any) -> None:
    """A legend in the lower left corner, for the curves that are added to `plot` from now on."""
    legend = plot.addLegend(offset=(8, -8), labelTextColor=theme.MUTED, labelTextSize="8.5pt")
    legend.setBrush(pg.mkBrush(28, 32, 39, 200))


def _guide(plot: Any, angle: int, text: str) -> Any:
    """A dashed line across `plot` with its name beside it, hidden until it is moved."""
    place = {"position": 0.06 if angle == 0 else 0.3, "anchors": [(0, 1), (0, 1)]}
    line = pg.InfiniteLine(
        angle=angle,
        pen=pg.mkPen(theme.APPARENT, width=1, style=Qt.PenStyle.DashLine),
        label=text,
        labelOpts={"color": theme.TEXT, **place},
    )
    line.hide()
    plot.addItem(line, ignoreBounds=True)
    return line


def _move_line(line: Any, value: float) -> None:
    """Move a guide to `value`; NaN hides it."""
    line.setVisible(math.isfinite(value))
    if math.isfinite(value):
        line.setValue(value)


def _titled(title: str, *plots: Any, caption: QLabel | None = None) -> Panel:
    panel = Panel()
    rows = column(label(title, "heading"), spacing=4, margins=(12, 8, 12, 8))
    if caption is not None:
        rows.addWidget(caption)
    for plot in plots:
        plot.setMinimumHeight(90)
        rows.addWidget(plot, 1)
    panel.setLayout(rows)
    return panel
