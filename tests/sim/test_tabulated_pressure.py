"""A simulated contact whose pressure is a table."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from friction import rough_world as truth

from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from analysis.mechanics.tabulated_pressure import TabulatedPressure, tabulated_pressure
from drivers.settings import CameraSettings
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

P = 0.5
BODIES = P, truth.E, truth.NU, truth.R
A = hertz.contact_radius(*BODIES)
R = A * np.sin(np.linspace(0, np.pi / 2, 60))
X = np.arange(4000.5) / 4000
FORCE = 2 * np.pi * X / 4000  # of a pressure at the shares X of a radius


def contact(table: TabulatedPressure | None = None, P: float = P) -> SphereContact:
    return SphereContact(P, *BODIES[1:], truth.MU, truth.L, table=table)


def blunt(r: np.ndarray, reach: float) -> np.ndarray:
    """Flatter than Hertz's."""
    return (1 - (r / reach) ** 4) ** 0.5


def test_a_table_of_hertz_s_pressure_is_hertz_s_contact() -> None:
    table = tabulated_pressure(P, R, 7.0 * hertz.pressure(R, P, A))
    known, found = (AxisymmetricLoading(contact(one)) for one in (None, table))
    r = np.linspace(0, 1.2 * A, 50)
    p0 = hertz.peak_pressure(P, A)
    np.testing.assert_allclose(found.contact.pressure(r), known.contact.pressure(r), atol=1e-4 * p0)
    assert table.effective_radius == pytest.approx(A, rel=1e-4)
    for D in np.array([0.2, 0.7, 1.4]) * known.contact.full_shift:
        a, b = known.driven(float(D)), found.driven(float(D))
        assert pytest.approx(a.Q, rel=2e-4) == b.Q
        np.testing.assert_allclose(b.traction(r), a.traction(r), atol=1e-3 * truth.MU * p0)
        np.testing.assert_allclose(b.displacement(r), a.displacement(r), atol=2e-4 * D)


def test_a_flatter_pressure_carries_the_load_and_slides_later() -> None:
    r = np.linspace(0, 1.2 * A, 80)
    table = tabulated_pressure(P, r, blunt(r, 1.2 * A))
    assert table.pressure(X * table.reach) @ FORCE * table.reach**2 == pytest.approx(P, rel=1e-3)
    loading = AxisymmetricLoading(contact(table))
    slid = loading.at_force((1 - 1e-6) * truth.MU * P)
    np.testing.assert_allclose(
        slid.traction(r), truth.MU * blunt(r, 1.2 * A) * table.peak_pressure,
        atol=2e-2 * truth.MU * table.peak_pressure,
    )  # fmt: skip
    # a point slides by the deformation of the whole: that of the centre is the sum of mu p dr
    model = truth.MU, P, table.effective_radius, truth.E, truth.NU
    shift = cattaneo_mindlin.full_shift(*model)
    assert slid.displacement(0.0)[0] == pytest.approx(shift, rel=2e-3)
    assert loading.driven(0.3 * shift).Q < truth.MU * P * 0.6


def test_under_another_load_radii_grow_with_its_cube_root() -> None:
    one = tabulated_pressure(P, R, hertz.pressure(R, P, A))
    more = contact(one, 8 * P)
    assert more.reach == pytest.approx(2 * one.reach)
    assert more.peak_pressure == pytest.approx(hertz.peak_pressure(8 * P, 2 * A), rel=1e-4)
    assert one.radius_at(0.5) == pytest.approx(A * 0.75**0.5, rel=1e-3)


def world(path: Path, **sim: object) -> World:
    """A world in contact with the pressure of that file."""
    settings = SimSettings(
        law="elasto-plastic", pressure="table", pressure_table=str(path), press_time=0.02
    )
    camera = CameraSettings(width=64, height=64)
    made = Scenario(sim=replace(settings, **sim), camera=camera, normal_force=P, press_samples=1)
    return World(made, pace=None)


def write(path: Path, r_mm: np.ndarray, p: np.ndarray) -> Path:
    path.write_text(
        "# mm, kPa\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(r_mm, p, strict=True))
    )
    return path


def test_a_world_has_the_pressure_of_its_table(tmp_path: Path) -> None:
    r = np.linspace(0, 3.0, 80)
    bench = world(write(tmp_path / "p.csv", r, blunt(r, 3.0)))
    bench.start()
    bench.advance(60)
    state = bench.state(50)
    assert state.apparent_radius_m == pytest.approx(3e-3)
    p = state.pressure(r * 1e-3)
    np.testing.assert_allclose(p, state.pressure(0.0) * blunt(r, 3.0), atol=1e-3 * p[0])
    assert state.pressure(X * 3e-3) @ FORCE * 9e-6 == pytest.approx(P, rel=1e-3)
    assert bench.state(0).apparent_radius_m == 0
    with pytest.raises(ValueError, match="has no pressure of a table"):
        world(tmp_path / "p.csv", law="cattaneo-mindlin")


FALLING = "0,9\n1,8\n2,6\n3,3\n4,0"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (FALLING.replace("3,3", "3,-3"), "never rising or below 0"),
        (FALLING.replace("4,0", "4,1"), "0 in the last row alone"),
        (FALLING.replace("2,6", "2,8.5"), "never rising"),
        (FALLING.replace("2,6", "2,nan"), "5 rows or more"),
        (FALLING.replace("2,6", "1,6"), "distance rises"),
        ("0,9\n4,0", "5 rows or more"),
        (FALLING + "\n5,0", "0 in the last row alone"),
        (FALLING.replace(",", ";"), "two columns of numbers"),
        (FALLING.replace("\n", ",1\n") + ",1", "has 3 columns"),
    ],
)
def test_a_table_that_is_no_pressure_is_refused(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(ValueError, match=told):
        world(tmp_path / "p.csv")
    with pytest.raises(ValueError, match="none is named"):
        world(tmp_path, pressure_table="")
