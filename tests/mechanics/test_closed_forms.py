"""Every closed form of the sheared contact, at 40 digits, by quadrature of what defines it."""

import mpmath as mp
import numpy as np
import pytest

from analysis.mechanics import cattaneo_mindlin as cm, hertz

MU, P, A, E = 0.9375, 0.5, 2.0**-9, 3.43e6  # mu P is exact
LIMIT = MU * P
PARTS = (1e-12, 1e-9, 1e-4, 0.3, 0.6, 0.97, 1 - 1e-6, 1.0)
NUS = (0.0, 0.2, 0.5)
RTOL = 1e-10


@pytest.fixture(autouse=True)
def digits():
    with mp.workdps(40):
        yield


def exact_share(Q):
    return mp.cbrt(1 - mp.mpf(Q) / mp.mpf(LIMIT))


def radii(Q):
    """From the centre to 100 a, on both sides of c and a, and between them however close they
    are.
    """
    share = float(exact_share(Q))
    return A * np.unique(
        [0, 1e-3, 0.4, share * 0.999, (1 + share) / 2, 1, 1 + 1e-9, 1.3, 2.9, 10, 100]
    )


def summed(r, Q):
    """Sum over the contact of the traction sqrt(a^2 - s^2) - sqrt(c^2 - s^2) by its distance, plain
    and times cos of twice the direction.

    In polar coordinates about the point the kernel leaves the traction itself; along a chord of
    half length h its sum is pi h^2/2.
    """
    a, c, r = mp.mpf(A), A * exact_share(Q), mp.mpf(float(r))
    ends = sorted({mp.mpf(0), mp.pi / 2} | {mp.asin(e / r) for e in (a, c) if e < r})

    def chords(direction):
        miss = (r * mp.sin(direction)) ** 2
        return max(a * a - miss, 0) - max(c * c - miss, 0)

    return mp.pi * mp.quad(chords, ends), mp.pi * mp.quad(lambda t: chords(t) * mp.cos(2 * t), ends)


def relative(found, exact, scale=0):
    return float(abs((mp.mpf(float(found)) - exact) / (abs(exact) if exact else scale)))


@pytest.mark.parametrize("part", PARTS)
def test_displacement_inside_and_outside_to_ten_digits(part):
    Q = part * LIMIT
    x, y = np.array([[1.0], [0.96]]) * radii(Q), np.array([[0.0], [0.28]]) * radii(Q)
    r = np.hypot(x, y)
    exact = np.array([summed(value, Q) for value in r.ravel()])
    double_angle = [
        2 * mp.atan2(mp.mpf(v), mp.mpf(u)) for u, v in zip(x.ravel(), y.ravel(), strict=True)
    ]
    for nu in NUS:
        scale = (
            3
            * mp.mpf(LIMIT)
            / (2 * mp.pi * mp.mpf(A) ** 3)
            * (1 + mp.mpf(nu))
            / (mp.pi * mp.mpf(E))
        )
        mean, double = scale * (1 - mp.mpf(nu) / 2) * exact[:, 0], scale * nu / 2 * exact[:, 1]
        g0, g2 = (g.ravel() for g in cm.radial_displacement(r, Q, MU, P, A, E, nu))
        gx, gy = (g.ravel() for g in cm.displacement(x, y, Q, MU, P, A, E, nu))
        for i, angle in enumerate(double_angle):
            assert relative(g0[i], mean[i]) < RTOL
            assert relative(gx[i], mean[i] + double[i] * mp.cos(angle)) < RTOL
            # nothing to turn; in the stick zone nothing turns
            if nu == 0 or mp.mpf(r.ravel()[i]) <= A * exact_share(Q):
                assert g2[i] == gy[i] == 0
            else:
                assert relative(g2[i], double[i]) < RTOL
                assert relative(gy[i], double[i] * mp.sin(angle), mean[i]) < RTOL


@pytest.mark.parametrize("x", [0.0, 1e-9, 0.5, 1.0, 1 + 1e-12, 1.001, 2.8, 3.0, 100.0, 1e6])
def test_phi_to_ten_digits(x):
    plain, double = summed(x * A, LIMIT)
    assert relative(cm.phi0(x * A, A), plain / A) < RTOL
    assert cm.phi2(x * A, A) == 0 if x == 0 else relative(cm.phi2(x * A, A), double / A) < RTOL


