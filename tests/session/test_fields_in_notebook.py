"""Fields and images of a `Session` as arrays (t, y, x), and what is computed of a field: traction
and strain, against closed forms.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from session_material import CONTACT, Session as Written, make_snapshot

from analysis import cattaneo_mindlin, hertz
from analysis.undistorted import ideal_displacement, ideal_places
from app.evaluation.setup import header_of
from app.records.record_types import DisplacementField, FrameMotion
from app.session.reader import SessionReader
from app.session.recorder import SessionRecorder
from app.settings import config
from app.settings.config import settings_of
from app.study import instants
from drivers.protocols import Frame
from slipscope import Results, Session, UserError

SMALL = ("camera.width=480", "camera.height=400", "camera.pixel=20", "dic.step=10")
P, MU, E, NU, R, D_M, LENS_M = 0.5, 0.9, 3.43e6, 0.5, 0.1288, 12e-6, 1e-6
CENTRE_PX = 240.0, 200.0


# ------------------------------------------------------------------ arrays


def test_fields_are_an_array_of_rows(session: Written) -> None:
    with Session(session.path) as s:
        fields = list(s.fields)
        assert s.fields.shape == (6, 2, 3)
        assert [field.frame for field in fields] == [x.frame for x in session.snapshots]
        assert_array_equal(s.fields.measured, [2, 3, 4, 5])
        assert np.isnan(fields[0].ux_m).all()
        assert_array_equal(fields[3].ux_m, s.fields[3].ux_m)
        held = s.fields.ux_m
        assert (held.shape, held.dtype, held.ndim, len(held)) == ((6, 2, 3), float, 3, 6)
        whole = np.stack([field.ux_m for field in fields])
        assert_array_equal(np.asarray(held), whole)
        for key in ((2, 1), np.s_[1:4, :, 2], np.s_[..., 0], np.s_[-1], np.s_[4:2, 0], [2, 5]):
            assert_array_equal(held[key], whole[key])
        part = s.fields[2:5]
        assert (part.shape, len(part), part[0].frame) == ((3, 2, 3), 3, fields[2].frame)
        assert_array_equal(part[1:].uy_m[:], [field.uy_m for field in fields[3:5]])
        known = s.fields[s.fields.measured]
        assert_array_equal(known.ux_sd_m[:], [field.ux_sd_m for field in fields[2:]])
        assert_array_equal(known[np.array([True, False, False, True])].measured, [0, 1])
        assert known.zncc[:].dtype == known.zncc.dtype == np.float32
        assert repr(s.fields) == "<Fields of shape (6, 2, 3), 4 measured>"
        assert repr(s.fields[-1]).endswith(", shape (2, 3)>")
        with pytest.raises(IndexError, match="there is no field 3; there are 3"):
            _ = part.ux_m[3]


def test_images_are_an_array(session: Written) -> None:
    with Session(session.path) as s:
        assert (s.frames.shape, s.frames.dtype, s.frames.ndim) == ((8, 12, 16), np.uint8, 3)
        images = list(session.images.values())
        assert_array_equal(s.frames[s.frames.received], images)
        assert_array_equal(s.frames[4:, 3:5, -1], np.array(images[3:])[:, 3:5, -1])
        with pytest.raises(UserError, match="frame 3 was lost"):
            np.asarray(s.frames)
        dask = pytest.importorskip("dask.array")
        lazy = dask.from_array(s.frames, chunks=(1, -1, -1))
        assert_array_equal(lazy[4:].sum(axis=0), np.sum(images[3:], axis=0, dtype=np.uint64))


def test_rows_are_chosen_by_the_time_of_the_drive(session: Written) -> None:
    with Session(session.path) as s:
        time_s = s.results["time_s"]  # NaN, NaN, 2/8, 4/8, 6/8, 7/8 s
        assert s.during(0.5, 0.8) == slice(3, 5)
        assert_array_equal(time_s[s.during(0.0, 9.0)], time_s[2:])
        assert len(s.fields[s.during(5.0, 6.0)]) == 0


def test_a_notebook_shows_a_table(session: Written) -> None:
    with Session(session.path) as s:
        shown = s._repr_html_()
    assert shown.startswith("<table><caption>session.h5</caption>")
    assert "<td>the travel is done</td>" in shown
    assert "<td>mu_s</td>" in shown


def test_a_missing_file_is_one_for_python_too() -> None:
    for kind in (Session, Results):
        with pytest.raises(FileNotFoundError, match=r"nowhere\.h5: there is no such"):
            kind("nowhere.h5")
    assert issubclass(UserError, Exception)


# ------------------------------------------------------------------ closed forms


@pytest.fixture(scope="module")
def sliding(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of one frame of a contact that slides, by Hertz's pressure; its lens has moved."""
    return sliding_session(tmp_path_factory.mktemp("sliding") / "sliding.h5")


