"""The curves of a loading experiment: Q(delta), c(Q), and P and Q against time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QGridLayout, QLabel, QSizePolicy, QVBoxLayout, QWidget

from analysis.options import as_written
from app.gui import theme
from app.gui.view_state import Curves, ForceView, Scene, StressView, ViewState
from app.results import F64, Summary

STRIP_STEP_S = 0.2


def cattaneo_mindlin(summary: Summary, points: int = 200) -> tuple[F64, F64]:
    """Q (newtons) and the stick radius c (mm) that Cattaneo and Mindlin's model gives with mu P =
    Q_s; empty where Q_s is unknown.

    References
    ----------
    Prevost et al. 2013, section 4: c = a_H (1 - Q / (mu P))^(1/3).
    """
    if not (math.isfinite(summary.static_force_n) and math.isfinite(summary.hertz_radius_m)):
        return np.empty(0), np.empty(0)
    share = 1 - np.linspace(1.0, 0.0, points) ** 3  # evenly spaced in c
    return summary.static_force_n * share, summary.hertz_radius_m * 1e3 * np.cbrt(1 - share)


class CurvesView(QWidget):
    """Loading curve and stick radius above the shear traction and the two force strips."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._loading: Curves | None = None
        self._curves: Curves | None = None
        self._forces: ForceView | None = None
        self._stress: StressView | None = None
        self.loading = theme.plot_widget("travel δ (µm)", "shear force Q (N)")
        self.loading_curve = self.loading.plot(pen=pg.mkPen(theme.SHEAR, width=2), antialias=True)
        self.static_line = _guide(self.loading, 0, "Qₛ")
        self.sticking = theme.plot_widget("shear force Q (N)", "stick radius c (mm)")
        self._build_sticking()
        self.stress = theme.plot_widget("distance from the centre r (mm)", "shear traction σ (kPa)")
        self._build_stress()
        self.normal = theme.plot_widget("", "P (N)")
        self.normal_curve = self.normal.plot(pen=pg.mkPen(theme.NORMAL, width=1))
        self.shear = theme.plot_widget("time (s)", "Q (N)")
        self.shear_curve = self.shear.plot(pen=pg.mkPen(theme.SHEAR, width=1))
        self.onset_line = _guide(self.shear, 90, "tₛ")
        self.shear.setXLink(self.normal)
        for strip in (self.normal, self.shear):
            strip.getPlotItem().getAxis("left").setWidth(58)
        self.normal.getPlotItem().getAxis("bottom").setStyle(showValues=False)
        self._build_layout()

    def show_scene(self, scene: Scene) -> None:
        """Empty the curves for a new run; the travel axis spans the travel asked for."""
        self._loading = self._curves = self._forces = None
        for curve in (
            self.loading_curve,
            self.stick_curve,
            self.stick_low,
            self.stick_high,
            self.peak_curve,
            self.model_curve,
        ):
            curve.setData([], [])
        for curve in (self.normal_curve, self.shear_curve):
            curve.setData([], [])
        self._empty_stress()
        for line in (self.static_line, self.onset_line, self.apparent_line):
            line.hide()
        self.sticking.enableAutoRange(y=True)
        self.loading.setXRange(0, as_written(scene.config.run)["travel"], padding=0.03)

    def _empty_stress(self) -> None:
        self._stress = None
        for curve in (self.stress_low, self.stress_high, self.stress_curve, self.stress_model):
            curve.setData([], [])
        for line in (self.stick_line, self.peak_line):
            line.hide()
        self.stress_caption.setText("")

    @property
    def parts(self) -> tuple[Callable[[ViewState], None], ...]:
        """What draws each plot, where it changed since its last call; one after the other, so that
        a key need not wait for all.
        """
        return self._show_loading, self._show_sticking, self._show_traction, self._show_strips

    def _show_loading(self, view: ViewState) -> None:
        if view.curves is not self._loading:
            self._loading = view.curves
            self.loading_curve.setData(view.curves.travel_um, view.curves.shear_n)
        if view.summary is not None:
            _show_line(self.static_line, view.summary.static_force_n)

    def _show_sticking(self, view: ViewState) -> None:
        if view.curves is not self._curves:
            self._show_curves(view.curves)
        if math.isfinite(view.apparent_mm) and not self.apparent_line.isVisible():
            _show_line(self.apparent_line, view.apparent_mm)
            self.sticking.setYRange(0, 1.15 * view.apparent_mm, padding=0)
        if view.summary is not None:
            self.model_curve.setData(*cattaneo_mindlin(view.summary))

    def _show_traction(self, view: ViewState) -> None:
        if view.stress is self._stress:
            return
        if view.stress is not None:
            self._show_stress(view.stress)
            return
        self._empty_stress()

    def _show_strips(self, view: ViewState) -> None:
        if view.ended or self._strips_are_old(view.forces):
            self._show_forces(view.forces)
        if view.summary is not None:
            _show_line(self.onset_line, view.summary.onset_time_s)

    def _show_curves(self, curves: Curves) -> None:
        self._curves = curves
        order = np.argsort(curves.stick_shear_n, kind="stable")
        shear, stick, sd = (
            curves.stick_shear_n[order],
            curves.stick_mm[order],
            curves.stick_sd_mm[order],
        )
        self.stick_curve.setData(shear, stick)
        self.stick_low.setData(shear, stick - sd)
        self.stick_high.setData(shear, stick + sd)
        self.peak_curve.setData(curves.peak_shear_n, curves.peak_mm)

    def _show_stress(self, stress: StressView) -> None:
        self._stress = stress
        r, sigma, sd = stress.radius_mm, stress.stress_kpa, np.nan_to_num(stress.sd_kpa)
        self.stress_curve.setData(r, sigma)
        self.stress_low.setData(r, sigma - sd)
        self.stress_high.setData(r, sigma + sd)
        self.stress_model.setData(r, stress.model_kpa, connect="finite")
        for line, value in ((self.stick_line, stress.stick_mm), (self.peak_line, stress.peak_mm)):
            line.setVisible(math.isfinite(value))
            if math.isfinite(value):
                line.setValue(value)
        self.stress_caption.setText(stress.caption)

    def _strips_are_old(self, forces: ForceView) -> bool:
        """Whether the strips lag enough to be worth drawing; the two of them are the dearest part
        of a refresh.
        """
        shown = self._forces
        if shown is None or not len(shown.time_s) or shown.time_label != forces.time_label:
            return bool(len(forces.time_s))
        return bool(forces.time_s[-1] - shown.time_s[-1] >= STRIP_STEP_S)

    def _show_forces(self, forces: ForceView) -> None:
        self._forces = forces
        self.normal_curve.setData(forces.time_s, forces.normal_n)
        self.shear_curve.setData(forces.time_s, forces.shear_n)
        axis = self.shear.getPlotItem().getAxis("bottom")
        if axis.labelText != forces.time_label:
            axis.setLabel(forces.time_label)
            axis.resizeEvent()  # puts the longer label back in the middle

    def _build_sticking(self) -> None:
        colour = pg.mkColor(theme.STICK)
        self.stick_low = pg.PlotCurveItem(pen=None)
        self.stick_high = pg.PlotCurveItem(pen=None)
        band = pg.FillBetweenItem(
            self.stick_low,
            self.stick_high,
            brush=pg.mkBrush(colour.red(), colour.green(), colour.blue(), 70),
        )
        self.stick_curve = pg.PlotDataItem(
            pen=None,
            symbol="o",
            symbolSize=4,
            symbolBrush=theme.STICK,
            symbolPen=None,
            antialias=True,
            name="c of uₓ ± sd",
        )
        self.peak_curve = pg.PlotDataItem(
            pen=None,
            symbol="+",
            symbolSize=5,
            symbolBrush=None,
            symbolPen=theme.SHEAR,
            name="largest σ",
        )
        self.model_curve = pg.PlotDataItem(
            pen=pg.mkPen(theme.MODEL, width=1.5), antialias=True, name="Cattaneo–Mindlin, μP = Qₛ"
        )
        self.apparent_line = _guide(self.sticking, 0, "a")
        legend = self.sticking.addLegend(
            offset=(8, -8), labelTextColor=theme.MUTED, labelTextSize="8.5pt"
        )
        for item in (self.stick_low, self.stick_high, band):
            self.sticking.addItem(item, ignoreBounds=True)
        for item in (self.peak_curve, self.stick_curve, self.model_curve):
            self.sticking.addItem(item)
        self.model_curve.setZValue(-1)
        legend.setBrush(pg.mkBrush(28, 32, 39, 200))
        self.sticking.getPlotItem().getViewBox().setLimits(yMin=0)

    def _build_stress(self) -> None:
        colour = pg.mkColor(theme.SHEAR)
        self.stress_low, self.stress_high = pg.PlotCurveItem(pen=None), pg.PlotCurveItem(pen=None)
        band = pg.FillBetweenItem(
            self.stress_low,
            self.stress_high,
            brush=pg.mkBrush(colour.red(), colour.green(), colour.blue(), 70),
        )
        self.stress_curve = pg.PlotDataItem(
            pen=pg.mkPen(theme.SHEAR, width=2), antialias=True, name="inverted ± sd"
        )
        self.stress_model = pg.PlotDataItem(
            pen=pg.mkPen(theme.MODEL, width=1.5), antialias=True, name="Cattaneo–Mindlin, c of uₓ"
        )
        legend = self.stress.addLegend(
            offset=(8, -8), labelTextColor=theme.MUTED, labelTextSize="8.5pt"
        )
        legend.setBrush(pg.mkBrush(28, 32, 39, 200))
        for item in (self.stress_low, self.stress_high, band):
            self.stress.addItem(item, ignoreBounds=True)
        for item in (self.stress_curve, self.stress_model):
            self.stress.addItem(item)
        self.stick_line, self.peak_line = (
            _guide(self.stress, 90, "c"),
            _guide(self.stress, 90, "max σ"),
        )

    def _build_layout(self) -> None:
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(8)
        grid.addWidget(_titled("Loading curve Q(δ)", self.loading), 0, 0)
        grid.addWidget(_titled("Stick radius c(Q)", self.sticking), 0, 1)
        self.stress_caption = QLabel("")
        grid.addWidget(
            _titled("Shear traction σ(r)", self.stress, caption=self.stress_caption), 1, 0
        )
        grid.addWidget(_titled("Forces", self.normal, self.shear), 1, 1)
        for k in (0, 1):
            grid.setRowStretch(k, 1)
            grid.setColumnStretch(k, 1)


