"""`slipscope invert` on fields in closed form, on a session, and on what cannot be inverted."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import call, refused
from typer.testing import Result

from analysis.inversion.result import EndOfInversion
from analysis.mechanics import cattaneo_mindlin, hertz
from app.cli.invert import notes_once
from app.files.field_files import read_fields
from app.session.reader import SessionReader

Command = Callable[..., Result]

P, E, NU, R, MU, D = 0.5, 3.43e6, 0.5, 128.8e-3, 0.93, 37e-6
PIXEL = 7.04e-6
AROUND_CENTRE = ("--pixel", 7.04, "--box", 0, "--centre", 812 * PIXEL * 1e3, 590 * PIXEL * 1e3)
MATERIAL = ("--E", 3.43, "--poisson", 0.5, "--radius", 128.8, "--normal-force", 0.5)


def write_fields(
    path: Path,
    *,
    centre_px=(812.0, 590.0),
    noise=0.005,
    step=16,
    size=(1600, 1200),
    forces=(0.15, 0.35),
    drive=D,
) -> Path:
    """A table of Cattaneo and Mindlin's displacement under two forces, pixels, at the places where
    the material was before the block was driven.
    """
    rng = np.random.default_rng(5)
    a = hertz.contact_radius(P, E, NU, R)
    x, y = np.meshgrid(np.arange(10.0, size[0] - 10, step), np.arange(10.0, size[1] - 10, step))
    lines = ["frame,x_px,y_px,ux_px"]
    for frame, Q in enumerate(forces, 1):
        moved = np.full(x.shape, drive)
        for _ in range(8):
            gx, _ = cattaneo_mindlin.displacement(
                (x - centre_px[0]) * PIXEL + moved, (y - centre_px[1]) * PIXEL, Q, MU, P, a, E, NU
            )
            moved = drive - gx
        ux = moved / PIXEL + rng.normal(0, noise, x.shape)
        ux[3, 5] = np.nan
        lines += [
            f"{frame},{i:g},{j:g},{u:.6f}"
            for i, j, u in zip(x.ravel(), y.ravel(), ux.ravel(), strict=True)
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


def inverted(*arguments: object) -> dict[str, Any]:
    """What `slipscope invert` gives as JSON."""
    result = call("invert", *arguments, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def error_of(one: dict[str, Any], Q: float) -> float:
    """The rms error of the traction under that force, over its peak."""
    a = hertz.contact_radius(P, E, NU, R)
    r, sigma = np.array(one["radius_m"]), np.array(one["sigma_pa"], dtype=float)
    known = np.isfinite(sigma)
    error = (sigma - cattaneo_mindlin.traction(r, Q, MU, P, a))[known]
    return np.sqrt(np.mean((error / (MU * hertz.peak_pressure(P, a))) ** 2))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["axisymmetric", "regularised", "cgls", "van-cittert"])
def test_every_method_finds_the_force_the_far_displacement_and_the_profile(
    tmp_path: Path, method: str
) -> None:
    path = write_fields(tmp_path / "fields.csv")
    found = inverted(path, *MATERIAL, *AROUND_CENTRE, "--method", method)["fields"]
    assert [one["frame"] for one in found] == [1, 2]
    for one, Q in zip(found, (0.15, 0.35), strict=True):
        is_simple = method == "van-cittert"  # stops at the noise, with D and Q not quite there
        assert one["Q_n"] == pytest.approx(Q, rel=2e-2 if is_simple else 5e-3)
        assert one["D_m"] == pytest.approx(D, abs=3e-7 if is_simple else 5e-8)
        # the front at c is sharper than a pitch
        assert error_of(one, Q) < (0.02 if method in ("axisymmetric", "regularised") else 0.1)
        assert one["is_covered"]


@pytest.mark.parametrize("method", ["axisymmetric", "regularised", "cgls"])
def test_the_contact_stays_with_the_lens_while_the_block_slides(
    tmp_path: Path, method: str
) -> None:
    path = write_fields(tmp_path / "fields.csv", drive=141e-6, forces=(0.35,))
    (one,) = inverted(path, *MATERIAL, *AROUND_CENTRE, "--method", method)["fields"]
    assert error_of(one, 0.35) < (0.1 if method == "cgls" else 0.025)
    assert one["Q_n"] == pytest.approx(0.35, rel=5e-3)


def test_the_centre_is_found_where_it_is_not_given(tmp_path: Path) -> None:
    path = write_fields(tmp_path / "fields.csv")
    found = inverted(path, *MATERIAL, "--pixel", 7.04, "--frame", 2)
    assert np.array(found["centre_m"]) / PIXEL == pytest.approx([812, 590], abs=6)
    assert found["fields"][0]["Q_n"] == pytest.approx(0.35, rel=1e-2)


def test_a_drive_to_minus_x_is_that_to_plus_x_in_a_mirror(
    slipscope: Command, tmp_path: Path
) -> None:
    """With points that are wild, which are no contact."""
    path = write_fields(tmp_path / "fields.csv", forces=(0.35,))
    frame, x, y, ux = np.loadtxt(path, delimiter=",", skiprows=1).T
    ux[::2000] -= 9.0
    found = []
    for name, field in {"to": (frame, x, y, ux), "fro": (frame, 1600 - x, y, -ux)}.items():
        header = {"delimiter": ",", "header": "frame,x_px,y_px,ux_px", "comments": ""}
        np.savetxt(tmp_path / f"{name}.csv", np.transpose(field), **header)
        options = (tmp_path / f"{name}.csv", *MATERIAL, "--pixel", 7.04)
        found.append(inverted(*options))
        assert slipscope("invert", *options).exit_code == 0
    (x_to, y_to), (x_fro, y_fro) = (np.array(one["centre_m"]) / PIXEL for one in found)
    assert (x_to, y_to) == pytest.approx((812, 590), abs=6)
    assert (1600 - x_fro, y_fro) == pytest.approx((x_to, y_to), abs=0.1)
    to, fro = (one["fields"][0] for one in found)
    assert fro["Q_n"] == pytest.approx(-to["Q_n"], rel=1e-3)
    assert fro["peak_radius_m"] == pytest.approx(to["peak_radius_m"], rel=1e-3)


def test_results_go_to_a_table_and_to_arrays(slipscope: Command, tmp_path: Path) -> None:
    path = write_fields(tmp_path / "fields.csv", step=32)
    said = slipscope("invert", path, *MATERIAL, "--pixel", 7.04, "--box", 0, "-o", "profile.csv")
    assert said.exit_code == 0, said.output
    assert "2 fields" in said.stdout
    table = np.genfromtxt(tmp_path / "profile.csv", delimiter=",", names=True)
    assert table.dtype.names == ("frame", "r_mm", "sigma_kPa", "sigma_sd_kPa")
    cgls = ("invert", path, *MATERIAL, "--pixel", 7.04, "--method", "cgls", "-o")
    assert slipscope(*cgls, "field.npz").exit_code == 0
    with np.load(tmp_path / "field.npz") as arrays:
        pitch = arrays["x_m"][1] - arrays["x_m"][0]
        np.testing.assert_allclose(arrays["sigma_Pa"].sum(axis=(1, 2)) * pitch**2, arrays["Q_N"])
        assert np.isnan(arrays["residual_m"][0, 3, 5])
        assert np.isnan(arrays["D_sd_m"]).all()  # the method has none
        assert np.isfinite(arrays["D_m"]).all()
        whole = {name: arrays[name].ravel() for name in ("sigma_Pa", "residual_m")}
        assert arrays["is_converged"].shape == arrays["stopped"].shape == arrays["Q_N"].shape
        assert set(arrays["stopped"].tolist()) <= {ending.value for ending in EndOfInversion}
    assert slipscope(*cgls, "field.csv").exit_code == 0
    first = "frame,x_mm,y_mm,sigma_kPa,sigma_sd_kPa,residual_um\n1,0.0704,0.0704,0,"
    assert (tmp_path / "field.csv").read_text().startswith(first)
    points = np.genfromtxt(tmp_path / "field.csv", delimiter=",", names=True)
    np.testing.assert_allclose(points["sigma_kPa"], 1e-3 * whole["sigma_Pa"], rtol=1e-5)
    np.testing.assert_allclose(points["residual_um"], 1e6 * whole["residual_m"], rtol=1e-5)
    assert not list(tmp_path.glob("*.part*"))


def test_a_session_knows_what_it_was_measured_on(session: Path) -> None:
    # the picture is hardly larger than the contact and its rough rim
    found = inverted(session, "--roughness", 0)["fields"]
    assert len(found) > 10
    assert found[-1]["Q_n"] == pytest.approx(0.93 * 0.03, rel=0.1)


@pytest.mark.slow
def test_the_fields_of_a_session_give_the_same_from_their_own_table(
    slipscope: Command, session: Path
) -> None:
    """The pixel and the boxes are those that the table states; the motion of the lens is taken off
    as of a session.
    """
    assert slipscope("export", session, "-o", "f.csv").exit_code == 0
    found = inverted(session, "--roughness", 0)
    centre = [part * 1e3 for part in found["centre_m"]]
    frames = [one["frame"] for one in found["fields"]]
    chosen = (w for n in frames for w in ("--frame", n))
    options = ("f.csv", "--centre", *centre, *chosen, *MATERIAL[:-1], 0.03)
    again = inverted(*options)
    assert again["notes"] == [
        "a pixel is 7.04 um, as f.csv states",
        "the motion of the lens is taken off, as f.csv states it",
    ]
    for one, same in zip(found["fields"], again["fields"], strict=True):
        assert same["Q_n"] == pytest.approx(one["Q_n"], rel=0.01, abs=1e-4)
        assert same["D_m"] == pytest.approx(one["D_m"], abs=9e-9)
    # without it: the simulated lens moves by 0.68 um/N, and 0.028 N pull at the end
    rows = [line.split(",") for line in Path("f.csv").read_text(encoding="utf-8").splitlines()]
    lens_at = rows[0].index("lens_px")
    bare = [",".join(row[:lens_at] + row[lens_at + 1 :]) for row in rows]
    Path("f.csv").write_text("\n".join(bare), encoding="utf-8")
    left_in = inverted(*options)
    lens = left_in["fields"][-1]["D_m"] - again["fields"][-1]["D_m"]
    assert lens == pytest.approx(0.028 * 0.68e-6, rel=0.2)
    assert "left in" in left_in["notes"][-1]


def test_a_table_that_does_not_state_the_motion_of_the_lens_says_that_it_is_left_in(
    tmp_path: Path,
) -> None:
    path = write_fields(tmp_path / "fields.csv")
    old = "# a pixel is 7.04 um; (0, 0) is the centre of the top-left pixel"
    path.write_text(f"{old}\n{path.read_text()}")
    found = inverted(path, *MATERIAL)
    assert found["notes"] == [
        "a pixel is 7.04 um, as fields.csv states",
        "the motion of the lens is left in: fields.csv does not state it",
    ]
    other = inverted(path, *MATERIAL, "--pixel", 8)
    assert found["fields"][0]["D_m"] * 8 / 7.04 == pytest.approx(
        other["fields"][0]["D_m"], rel=0.05
    )
    assert other["notes"] == found["notes"][1:]


def test_both_components_of_a_session(slipscope: Command, session: Path, tmp_path: Path) -> None:
    more = ("--roughness", 0, "--method", "coupled", "-o", "both.npz")
    said = slipscope("invert", session, *more)
    assert said.exit_code == 0, said.output
    with np.load(tmp_path / "both.npz") as found:
        along, across = found["sigma_Pa"][-1], found["sigma_across_Pa"][-1]
        assert found["Q_N"][-1] == pytest.approx(0.93 * 0.03, rel=0.1)
        # friction acts along the drive
        assert abs(across.sum()) < 0.05 * along.sum()
        assert np.abs(across).max() < 0.5 * along.max()


def test_each_component_of_a_session_has_its_own_uncertainty(session: Path) -> None:
    fields = read_fields(session, None)
    assert fields.across is not None
    with SessionReader(session) as held:
        pixel = held.header.pixel_m
        rows = [i for i, n in enumerate(held.analysed_frames()) if n in fields.frames]
        shots = [held.snapshot(row).field for row in rows[:3]]
    both = zip(shots, fields.fields(), fields.across(), strict=False)
    for shot, (_, _, sd), (_, across_sd) in both:
        np.testing.assert_allclose(sd, pixel * shot.ux_std_px, rtol=1e-6)
        np.testing.assert_allclose(across_sd, pixel * shot.uy_std_px, rtol=1e-6)
        assert np.nanmax(np.abs(sd / across_sd - 1)) > 1e-3


def test_both_components_need_both_displacements(slipscope: Command, tmp_path: Path) -> None:
    path = write_fields(tmp_path / "fields.csv", step=32)
    result = slipscope("invert", path, *MATERIAL, "--pixel", 7.04, "--method", "coupled")
    refused(result, "has no displacement across the drive")


def test_a_field_without_surroundings_is_refused_with_its_reason(
    slipscope: Command, session: Path
) -> None:
    reason = ("none of its fields could be inverted", "rings inside the mask")
    refused(slipscope("invert", session), *reason)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("--normal-force", "--modulus", "not given")),
        ((*MATERIAL,), ("--pixel",)),
        ((*MATERIAL, "--pixel", 7.04, "--method", "magic"), ("--method", "magic")),
        (("--E", -3, *MATERIAL[2:], "--pixel", 7.04), ("--E must be", "-3")),
        ((*MATERIAL[:2], "--poisson", 0.7, *MATERIAL[4:], "--pixel", 7.04), ("--poisson", "0.7")),
        ((*MATERIAL, "--pixel", 7.04, "--frame", 9), ("--frame", "9")),
        ((*MATERIAL, "--pixel", 7.04, "-o", "a.xls"), (".csv", ".npz")),
        ((*MATERIAL, "--pixel", 7.04, "--centre", 900, 900), ("mask",)),
        (
            (*MATERIAL[:6], "--normal-force", 5e6, "--pixel", 7.04),
            ("--normal-force", "at most 100 N"),
        ),
        ((*MATERIAL[:6], "--normal-force", 100, "--pixel", 7.04), ("outside",)),
    ],
)
def test_what_can_not_be_done_is_said_in_a_sentence(
    slipscope: Command, tmp_path: Path, arguments: tuple[object, ...], words: tuple[str, ...]
) -> None:
    path = write_fields(tmp_path / "fields.csv", step=32)
    refused(slipscope("invert", path, *(arguments or ("--pixel", 7.04))), *words)


def test_a_note_on_many_fields_is_told_once_with_their_frames() -> None:
    def field(number: int, *notes: str) -> Any:
        return SimpleNamespace(number=number, result=SimpleNamespace(notes=notes))

    covers, above = "the field does not cover the contact", "a residual of {} times the noise"
    fields = [field(n, covers, *([above.format(1.5 + n)] if n > 1 else [])) for n in range(20)]
    assert notes_once(fields) == [
        covers,
        "frames 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13 and 6 more, the first: a residual of 3.5"
        " times the noise",
    ]
    assert notes_once([field(7, "odd"), field(8)]) == ["frame 7: odd"]
    assert notes_once([field(7, "odd")]) == ["odd"]
