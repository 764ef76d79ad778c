"""`slipscope model`: the numbers against the paper and the formulas, the curves against each other,
bad input as a sentence.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image
from matplotlib.figure import Figure
from typer.testing import Result

from analysis.mechanics import cattaneo_mindlin

Command = Callable[..., Result]


def numbers(result: Result) -> dict[str, float]:
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def table(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """The lines of the header, and the columns."""
    lines = path.read_text(encoding="utf-8").splitlines()
    header = [line for line in lines if line.startswith("#")]
    names, *rows = lines[len(header) :]
    columns = np.array([[float(value) for value in row.split(",")] for row in rows]).T
    return header, dict(zip(names.split(","), columns, strict=True))


def test_the_defaults_are_the_papers_contact(slipscope: Command) -> None:
    found = numbers(slipscope("model", "--json"))
    assert found["normal_force_n"] == 0.5
    assert found["hertz_radius_m"] == pytest.approx(
        (3 * 0.5 * 0.1288 * 0.75 / (4 * 3.43e6)) ** (1 / 3)
    )
    assert found["peak_pressure_pa"] == pytest.approx(
        3 * 0.5 / (2 * np.pi * found["hertz_radius_m"] ** 2)
    )
    assert found["shear_force_n"] == pytest.approx(0.6 * 0.93 * 0.5)
    assert found["stick_radius_m"] == pytest.approx(found["hertz_radius_m"] * 0.4 ** (1 / 3))
    assert found["block_shift_cm_m"] == pytest.approx(
        found["sliding_shift_m"] * (1 - 0.4 ** (2 / 3))
    )
    assert found["bureau_length_m"] == pytest.approx(0.89e-6, abs=0.01e-6)
    assert found["apparent_radius_m"] - found["hertz_radius_m"] == pytest.approx(280e-6, abs=5e-6)
    assert found["block_shift_m"] > found["block_shift_cm_m"] - 1e-7
    assert "jkr_radius_m" not in found


def test_the_table_for_people_has_units(slipscope: Command, tmp_path: Path) -> None:
    result = slipscope("model", "--adhesion", 50, "--thickness", 15)
    assert result.exit_code == 0
    for words in (
        "a_H",
        "2.194 mm",
        "49.59 kPa",
        "0.465 N",
        "-30.35 mN",
        "15 mm",
        "0.8925 um",
        "N/mm",
        "Tabor",
    ):
        assert words in result.stdout
    assert not list(tmp_path.iterdir())


def test_the_curves_agree_with_the_numbers_and_with_each_other(
    slipscope: Command, tmp_path: Path
) -> None:
    found = numbers(slipscope("model", "--share", 0.9, "-o", "m.csv", "--json"))
    header, columns = table(tmp_path / "m.csv")
    r = columns["r_mm"]
    ring = 2 * np.pi * r * 1e-6
    for name, force in (
        ("p_kPa", 0.5),
        ("p_rough_kPa", 0.5),
        ("sigma_kPa", found["shear_force_n"]),
        ("sigma_cm_kPa", found["shear_force_n"]),
    ):
        assert np.trapezoid(ring * columns[name] * 1e3, r) == pytest.approx(force, rel=2e-3)
    assert (columns["sigma_kPa"] <= 0.93 * columns["p_kPa"] + 1e-9).all()
    assert np.interp(
        found["block_shift_m"] * 1e6, columns["delta_um"], columns["Q_N"]
    ) == pytest.approx(found["shear_force_n"], rel=1e-4)
    stuck = r < found["stick_radius_m"] * 1e3
    assert np.abs(columns["ux_cm_um"][stuck]).max() < 1e-9
    assert columns["ux_um"][0] == pytest.approx(found["centre_slip_m"] * 1e6)
    assert (np.diff(columns["ux_um"]) > 0).all()
    assert r[np.argmax(columns["sigma_cm_kPa"])] == pytest.approx(
        found["stick_radius_m"] * 1e3, rel=1e-6
    )
    assert r[np.argmax(columns["sigma_kPa"])] == pytest.approx(
        found["peak_radius_m"] * 1e3, abs=0.03
    )
    # beside them the numbers, so that the file says what it is of; no line above the names
    assert not header
    for key, value in found.items():
        np.testing.assert_allclose(columns[key], value, rtol=1e-8)


def test_a_rough_interface_of_no_length_is_cattaneo_mindlin(
    slipscope: Command, tmp_path: Path
) -> None:
    slipscope("model", "--length", 0, "--share", 1, "-o", "smooth.csv")
    _, smooth = table(tmp_path / "smooth.csv")
    for name, unit in (("sigma", "kPa"), ("ux", "um"), ("Q", "N")):
        np.testing.assert_array_equal(smooth[f"{name}_{unit}"], smooth[f"{name}_cm_{unit}"])
    np.testing.assert_allclose(smooth["sigma_kPa"], 0.93 * smooth["p_kPa"], rtol=1e-8)
    slipscope("model", "--length", 0.05, "--shear-force", 0.3, "-o", "nearly.csv")
    _, nearly = table(tmp_path / "nearly.csv")
    np.testing.assert_allclose(nearly["Q_N"], nearly["Q_cm_N"], atol=1e-3)


def test_a_layer_moves_less_for_the_same_force(slipscope: Command) -> None:
    thick, thin = (
        numbers(slipscope("model", "--json", *layer)) for layer in ((), ("--thickness", 15))
    )
    lost = (thick["block_shift_m"] - thin["block_shift_m"]) / thick["shear_force_n"]
    assert lost == pytest.approx(4.8e-6, rel=0.05)


def test_jkr_without_measurable_adhesion_is_hertz(slipscope: Command) -> None:
    found = numbers(slipscope("model", "--json", "--adhesion", 1e-9))
    assert found["jkr_radius_m"] == pytest.approx(found["hertz_radius_m"], rel=1e-4)


@pytest.mark.parametrize(
    "options", [("--thickness", 15), ("--length", 0, "--share", 0.5, "--roughness", 0)]
)
def test_the_figure_is_drawn(
    slipscope: Command, tmp_path: Path, options: tuple[object, ...]
) -> None:
    assert slipscope("model", "-o", "m.png", *options).exit_code == 0
    pixels = image.imread(tmp_path / "m.png")
    assert pixels.shape[1] > 1000
    assert (pixels[..., :3].std(axis=2) > 0.1).sum() > 2000  # curves in colour


def test_a_smooth_contact_moves_as_the_closed_form_on_both_axes(
    slipscope: Command, tmp_path: Path
) -> None:
    found = numbers(slipscope("model", "--length", 0, "--share", 0.8, "-o", "m.csv", "--json"))
    _, columns = table(tmp_path / "m.csv")
    names = ("shear_force_n", "friction", "normal_force_n", "hertz_radius_m", "young_modulus_pa")
    about = (*(found[name] for name in names), found["poisson"])
    r = columns["r_mm"] * 1e-3
    for along, across, sign in ((r, 0 * r, 1), (0 * r, r, -1)):
        moved = cattaneo_mindlin.displacement(along, across, *about)[0]
        seen = columns["ux_um"] + sign * columns["ux_cos2_um"]
        np.testing.assert_allclose(seen, 1e6 * (found["block_shift_cm_m"] - moved), atol=1e-6)
    first = columns["Q_cm_N"][1] / columns["delta_um"][1] * 1e6
    assert found["stiffness_smooth_n_per_m"] == pytest.approx(first, rel=0.02)


def test_the_figure_draws_the_columns_of_the_table(
    slipscope: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn, save = [], Figure.savefig

    def keep(figure: Figure, *given: object, **options: object) -> None:
        drawn.append(figure)
        save(figure, *given, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    for name in ("m.csv", "m.png"):
        assert slipscope("model", "--share", 0.9, "-o", name).exit_code == 0
    _, columns = table(tmp_path / "m.csv")
    panels = (("r_mm", "p", "kPa"), ("r_mm", "sigma", "kPa"), ("r_mm", "ux", "um"))
    for axes, (x, y, unit) in zip(drawn[0].axes, (*panels, ("delta_um", "Q", "N")), strict=True):
        curves = [line.get_data() for line in axes.lines if len(line.get_xdata()) > 2]
        at, values = curves[0]
        name = "p_rough_kPa" if y == "p" else f"{y}_{unit}"
        np.testing.assert_allclose(at, columns[x], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(values, columns[name], rtol=1e-6, atol=1e-9)
        label = axes.get_ylabel().replace("µ", "u")
        assert label.endswith(f"({unit})"), label


@pytest.mark.slow
def test_the_figure_can_be_a_page(slipscope: Command, tmp_path: Path) -> None:
    assert slipscope("model", "-o", "m.pdf", "--length", 0).exit_code == 0
    assert (tmp_path / "m.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--poisson", 0.51), "--poisson must be a number at least 0 and at most 0.5; found 0.51"),
        (
            ("--modulus", -1),
            "--modulus must be a number more than 0 and at most 1e+06 MPa; found -1",
        ),
        (("--E=-1",), "--E must be a number more than 0"),
        (("--E", "nan"), "--E: a finite number is needed; found nan"),
        (("--normal-force", "nan"), "--normal-force: a finite number is needed; found nan"),
        (("--friction", 0), "--friction must be"),
        (("--roughness", "inf"), "--roughness: a finite number is needed; found inf"),
        (("--share", 1.2), "give 0 to mu P = 0.465 N"),
        (("--shear-force", -0.1), "Q = -0.1 N is not possible"),
        (("--shear-force", 0.1, "--share", 0.1), "give one of them"),
        (("--share", 1), "or --length 0"),
        (("--length", 0, "--thickness", 15), "--thickness"),
        (("--thickness", 1), "thick"),
        (("--normal-force", 100, "--modulus", 1e-3), "too wide for Hertz"),
        (("-o", "m.txt"), ".csv"),
        (("-o", "nowhere/m.csv"), "nowhere"),
    ],
)
def test_what_can_not_be_modelled_is_a_sentence(
    slipscope: Command, tmp_path: Path, options: tuple[object, ...], words: str
) -> None:
    result = slipscope("model", *options)
    assert result.exit_code == 2
    assert words in result.stderr
    assert result.stderr.count("\n") == 1
    assert result.stdout == ""
    assert not list(tmp_path.iterdir())


def test_a_file_that_exists_is_kept(slipscope: Command, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("mine")
    assert slipscope("model", "-o", "m.csv").exit_code == 2
    assert (tmp_path / "m.csv").read_text() == "mine"
    assert slipscope("model", "-o", "m.csv", "--overwrite").exit_code == 0
    assert (tmp_path / "m.csv").read_text() != "mine"