def _show_line(line: Any, value: float) -> None:
    if math.isfinite(value):
        line.setValue(value)
        line.show()


def _guide(plot: Any, angle: int, text: str) -> Any:
    """A hidden dashed line across `plot`, named in the margin."""
    line = pg.InfiniteLine(
        angle=angle,
        pen=pg.mkPen(theme.APPARENT, width=1, style=Qt.PenStyle.DashLine),
        label=text,
        labelOpts={
            "position": 0.06 if angle == 0 else 0.3,
            "color": theme.TEXT,
            "anchors": [(0, 1), (0, 1)],
        },
    )
    line.hide()
    plot.addItem(line, ignoreBounds=True)
    return line


def _titled(title: str, *plots: Any, caption: QLabel | None = None) -> QFrame:
    frame = QFrame()
    frame.setObjectName("panel")
    heading = QLabel(title)
    heading.setObjectName("heading")
    layout = QVBoxLayout(frame)
    layout.setContentsMargins(12, 8, 12, 8)
    layout.setSpacing(4)
    layout.addWidget(heading)
    if caption is not None:
        caption.setObjectName("muted")
        # a long one is cut, not the plots beside it
        caption.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        layout.addWidget(caption)
    for plot in plots:
        plot.setMinimumHeight(90)
        layout.addWidget(plot, 1)
    return frame
