"""The measured pressure against its models: the uncertainty of what is told of its width."""

import numpy as np

from analysis.friction.local_law import LocalLaw
from analysis.friction.pressure import check_pressure
from analysis.mechanics import greenwood_tripp, hertz

P, E, NU, R = 0.5, 3.43e6, 0.5, 0.1288


def test_the_uncertainty_of_the_width_is_its_scatter():
    """Errors of the rings are those of a smoothed profile: each is alike with its neighbours'."""
    a = hertz.contact_radius(P, E, NU, R)
    r = (np.arange(30) + 0.5) * 1.1 * a / 30
    true = hertz.pressure(r, P, a)
    rng, sd, pulls, moduli = np.random.default_rng(5), 0.02 * true[0], [], []
    for _ in range(200):
        white = rng.normal(size=len(r) + 2)
        noise = sd * (white[:-2] + white[1:-1] + white[2:]) / np.sqrt(3)
        law = LocalLaw(E=E, E_sd=1e3, radius=r, pressure=true + noise, pressure_sd=np.full(30, sd))
        found = check_pressure(law, P, NU, R, 0.0)
        pulls.append((found.effective_radius - a) / found.effective_radius_sd)
        moduli.append((found.E - E) / found.E_sd)
    for pull in (pulls, moduli):
        assert 0.75 < np.std(pull) < 1.3
        assert abs(np.mean(pull)) < 0.3


def test_a_roughness_that_does_not_matter_leaves_the_pressure_of_hertz():
    a = hertz.contact_radius(P, E, NU, R)
    r = (np.arange(30) + 0.5) * 1.1 * a / 30
    law = LocalLaw(E=E, radius=r, pressure=hertz.pressure(r, P, a), pressure_sd=np.full(30, 1e3))
    smooth, rough = (
        check_pressure(law, P, NU, R, share * greenwood_tripp.SMOOTHEST * a**2 / R).rough
        for share in (0.9, 1.1)
    )
    np.testing.assert_array_equal(smooth, hertz.pressure(r, P, a))
    assert 0 < np.abs(rough - smooth).max() < 0.05 * smooth[0]
