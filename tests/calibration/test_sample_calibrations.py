"""Calibrations of the sample, from files and sessions to a certificate."""

from types import SimpleNamespace

import hidden_samples as world
import numpy as np
import pytest

from analysis.mechanics.greenwood_tripp import rough_contact
from analysis.mechanics.hertz import contact_radius
from app.calibrations import smooth_contacts
from app.calibrations.certifying import evaluated
from app.calibrations.radius_over_loads import RadiusCalibration, RadiusOptions
from app.calibrations.sample_adhesion import AdhesionCalibration, JkrOptions
from app.calibrations.sample_roughness import MapOptions, RoughnessCalibration
from app.settings.certificates import read_certificate
from app.settings.config import load, to_toml
from app.settings.protocol_steps import Approach
from app.system.errors import CalibrationRefused, UserError

UM = 1e-6


def known(found):
    return {one.key: (one.value, one.total) for one in found.result.values}


@pytest.fixture
def two_maps(tmp_path):
    paths = [tmp_path / "here.npy", tmp_path / "there.npy"]
    for seed, path in enumerate(paths):
        np.save(path, world.height_map(seed) * 1e6)
    return paths


def test_two_maps_give_one_h_and_a_certificate_that_is_evaluated_again(tmp_path, two_maps):
    options = MapOptions(pitch=world.PITCH, scale=UM)
    found = evaluated(RoughnessCalibration(), two_maps, options)
    (h, sd), (extension, _) = (known(found)[key] for key in ("roughness_m", "extension_m"))
    assert abs(h - world.H) < 2 * sd < 0.03 * world.H
    assert extension == pytest.approx(np.sqrt(0.1288 * h))
    assert known(found)["length_m"][0] == pytest.approx(1.5 * h)
    # exp(-(r/l)^2) has pi sqrt(3) l^2 for each summit
    distance = np.sqrt(np.pi * np.sqrt(3)) * world.LENGTH
    assert known(found)["summit_distance_m"][0] == pytest.approx(distance, rel=0.05)
    radius = 0.375 * np.sqrt(np.pi / 12) * world.LENGTH**2 / world.H
    assert known(found)["summit_radius_m"][0] == pytest.approx(radius, rel=0.1)
    summit_h = np.sqrt(1 - 0.8968 / 3) * world.H
    mu = 8 / 3 / distance**2 * summit_h * np.sqrt(2 * 0.1288 * radius)
    rough = rough_contact(0.5, 3.43e6, 0.5, 0.1288, summit_h, mu)
    beyond = rough.radius_at(0.01) - contact_radius(0.5, 3.43e6, 0.5, 0.1288)
    assert known(found)["pressure_extension_m"][0] == pytest.approx(beyond, rel=0.03)
    assert beyond < 0.7 * extension  # Gaussian heights reach less far than exponential ones
    assert any("mu = 1" in one for one in found.result.remarks)
    written = found.certificate.settings
    assert written["sample.roughness"] == pytest.approx(h * 1e6)
    assert written["uncertainty.roughness"] == pytest.approx(100 * sd / h)
    found.write(tmp_path / "h.zip", overwrite=False)
    again = evaluated(RoughnessCalibration(), [tmp_path / "h.zip"], options)
    assert known(again)["roughness_m"][0] == pytest.approx(h, rel=1e-6)
    assert read_certificate(tmp_path / "h.zip").what == "roughness"


def test_maps_of_places_that_differ_are_told_and_widen_the_uncertainty(tmp_path):
    paths = [tmp_path / "here.npy", tmp_path / "there.npy"]
    for seed, path in enumerate(paths):
        np.save(path, world.height_map(seed, h=world.H * (1 + 0.3 * seed)))
    found = evaluated(RoughnessCalibration(), paths, MapOptions(pitch=world.PITCH, scale=1.0))
    assert any("not the same everywhere" in one for one in found.result.remarks)
    assert known(found)["roughness_m"][1] > 0.05 * world.H


