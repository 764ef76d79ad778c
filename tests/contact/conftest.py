"""Pictures of a free and of a loaded block whose truth is known: nothing in them is
interpolated.
"""

import numpy as np
import pytest


def _speckle(rng, shape, grain, shift):
    """The same band-limited speckle at rest and moved: the Fourier shift is exact for it (it wraps
    around at the border).
    """
    ky, kx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])
    spectrum = np.fft.rfft2(rng.normal(size=shape)) * np.exp(
        -2 * (np.pi * grain) ** 2 * (kx**2 + ky**2)
    )
    moved = spectrum * np.exp(-2j * np.pi * (kx * shift[0] + ky * shift[1]))
    at_rest = np.fft.irfft2(spectrum, shape)
    return at_rest / at_rest.std(), np.fft.irfft2(moved, shape) / at_rest.std()


def scatter(rng, radius, density, law):
    """Micro-contacts about (0, 0): a Poisson process of density ``density (1 -
    (r/radius)^2)^law``.
    """
    n = rng.poisson(density * 4 * radius**2)
    x, y = rng.uniform(-radius, radius, (2, n))
    share = 1 - (x**2 + y**2) / radius**2
    kept = rng.random(n) < np.where(share > 0, np.abs(share) ** law, 0)
    return x[kept], y[kept]


def _spots(shape, x, y, light, width=1.2, reach=8):
    image = np.zeros((shape[0] + 2 * reach, shape[1] + 2 * reach))
    offset = np.arange(-reach, reach + 1)
    for x0, y0, total in zip(x, y, light, strict=True):
        i, j = round(y0), round(x0)
        if 0 <= i < shape[0] and 0 <= j < shape[1]:
            px, py = (np.exp(-0.5 * ((offset - d) / width) ** 2) for d in (x0 - j, y0 - i))
            image[i : i + 2 * reach + 1, j : j + 2 * reach + 1] += total * np.outer(py, px)
    return image[reach:-reach, reach:-reach]


def _pair(
    seed,
    shape,
    radius,
    centre,
    *,
    shift=(7.3, -3.6),
    law=0.5,
    density=0.003,
    lamp=1.0,
    uneven=0.3,
    noise=2.0,
    peak=80.0,
    passed=1.0,
):
    rng = np.random.default_rng(seed)
    background, loaded = (20 * s for s in _speckle(rng, shape, 1.3, shift))
    x, y = scatter(rng, radius, density, law)
    spots = _spots(shape, x + centre[0], y + centre[1], peak * rng.lognormal(-0.2, 0.6, len(x)))
    v, u = np.mgrid[: shape[0], : shape[1]]
    light = 1 - uneven * (0.5 * u / shape[1] + (v / shape[0] - 0.4) ** 2)

    def picture(clean, brightness):
        grey = clean * light * brightness * passed + rng.normal(0, noise, shape)
        return np.clip(np.round(grey), 0, 255).astype(np.uint8)

    return picture(100 + background, 1.0), picture(100 + loaded + spots, lamp)


@pytest.fixture
def pair():
    """Maker of (background, image): ``pair(seed, shape, radius, (x, y), shift=..., law=...,
    density=..., lamp=..., uneven=..., passed=...)``.
    """
    return _pair


@pytest.fixture
def micro_contact_scatter():
    """Maker of micro-contact positions about (0, 0): ``f(rng, radius, density, law)``."""
    return scatter
