"""What `plot` of a session and of a field draws: data, units, signs and labels."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from numpy.testing import assert_allclose
from session_material import OUTCOME, Session as Written

from slipscope import Session


@pytest.fixture(autouse=True)
def without_a_window() -> Iterator[None]:
    with mpl.rc_context({"backend": "agg"}):
        yield
        pyplot.close("all")


def test_a_field_is_drawn_in_micrometres_over_millimetres(session: Written) -> None:
    with Session(session.path) as s:
        field = s.fields[4]
        axes = field.plot()
    (image,), (bar,) = axes.images, axes.child_axes
    drawn = np.ma.filled(image.get_array(), np.nan)
    assert_allclose(drawn, 1e6 * field.ux_m, rtol=1e-6)
    assert np.isnan(drawn[0, 1])  # not measured
    half = 4.0 / 2 * 7.04e-3  # the boxes are 4 px apart, a pixel is 7.04 um wide
    x_mm, y_mm = (np.array(px) * 7.04e-3 for px in ((4.5, 12.5), (3.5, 7.5)))
    assert_allclose(
        image.get_extent(), (x_mm[0] - half, x_mm[1] + half, y_mm[1] + half, y_mm[0] - half)
    )
    bottom, top = axes.get_ylim()
    assert bottom > top  # y counts downwards, as in the picture
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$x$ (mm)", "$y$ (mm)")
    assert bar.get_ylabel() == "$u_x$ (µm)"
    assert axes.get_title() == "frame 6"
    assert not axes.lines  # no cut: its place is the contact's centre, which is not that of y = 0


def test_u_y_is_drawn_about_0_into_given_axes(session: Written) -> None:
    _, axes = pyplot.subplots()
    with Session(session.path) as s:
        field = s.fields[-1]
        assert field.plot("y", axes) is axes
    (image,) = axes.images
    assert_allclose(np.ma.filled(image.get_array(), np.nan), 1e6 * field.uy_m, rtol=1e-6)
    low, high = image.get_clim()
    assert low == -high < 0
    assert axes.child_axes[0].get_ylabel() == "$u_y$ (µm)"


def test_a_session_is_drawn_as_its_load_curve(session: Written) -> None:
    with Session(session.path) as s:
        axes = s.plot()
    curve, static, *numbers = axes.lines
    drive = [shot.conditions for shot in session.snapshots if shot.conditions.phase == "drive"]
    assert len(drive) == 4
    assert_allclose(curve.get_xdata(), [1e6 * now.travel_m for now in drive])
    assert_allclose(curve.get_ydata(), [now.shear_force_n for now in drive])
    assert OUTCOME.summary is not None
    assert_allclose(static.get_ydata(), OUTCOME.summary.static_force_n)
    assert numbers
    assert axes.get_xlabel() == r"stage displacement $\delta$ (µm)"
    assert axes.get_ylabel() == r"shear force $Q$ (N)"
    assert axes.get_title() == "session.h5"
    assert axes.figure.number in pyplot.get_fignums()  # so that a notebook shows it
