"""The rough contact of the simulated world, and a world that is not as its settings say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from friction import rough_world as truth

from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from analysis.settings import Sample
from app.settings.config import Config
from drivers.settings import CameraSettings, ForceSettings
from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.truth import TrueState
from drivers.sim.world import World

ROUGH = SimSettings(law="elasto-plastic", pressure="greenwood-tripp", press_time=0.02)


def contact(P: float, h: float = truth.H) -> SphereContact:
    return SphereContact(P, truth.E, truth.NU, truth.R, truth.MU, truth.L, h=h)


@pytest.mark.parametrize(("P", "h"), [(0.1, 0.6e-6), (0.5, 0.6e-6), (1.4, 0.6e-6), (0.3, 2e-6)])
def test_force_traction_and_displacement_are_those_of_an_independent_solver(
    P: float, h: float
) -> None:
    loading, world = AxisymmetricLoading(contact(P, h)), truth.rough(P, h)
    assert float(loading._weight @ loading.p) == pytest.approx(P, rel=1e-7)
    D = np.array([0.2, 0.6, 0.95, 1.3]) * world.full
    r = np.linspace(0, 1.3 * contact(P).a, 60)
    for known, distance in zip(world.run(D), D, strict=True):
        state = loading.driven(float(distance))
        assert pytest.approx(known.Q, rel=2e-4) == state.Q
        largest = truth.MU * contact(P, h).peak_pressure
        np.testing.assert_allclose(state.traction(r), known.sigma(r), atol=1e-3 * largest)


def test_a_rough_contact_remembers_what_a_smooth_one_does() -> None:
    """Masing: a reversal repeats the first loading at twice its size."""
    loading = AxisymmetricLoading(contact(0.5))
    forth = loading.driven(20e-6)
    for turn in (1e-6, 5e-6, 12e-6):
        back = loading.advance(forth, forth.D - 2 * turn)
        first = loading.driven(turn)
        assert pytest.approx(2 * first.Q, rel=1e-4) == forth.Q - back.Q


def test_a_rough_face_that_gets_smooth_becomes_hertz_s() -> None:
    smooth, nearly = (AxisymmetricLoading(contact(1.4, h)).driven(20e-6) for h in (0.0, 8e-8))
    assert pytest.approx(smooth.Q, rel=5e-3) == nearly.Q


def test_without_roughness_nothing_is_changed() -> None:
    one = AxisymmetricLoading(contact(0.5, 0.0))
    assert one.modes == 64
    assert one.contact.reach == one.contact.a


def lit_share(state: TrueState, r: np.ndarray) -> np.ndarray:
    """Share of the micro-contacts that touch at the distance r from the centre: pressure over its
    peak; where it is Hertz's, stretched to the apparent radius.
    """
    if state.rough is not None:
        return np.asarray(state.rough.pressure(r) / state.rough.peak_pressure)
    return np.sqrt(np.clip(1.0 - (r / state.apparent_radius_m) ** 2, 0.0, None))


def test_micro_contacts_thin_out_with_the_rough_pressure() -> None:
    camera, width = CameraSettings(width=640, height=480), 50e-6

    def lit(sim: SimSettings) -> tuple[np.ndarray, TrueState, np.ndarray]:
        scenario = Scenario(sim=sim, camera=camera, normal_force=0.1, press_samples=1)
        world = World(scenario, pace=None)
        world.start()
        world.advance(60)
        before, state = world.state(0), world.state(50)
        renderer = Renderer(scenario)
        added = renderer.grey(state, exact=False).astype(float)
        added -= renderer.grey(before, exact=False)
        y, x = np.indices(added.shape) * camera.pixel
        r = np.hypot(x - state.lens_centre_m[0], y - state.lens_centre_m[1])
        return np.bincount((r / width).astype(int).ravel(), added.ravel()), state, r

    (rough, state, r), (smooth, other, _) = map(lit, (ROUGH, replace(ROUGH, pressure="hertz")))
    a = state.apparent_radius_m
    band = slice(int(0.4 * a / width), int(0.9 * a / width))
    inside = (r >= band.start * width) & (r < band.stop * width)
    # micro-contacts brighten over 0.3 of the pressure, and over 0.05 of its peak where it is smooth
    shares = 0.85 * lit_share(state, r[inside]).sum(), (lit_share(other, r[inside]) - 0.025).sum()
    assert rough[band].sum() / smooth[band].sum() == pytest.approx(shares[0] / shares[1], abs=0.08)
    assert shares[0] < 0.8 * shares[1]


def test_a_world_that_is_not_as_its_settings_say() -> None:
    config = Config()
    scenario = Scenario.of(
        sim=SimSettings(errors=("camera.pixel 1.01", "forces.stiffness_shear 0.98")),
        sample=config.sample,
        forces=config.forces,
        camera=config.camera,
        normal_force=0.5,
    )
    assert scenario.camera.pixel == pytest.approx(1.01 * config.camera.pixel)
    assert scenario.forces.stiffness_shear == pytest.approx(0.98 * config.forces.stiffness_shear)
    assert scenario.sample == config.sample


@pytest.mark.parametrize(
    "text", ["camera.pixel", "camera.width 1.1", "pixel 1.1", "camera.pixel 7", "camera.pixel nan"]
)
def test_an_error_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"write one of camera\.pixel"):
        SimSettings(errors=(text,))


def test_cattaneo_and_mindlin_have_no_rough_contact() -> None:
    sim = SimSettings(law="cattaneo-mindlin")
    scenario = Scenario(sim=sim, sample=Sample(), forces=ForceSettings(), camera=CameraSettings())
    with pytest.raises(
        ValueError, match=r"has no rough contact; use 'elasto-plastic', or sim\.pressure = 'hertz'"
    ):
        World(scenario)