def sliding_session(path: Path, percent: float = 0.0) -> Path:
    """The same through a lens that distorts by so much, as the settings say."""
    settings = [f"sample.young_modulus={E * 1e-6}", f"sample.lens_radius={R * 1e3}"]
    more = [*settings, "sample.roughness=0", f"camera.distortion={percent}"]
    held = config.load(None, [*SMALL, *more])
    header = header_of(held, {"slipscope": "0.1.0"})
    grid = np.meshgrid(header.grid_x_px, header.grid_y_px)
    shown = held.camera.distortion, held.camera.shape
    x, y = (
        20e-6 * (places - middle)
        for places, middle in zip(ideal_places(*grid, *shown), CENTRE_PX, strict=True)
    )
    a = hertz.contact_radius(P, E, NU, R)
    gx, gy = cattaneo_mindlin.displacement(x, y, MU * P, MU, P, a, E, NU)
    noise = 10e-9 * np.random.default_rng(2).standard_normal((2, *gx.shape))
    true = np.stack([D_M + LENS_M - gx + noise[0], noise[1] - gy]) / 20e-6
    ux, uy = true
    for _ in range(8):  # what the lens shows of it
        ux, uy = np.stack([ux, uy]) + true - ideal_displacement(*grid, ux, uy, *shown)
    sd, ok = np.full(gx.shape, 10e-9 / 20e-6), np.zeros(gx.shape, np.uint8)
    parts = (part.astype(np.float32) for part in (ux, uy, sd, sd, np.ones(gx.shape)))
    snapshot = replace(
        make_snapshot(2),
        field=DisplacementField(*parts, ok),
        motion=FrameMotion(LENS_M, 0.0, 0.0, 0.0),
    )
    conditions = replace(snapshot.conditions, normal_force_n=P)
    writer = SessionRecorder.create(path, header)
    writer.append(replace(CONTACT, centre_px=CENTRE_PX))
    for n in (1, 2):
        writer.append(Frame(n, 125 * n, np.zeros(header.frame_shape, header.frame_dtype)))
    writer.append(replace(snapshot, conditions=conditions))
    writer.close()
    return path


@pytest.mark.parametrize(("method", "within"), [("regularised", 0.06), ("axisymmetric", 0.01)])
def test_the_traction_is_that_of_the_closed_form(sliding: Path, method: str, within: float) -> None:
    with Session(sliding) as s:
        found = s.traction(0, method)
        assert pytest.approx(MU * P, rel=within) == found.Q
        assert pytest.approx(D_M, rel=within) == found.D  # without the motion of the lens
        assert pytest.approx(2 * found.Q, rel=0.1) == s.traction(-1, method, modulus=2 * E).Q
        if method == "regularised":
            a = hertz.contact_radius(P, E, NU, R)
            assert found.sigma.shape == s.fields.shape[1:]
            assert np.nanmax(found.sigma) == pytest.approx(MU * 1.5 * P / (np.pi * a**2), rel=0.1)
        with pytest.raises(UserError, match="young is not known; give"):
            s.traction(0, young=3.0)


def test_a_lens_that_distorts_changes_neither_the_traction_nor_the_figures_of_a_session(
    sliding: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = sliding, sliding_session(tmp_path / "distorted.h5", 2.0)
    found, figures = [], []
    for path in paths:
        with Session(path) as s, SessionReader(path) as reader:
            found.append(s.traction(0))
            shots = [reader.snapshot(0)]
            monkeypatch.setattr(instants, "_correlated", lambda *_, shots=shots: (CENTRE_PX, shots))
            used = settings_of(reader)
            figures.append(instants.instants_of(used, reader, None, (), shots, np.nan))
    straight, undone = found
    assert pytest.approx(straight.Q, rel=0.005) == undone.Q
    assert pytest.approx(straight.D, rel=0.005) == undone.D
    straight_figure, undone_figure = figures
    force = np.nansum(undone_figure.stress_pa) / np.nansum(straight_figure.stress_pa)
    assert force == pytest.approx(1, abs=0.005)
    for name in ("ux_m", "uy_m"):  # at places that differ by some of the distortion
        assert_allclose(getattr(undone_figure, name), getattr(straight_figure, name), atol=1e-7)


def test_the_strain_is_that_of_the_closed_form(sliding: Path) -> None:
    """Inside the contact the displacement is quadratic (Johnson, Contact Mechanics, eq. 3.91)."""
    a, shear_modulus = hertz.contact_radius(P, E, NU, R), E / (2 * (1 + NU))
    slope = np.pi * MU * 1.5 * P / (np.pi * a**2) / (16 * shear_modulus * a)
    with Session(sliding) as s:
        field, strain = s.fields[0], s.strain(0)
        x, y = np.meshgrid(field.x_m - 240 * 20e-6, field.y_m - 200 * 20e-6)
        inside = np.hypot(x, y) < a - 3 * 200e-6
        noise = 10e-9 * np.sqrt(12) / (200e-6 * 25)
        for found, truth in (
            (strain.xx, slope * (4 - 3 * NU) * x),
            (strain.yy, -slope * NU * x),
            (strain.xy, slope * (4 - 2 * NU) * y / 2),
        ):
            off = (found - truth)[inside]
            assert np.abs(truth[inside]).max() > 10 * noise
            assert_allclose(off, 0, atol=5 * noise)
            assert abs(off.mean()) < noise
        with SessionReader(sliding) as reader:
            assert reader.snapshot(0).field is not None