def test_a_map_that_cannot_be_trusted_is_refused(tmp_path):
    np.save(tmp_path / "flat.npy", np.zeros((100, 100)))
    with pytest.raises(CalibrationRefused, match="all heights are equal"):
        evaluated(RoughnessCalibration(), [tmp_path / "flat.npy"], MapOptions(pitch=UM, scale=UM))
    with pytest.raises(UserError, match="--pitch"):
        evaluated(RoughnessCalibration(), [tmp_path / "flat.npy"], MapOptions())


def jkr_table(path, a, P):
    rows = zip(a, P, world.FALLS, strict=True)
    lines = [f"{x * 1e6},{p * 1e3},3,0.5,{'un' if f else ''}loading" for x, p, f in rows]
    path.write_text("\n".join(["a_um,P_mN,a_sd_um,P_sd_mN,branch", *lines]), encoding="utf-8")
    return path


def test_a_table_of_a_jkr_test_gives_the_modulus_of_the_settings(tmp_path):
    path = jkr_table(tmp_path / "jkr.csv", *world.adhering(3))
    found = evaluated(AdhesionCalibration(), [path], JkrOptions(poisson_uncertainty=1e-9))
    E, sd = known(found)["modulus_pa"]
    assert abs(E - world.E) < 2 * sd
    assert sd == pytest.approx(0.018 * E, rel=0.15)  # 0.5 % of pixel size are 1.5 % of E
    assert abs(known(found)["hysteresis_j_m2"][0] - 0.05) < 3e-3
    assert found.certificate.settings["sample.young_modulus"] == pytest.approx(E * 1e-6)
    # 0.01 of Poisson's ratio, that of the settings, are 1.3 % of E
    by_default = evaluated(AdhesionCalibration(), [path], JkrOptions())
    widened = np.hypot(sd, 2 * 0.5 * 0.01 / (1 - 0.5**2) * E)
    assert known(by_default)["modulus_pa"] == pytest.approx((E, widened), rel=1e-3)
    wider = by_default.certificate.settings["uncertainty.young_modulus"]
    assert wider == pytest.approx(100 * widened / E, rel=1e-3)
    assert "0.5 +- 0.01, which is in" in by_default.result.remarks[0]
    loading = evaluated(AdhesionCalibration(), [path], JkrOptions(branches="loading"))
    assert "hysteresis_j_m2" not in known(loading)


def test_a_jkr_test_whose_force_drifts_is_refused(tmp_path):
    a, P = world.adhering(3)
    path = jkr_table(tmp_path / "jkr.csv", a, P + np.linspace(0, 0.02, len(P)))
    with pytest.raises(CalibrationRefused, match="the force drifts"):
        evaluated(AdhesionCalibration(), [path], JkrOptions())


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ("a_um,P_N\n1,2\n", "no a_um, P_N, a_sd_um or P_sd_N"),
        ("a_um,P_N,a_sd_um,P_sd_N,branch\n1,2,3,4,up\n", "'up' is no branch"),
    ],
)
def test_tables_of_something_else_are_refused(tmp_path, table, word):
    (tmp_path / "jkr.csv").write_text(table, encoding="utf-8")
    with pytest.raises(UserError, match=word):
        evaluated(AdhesionCalibration(), [tmp_path / "jkr.csv"], JkrOptions())


def test_a_run_loads_and_unloads():
    (config,) = AdhesionCalibration().plan(load(None, ()), JkrOptions(loads="0.1, 0.2 0.4"))
    asked = [step.normal_force for step in config.run.steps if isinstance(step, Approach)]
    assert asked == [0.1, 0.2, 0.4, 0.2, 0.1]
    for wrong in ("", "0.2 0.1", "-1 2", "x"):
        with pytest.raises(UserError, match="growing loads"):
            AdhesionCalibration().plan(load(None, ()), JkrOptions(loads=wrong))


