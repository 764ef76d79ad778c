"""h of surfaces of known spectrum, with its stated uncertainty, and what is refused."""

import numpy as np
import pytest
from hidden_samples import LENGTH, PITCH, SIDE, H, height_map, rough, rough_affine, surface
from seeds import SEEDS, errors, holds, pulls, seen_by

from analysis.calibration.roughness import roughness


@pytest.mark.parametrize("kind", [rough, rough_affine])
def test_hidden_h_lies_within_its_stated_uncertainty(kind):
    (found,) = seen_by(kind, SEEDS // 2).values()
    holds(pulls(found))
    off = np.abs(errors(found))
    assert np.sqrt(np.mean(np.square(off))) < 0.013
    assert np.percentile(off, 85) < 0.02


def test_correlation_length_and_number_of_hills_are_those_of_the_spectrum():
    found = roughness(surface(), PITCH)
    assert found.correlation_length == pytest.approx(LENGTH, rel=0.03)
    # of exp(-(r/l)^2) the square has the integral pi l^2/2
    exact = (SIDE * PITCH) ** 2 / (np.pi * LENGTH**2 / 2)
    assert found.asperities == pytest.approx(exact, rel=0.1)


def test_the_spectrum_adds_up_to_the_variance_and_has_its_shape():
    found = roughness(surface(shape=(300, 420)), PITCH, form="none")
    q, power = found.wavenumber, found.spectrum
    exact = np.pi * LENGTH**2 * H**2 * np.exp(-((q * LENGTH) ** 2) / 4)
    some = (q > 1e5) & (q < 8e5)
    assert np.mean(power[some] / exact[some]) == pytest.approx(1, abs=0.05)
    total = np.trapezoid(power * q, q) / (2 * np.pi)
    assert total == pytest.approx(found.h**2, rel=0.1)


def test_a_wave_beyond_the_band_does_not_count():
    z = surface()
    x = np.arange(SIDE) * PITCH
    wave = 0.5e-6 * np.sin(2 * np.pi * x / 64e-6)
    with_wave = roughness(z + wave, PITCH, form="none")
    assert with_wave.h**2 == pytest.approx(H**2 + 0.5e-6**2 / 2, rel=0.05)
    cut = roughness(z + wave, PITCH, form="none", longest=40e-6)
    plain = roughness(z, PITCH, form="none", longest=40e-6)
    assert cut.h == pytest.approx(plain.h, rel=0.01)
    assert (cut.longest, cut.shortest) == (40e-6, 2 * PITCH)


def test_holes_spikes_and_form_change_nothing():
    plain, spoiled = roughness(surface(3), PITCH), roughness(height_map(3), PITCH)
    assert spoiled.h == pytest.approx(plain.h, rel=2e-3)
    assert spoiled.spikes > 1e-4
    assert 0.95 < spoiled.known < 0.99
    assert not plain.notes
    assert np.isnan(spoiled.residual).any()


def test_the_scale_of_the_heights_adds_to_the_uncertainty():
    plain, scaled = roughness(surface(), PITCH), roughness(surface(), PITCH, scale_sd=0.02)
    assert scaled.h_sd == pytest.approx(np.hypot(plain.h_sd, 0.02 * plain.h))


def test_noise_is_told_and_allowed_for():
    z = surface() + np.random.default_rng(1).normal(0, 0.25 * H, (SIDE, SIDE))
    found = roughness(z, PITCH)
    assert "flat at its short end" in found.notes[0]
    assert abs(found.h - H) < 2 * found.h_sd
    assert abs(roughness(z, PITCH, shortest=6e-6).h / H - 1) < 0.02


def stripes(z):
    return z + np.random.default_rng(2).normal(0, 0.3 * H, (len(z), 1))


@pytest.mark.parametrize(
    ("spoiled", "word"),
    [
        (lambda z: z[:40], "shape"),
        (lambda z: z[0], "shape"),
        (lambda z: z * 0, "equal"),
        (lambda z: z * np.nan, "was measured"),
        (lambda z: np.where(np.random.default_rng(1).random(z.shape) < 0.4, np.inf, z), "measured"),
        (lambda z: np.clip(z, -1.5 * H, 1.5 * H), "clipped"),
        (lambda z: np.round(z / (2 * H)) * 2 * H, "resolved"),
        (lambda z: np.random.default_rng(1).normal(0, H, z.shape), "not resolved"),
        (stripes, "rows .* level"),
        (lambda z: stripes(z).T, "columns .* level"),
        (lambda z: surface(length=60e-6), "independent hills"),
        (lambda z: surface(length=1, hurst=0.8), "independent hills"),  # of a spectrum without end
        (lambda z: z + 1e-5 * (np.random.default_rng(1).random(z.shape) < 0.1), "stand out"),
    ],
)
def test_what_is_no_map_of_a_rough_surface_is_refused(spoiled, word):
    with pytest.raises(ValueError, match=f"roughness: .*({word})"):
        roughness(spoiled(surface()), PITCH)


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"pitch": 0.0}, "pitch"),
        ({"pitch": PITCH, "form": "cubic"}, "form"),
        ({"pitch": PITCH, "longest": 1e-6, "shortest": 2e-6}, "wavelengths"),
    ],
)
def test_options_that_mean_nothing_are_refused(given, word):
    with pytest.raises(ValueError, match=f"roughness: .*{word}"):
        roughness(surface(), **given)