@pytest.mark.parametrize("part", PARTS)
def test_traction_stick_radius_shift_and_force_to_ten_digits(part):
    Q = part * LIMIT
    share = exact_share(Q)
    c, a = A * share, mp.mpf(A)
    p0 = 3 * mp.mpf(LIMIT) / (2 * mp.pi * a**2)
    assert relative(cm.stick_radius(Q, LIMIT, A), c, A) < RTOL
    for r in radii(Q):
        s = mp.mpf(float(r))
        exact = p0 / a * (mp.sqrt(max(a * a - s * s, 0)) - mp.sqrt(max(c * c - s * s, 0)))
        assert relative(cm.traction(r, Q, MU, P, A), exact, p0) < RTOL
    for nu in NUS:
        # the shift is the displacement of the centre
        plain, _ = summed(0.0, Q)
        exact = p0 / a * (1 + mp.mpf(nu)) / (mp.pi * mp.mpf(E)) * (1 - mp.mpf(nu) / 2) * plain
        delta = cm.shift(Q, MU, P, A, E, nu)
        assert relative(delta, exact) < RTOL
        if part < 1 - 1e-5:
            assert relative(cm.shear_force(delta, MU, P, A, E, nu), mp.mpf(Q)) < RTOL
            distance = float(delta) + 1e-4 * Q
            assert (
                relative(cm.driven_shear_force(distance, 1e-4, MU, P, A, E, nu), mp.mpf(Q)) < RTOL
            )


@pytest.mark.parametrize("part", [0.4, 1.0])
@pytest.mark.parametrize("share", [0.2, 0.9, 1.5, 60.0])
def test_the_ring_mean_of_the_displacement_is_its_isotropic_part(part, share):
    angle, rest = 2 * np.pi * np.arange(16) / 16, (part * LIMIT, MU, P, A, E, 0.5)
    gx, gy = cm.displacement(share * A * np.cos(angle), share * A * np.sin(angle), *rest)
    assert gx.mean() == pytest.approx(float(cm.radial_displacement(share * A, *rest)[0]), rel=1e-12)
    assert gy.mean() == pytest.approx(0, abs=1e-14 * gx.max())


def test_what_is_pushed_the_other_way_goes_the_other_way():
    r = radii(0.3 * LIMIT)
    for force in (cm.traction, lambda r, *rest: cm.radial_displacement(r, *rest, E, 0.4)[1]):
        np.testing.assert_array_equal(
            force(r, -0.3 * LIMIT, MU, P, A), -np.asarray(force(r, 0.3 * LIMIT, MU, P, A))
        )


@pytest.mark.parametrize("there", [cm.shift, cm.shear_force])
def test_shift_and_force_have_the_sign_of_what_drives_them(there):
    about = (MU, P, A, E, 0.4)
    reach = LIMIT if there is cm.shift else cm.full_shift(*about)
    way = np.array([0.1, 0.6, 0.99]) * reach
    assert (there(way, *about) > 0).all()
    np.testing.assert_array_equal(there(-way, *about), -there(way, *about))


def test_a_contact_without_force_is_at_rest():
    r = np.linspace(0, 3 * A, 7)
    assert (cm.traction(r, 0.0, MU, P, A) == 0).all()
    assert (cm.traction(r, 0.0, MU, 0.0, A) == 0).all()
    assert (np.array(cm.radial_displacement(r, 0.0, MU, P, A, E, 0.5)) == 0).all()
    assert (hertz.pressure(r, 0.0, 0.0) == 0).all()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cm.traction(0.0, 1.01 * LIMIT, MU, P, A), "slides at mu P"),
        (lambda: cm.traction(0.0, np.nan, MU, P, A), "slides at mu P"),
        (lambda: cm.displacement(0.0, 0.0, 0.1, MU, P, A, E, 0.51), "Poisson's ratio 0.51"),
        (lambda: cm.displacement(0.0, 0.0, 0.1, MU, P, A, -E, 0.5), "E = -3.43e"),
        (lambda: cm.radial_displacement(0.0, 0.1, MU, P, 0.0, E, 0.5), "radius = 0"),
        (lambda: cm.radial_displacement(0.0, 0.1, 0.0, P, A, E, 0.5), "mu = 0"),
        (lambda: cm.shift(0.1, MU, -P, A, E, 0.5), "limit = -"),
        (lambda: cm.shear_force(1e-6, MU, 0.0, A, E, 0.5), "limit = 0"),
        (lambda: cm.driven_shear_force(1e-6, 0.0, MU, P, A, E, np.nan), "Poisson's ratio nan"),
        (lambda: cm.stick_radius(0.1, 0.0, A), "limit = 0"),
        (lambda: hertz.contact_radius(-0.1, E, 0.5, 0.1), "P = -0.1"),
        (lambda: hertz.contact_radius(0.1, E, -0.1, 0.1), "Poisson's ratio -0.1"),
        (lambda: hertz.contact_radius(0.1, E, 0.5, np.inf), "R = inf"),
        (lambda: hertz.pressure(0.0, 0.1, 0.0), "radius 0"),
        (lambda: hertz.indentation(-1e-3, 0.1), "a = -0.001"),
    ],
)
def test_what_no_contact_has_is_refused_in_a_sentence(call, words):
    with pytest.raises(ValueError, match=words):
        call()