def photographs(radii_px, rng):
    """Discs of these radii; the first picture is that of the free block."""
    y, x = np.mgrid[:300, :400]
    r = np.hypot(x - 200.3, y - 150.2)
    light = 60 + 0.1 * x
    for radius in (-9.0, *radii_px):
        grey = light * (1 + 0.5 * np.clip(radius + 0.5 - r, 0, 1)) + rng.normal(0, 1, r.shape)
        yield np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def test_pictures_and_forces_of_a_run_become_radii_over_loads():
    config = load(None, ["camera.pixel=20"])
    rng, rate = np.random.default_rng(2), config.forces.sample_rate
    loads = np.array([0.0, 0.05, 0.1, 0.2, 0.4, 0.2, 0.05])
    radii = 40 + 100 * loads
    pictures = list(photographs(radii[1:], rng))
    force = np.repeat(loads, rate) + rng.normal(0, 1e-3, rate * len(loads))
    force[2 * rate : 3 * rate] += np.linspace(0, 0.5, rate)  # the block moves: not used
    triggers = np.zeros(len(loads), [("index", int), ("sample", int), ("received", bool)])
    triggers["index"], triggers["received"] = np.arange(len(loads)), True
    triggers["sample"] = (np.arange(len(loads)) + 0.5) * rate
    reader = SimpleNamespace(
        triggers=lambda: triggers,
        forces=lambda: SimpleNamespace(forces=np.stack([force, 0 * force], axis=1)),
        frame=lambda index: (index, 0, pictures[index]),
    )
    found = smooth_contacts._of_session(reader, config)
    kept = np.delete(np.arange(1, len(loads)), 1)
    np.testing.assert_allclose(found["a"], radii[kept] * 20e-6, atol=0.1 * 20e-6)
    np.testing.assert_allclose(found["P"], loads[kept], atol=3e-4)
    assert found["unloading"].tolist() == [False, False, False, True, True]
    every = range(len(loads) - 1)  # two pictures of each contact are one point
    triggers = np.concatenate([triggers[:1], *(triggers[[i + 1, i + 1]] for i in every)])
    again = smooth_contacts._of_session(reader, config)
    np.testing.assert_allclose(again["a"], found["a"])
    assert np.all(again["a_sd"] >= 5e-4 * again["a"])
    triggers["received"] = False
    with pytest.raises(ValueError, match="no picture shows a contact"):
        smooth_contacts._of_session(reader, config)


def test_the_force_of_a_picture_is_that_of_the_middle_of_its_exposure():
    config = load(None, ["camera.pixel=20", "camera.exposure=20"])
    pictures = list(photographs([90.0], np.random.default_rng(2)))
    force = 0.3 + 1e-4 * np.arange(2000)  # newtons a millisecond: hardly anything while it exposes
    triggers = np.array(
        [(0, 300, True), (1, 1500, True)], [("index", int), ("sample", int), ("received", bool)]
    )
    reader = SimpleNamespace(
        triggers=lambda: triggers,
        forces=lambda: SimpleNamespace(forces=np.stack([force, 0 * force], axis=1)),
        frame=lambda index: (index, 0, pictures[index]),
    )
    found = smooth_contacts._of_session(reader, config)
    np.testing.assert_allclose(found["P"], 0.3 + 1e-4 * 1510, atol=1e-4)


def test_runs_of_several_loads_give_the_extension(tmp_path, monkeypatch):
    config, radii = load(None, ()), world.apparent_radii()

    class Reader:
        def __init__(self, path):
            self.number = int(path.stem)
            self.path = path

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        @property
        def header(self):
            about = {"started": "2026-01-01T00:00:00+00:00", "operator": "", "sample": ""}
            return SimpleNamespace(config_toml=to_toml(config), **about)

        def contact(self):
            held = {"apparent_radius_m": radii[self.number % 6], "apparent_radius_sd_m": 2e-5}
            return SimpleNamespace(**held) if self.number < 6 else None

        @property
        def outcome(self):
            P = world.LOADS[self.number % 6]
            return SimpleNamespace(summary=SimpleNamespace(normal_force_n=P))

    monkeypatch.setattr("app.calibrations.session_readings.SessionReader", Reader)
    paths = [tmp_path / f"{i}.h5" for i in range(7)]
    for path in paths:
        path.touch()
    found = evaluated(RadiusCalibration(), paths[:6], RadiusOptions())
    assert known(found)["modulus_pa"][0] == pytest.approx(3.43e6)
    assert known(found)["extension_m"][0] == pytest.approx(277e-6, rel=2e-3)
    assert found.certificate.settings == {}
    assert any("Hertz's contact does not hold" in one for one in found.result.remarks)
    with pytest.raises(UserError, match="was not measured"):
        evaluated(RadiusCalibration(), paths, RadiusOptions())
