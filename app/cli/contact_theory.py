"""A sphere pressed on a rough block and sheared, as theory has it: numbers and curves."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64
from analysis.mechanics import cattaneo_mindlin, greenwood_tripp, hertz, jkr
from analysis.mechanics.interface import elastic_length
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from app.records.quantities import Measurement
from app.settings.sections import ModelSettings
from app.system.errors import UserError

POINTS = 301  # points of a curve; one more lies at the stick radius
WIDEST = 3.0  # contact radii that the curves over r reach to
FARTHEST = 1.5  # times the shift at which Cattaneo and Mindlin's contact slides: end of Q(delta)
SHARP = 2e-3  # an elastic length below this part of that shift needs more modes
FAINT = 0.01  # share of the peak pressure at which a rough contact is taken to end


class ShearedContact:
    """The contact under a shear force Q: that of Cattaneo and Mindlin, and beside it that of a
    rough interface if its elastic length is not 0.

    A length below 1e-4 of the shift at which Cattaneo and Mindlin's contact slides leaves an edge
    that the modes resolve to 0.5 % of mu p0.

    Raises
    ------
    UserError
        The contact is too wide for Hertz.
    ValueError
        It cannot be solved.
    """

    def __init__(self, system: ModelSettings, Q: float) -> None:
        self.system, self.Q = system, Q
        P, E, nu, R = system.normal_force, system.modulus, system.poisson, system.radius
        L, h = system.length, system.roughness
        a = hertz.contact_radius(P, E, nu, R)
        if a > R / 2:
            raise UserError(
                f"a contact of radius {a * 1e3:.3g} mm found, too wide for Hertz; press less"
                f" on this sphere of {R * 1e3:g} mm"
            )
        self.a = a
        self.cm = system.friction, P, a, E, nu
        self.shift_cm = float(cattaneo_mindlin.shift(Q, *self.cm))
        self.loading: AxisymmetricLoading | None = None
        self.state: LoadingState | None = None
        if L > 0:
            contact = SphereContact(P, E, nu, R, system.friction, L, system.depth)
            modes = 64 if L / contact.full_shift > SHARP else 128
            self.loading = AxisymmetricLoading(contact, modes)
            self.state = self.loading.at_force(Q)
        self.shift = self.state.D if self.state else self.shift_cm
        # below this roughness Hertz's pressure is right to 0.2 %
        is_rough = h * R / a**2 >= greenwood_tripp.SMOOTHEST
        self.rough = greenwood_tripp.rough_contact(P, E, nu, R, h) if is_rough else None

    def numbers(self) -> list[Measurement]:
        """The results, in the order in which they are shown."""
        s, Q, a = self.system, self.Q, self.a
        P, R, limit = s.normal_force, s.radius, s.friction * s.normal_force
        p0 = hertz.peak_pressure(P, a)
        c = float(cattaneo_mindlin.stick_radius(Q, limit, a))
        sliding = cattaneo_mindlin.full_shift(*self.cm)
        smooth = 8 * hertz.shear_modulus(s.modulus, s.poisson) * a / (2 - s.poisson)
        share = f"shear force, {Q / limit:.4g} of the greatest"
        found: list[tuple[str, str, str, float, str]] = [
            ("normal_force_n", "normal force", "P", P, "N"),
            ("young_modulus_pa", "Young's modulus", "E", s.modulus, "MPa"),
            ("poisson", "Poisson's ratio", "nu", s.poisson, ""),
            ("sphere_radius_m", "radius of the sphere", "R", R, "mm"),
            ("friction", "friction coefficient", "mu", s.friction, ""),
            ("shear_force_n", share, "Q", Q, "N"),
            ("friction_limit_n", "greatest shear force", "mu P", limit, "N"),
            ("hertz_radius_m", "contact radius, Hertz", "a_H", a, "mm"),
            ("peak_pressure_pa", "pressure at the centre, Hertz", "p0", p0, "kPa"),
            ("indentation_m", "indentation, Hertz", "a_H^2/R", hertz.indentation(a, R), "um"),
            ("stick_radius_m", "stick radius, Cattaneo-Mindlin", "c", c, "mm"),
            ("block_shift_m", "displacement of the block", "delta", self.shift, "um"),
            ("block_shift_cm_m", "the same, Cattaneo-Mindlin", "delta", self.shift_cm, "um"),
            ("sliding_shift_m", "at which Cattaneo-Mindlin's slides", "delta_max", sliding, "um"),
            ("stiffness_smooth_n_per_m", "contact stiffness at rest, smooth", "8 G a/(2-nu)",
              smooth, "N/mm"),
        ]  # fmt: skip
        if self.loading and self.state:
            start, peak = self.loading.at_block(0.0).stiffness, self.state.peak_radius
            k, slip = p0 / s.length, self._ux_seen(np.zeros(1))[0].item()
            found += [
                ("stiffness_rough_n_per_m", "the same, rough interface", "dQ/ddelta", start,
                  "N/mm"),
                ("elastic_length_m", "elastic length of the interface", "L", s.length, "um"),
                ("interface_stiffness_pa_per_m", "its stiffness at the centre", "p0/L", k,
                  "kPa/um"),
                ("peak_radius_m", "where the traction is greatest", "r", peak, "mm"),
                ("centre_slip_m", "displacement at the centre", "u_x(0)", slip, "um"),
            ]  # fmt: skip
        if s.thickness:
            found.append(("thickness_m", "thickness of the block", "H", s.thickness, "mm"))
        if s.roughness > 0:
            h, apparent = s.roughness, greenwood_tripp.apparent_radius(a, R, s.roughness)
            length = elastic_length(h, s.poisson)
            found += [
                ("roughness_m", "standard deviation of the heights", "h", h, "um"),
                ("bureau_length_m", "L of a surface of this roughness", "L(h)", length, "um"),
                ("apparent_radius_m", "apparent radius", "a_H + sqrt(R h)", apparent, "mm"),
            ]
        if self.rough:
            rough, faint = self.rough, f"radius of {FAINT:.0%} of its peak pressure"
            found += [
                ("roughness_parameter", "roughness, Greenwood-Tripp", "alpha", rough.alpha, ""),
                ("effective_radius_m", "effective radius", "a*", rough.effective_radius, "mm"),
                ("faint_radius_m", faint, "", rough.radius_at(FAINT), "mm"),
                ("rough_peak_pressure_pa", "its peak pressure", "p(0)", rough.peak_pressure, "kPa"),
            ]
        if s.adhesion > 0:
            w, (E, nu) = s.adhesion, (s.modulus, s.poisson)
            radius = float(jkr.contact_radius(P, w, E, nu, R))
            depth, pull = float(jkr.indentation(radius, w, E, nu, R)), jkr.pull_off_force(w, R)
            tabor = jkr.tabor_parameter(w, E, nu, R)
            found += [
                ("jkr_radius_m", "contact radius, JKR", "a", radius, "mm"),
                ("jkr_indentation_m", "indentation, JKR", "", depth, "um"),
                ("jkr_pull_off_n", "pull-off force, JKR", "-3/2 pi w R", pull, "mN"),
                ("tabor_parameter", "Tabor parameter (JKR above 5)", "", tabor, ""),
            ]
        return [
            Measurement(name, symbol, value, unit=unit, key=key)
            for key, name, symbol, value, unit in found
        ]

    def _ux_seen(self, r: F64) -> tuple[F64, F64]:
        """What a camera at rest with the sphere sees at a radius: azimuthal mean of u_x, and the
        amplitude of its part that goes with cos 2 theta.
        """
        g0, g2 = (
            self.state.displacement(r)
            if self.state
            else cattaneo_mindlin.radial_displacement(r, self.Q, *self.cm)
        )
        return self.shift - g0, -g2

    def curves(self) -> dict[str, F64]:
        """Columns of the table: profiles over r, then the force over the displacement of the
        block.
        """
        mu, P, a, *_ = self.cm
        c = cattaneo_mindlin.stick_radius(self.Q, mu * P, a)
        # c is where Cattaneo and Mindlin's traction has its peak
        r = np.union1d(np.linspace(0, WIDEST * a, POINTS), c)
        delta = np.linspace(0, FARTHEST * cattaneo_mindlin.full_shift(*self.cm), len(r))
        mean, double = self._ux_seen(r)
        ux_cm = self.shift_cm - cattaneo_mindlin.radial_displacement(r, self.Q, *self.cm)[0]
        p, sigma_cm = hertz.pressure(r, P, a), cattaneo_mindlin.traction(r, self.Q, mu, P, a)
        Q = Q_cm = cattaneo_mindlin.shear_force(delta, *self.cm)
        if self.loading:
            Q = np.array([state.Q for state in self.loading.table(len(r), float(delta[-1]))])
        return {
            "r_mm": r * 1e3,
            "p_kPa": p * 1e-3,
            "p_rough_kPa": (self.rough.pressure(r) if self.rough else p) * 1e-3,
            "sigma_kPa": (self.state.traction(r) if self.state else sigma_cm) * 1e-3,
            "sigma_cm_kPa": sigma_cm * 1e-3,
            "ux_um": mean * 1e6,
            "ux_cos2_um": double * 1e6,
            "ux_cm_um": ux_cm * 1e6,
            "delta_um": delta * 1e6,
            "Q_N": Q,
            "Q_cm_N": Q_cm,
        }
