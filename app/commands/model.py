"""`slipscope model`: what theory says of a sphere pressed on a rough block and sheared, as numbers,
a table of curves, or a figure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mechanics import cattaneo_mindlin, greenwood_tripp, hertz, jkr
from analysis.mechanics.interface import elastic_length
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from analysis.options import quantity
from app.commands.names import check_writable
from app.commands.terminal import DONE, output, print_json, print_rows
from app.errors import UserError
from app.report.summary import Row
from app.settings import ModelSettings

F64 = NDArray[np.float64]

SUFFIXES = (".csv", ".png", ".pdf", ".svg")
POINTS = 301  # a is one of them
# of the curves: contact radii, and shifts at which Cattaneo and Mindlin's contact slides
WIDEST, FARTHEST = 3.0, 1.5
SHARP = 2e-3  # a length below this part of that shift asks for more modes
FAINT = 0.01  # of the peak pressure: where a rough contact is taken to end


PER_SI = {"": 1.0, "N": 1.0, "mN": 1e3, "mm": 1e3, "um": 1e6, "kPa": 1e-3, "MPa": 1e-6}
PER_SI |= {"N/mm": 1e-3, "kPa/um": 1e-9}
QUANTITIES = {
    "normal_force_n": ("normal force", "P", "N"),
    "young_modulus_pa": ("Young's modulus", "E", "MPa"),
    "poisson": ("Poisson's ratio", "nu", ""),
    "sphere_radius_m": ("radius of the sphere", "R", "mm"),
    "friction": ("friction coefficient", "mu", ""),
    "shear_force_n": ("shear force, {share:.4g} of the greatest", "Q", "N"),
    "friction_limit_n": ("greatest shear force", "mu P", "N"),
    "hertz_radius_m": ("contact radius, Hertz", "a_H", "mm"),
    "peak_pressure_pa": ("pressure at the centre, Hertz", "p0", "kPa"),
    "indentation_m": ("indentation, Hertz", "a_H^2/R", "um"),
    "stick_radius_m": ("stick radius, Cattaneo-Mindlin", "c", "mm"),
    "block_shift_m": ("displacement of the block", "delta", "um"),
    "block_shift_cm_m": ("the same, Cattaneo-Mindlin", "delta", "um"),
    "sliding_shift_m": ("at which Cattaneo-Mindlin's slides", "delta_max", "um"),
    "stiffness_smooth_n_per_m": ("contact stiffness at rest, smooth", "8 G a/(2-nu)", "N/mm"),
    "stiffness_rough_n_per_m": ("the same, rough interface", "dQ/ddelta", "N/mm"),
    "elastic_length_m": ("elastic length of the interface", "L", "um"),
    "interface_stiffness_pa_per_m": ("its stiffness at the centre", "p0/L", "kPa/um"),
    "peak_radius_m": ("where the traction is greatest", "r", "mm"),
    "centre_slip_m": ("displacement at the centre", "u_x(0)", "um"),
    "thickness_m": ("thickness of the block", "H", "mm"),
    "roughness_m": ("standard deviation of the heights", "h", "um"),
    "bureau_length_m": ("L of a surface of this roughness", "L(h)", "um"),
    "apparent_radius_m": ("apparent radius", "a_H + sqrt(R h)", "mm"),
    "roughness_parameter": ("roughness, Greenwood-Tripp", "alpha", ""),
    "effective_radius_m": ("effective radius", "a*", "mm"),
    "faint_radius_m": (f"radius of {FAINT:.0%} of its peak pressure", "", "mm"),
    "rough_peak_pressure_pa": ("its peak pressure", "p(0)", "kPa"),
    "jkr_radius_m": ("contact radius, JKR", "a", "mm"),
    "jkr_indentation_m": ("indentation, JKR", "", "um"),
    "jkr_pull_off_n": ("pull-off force, JKR", "-3/2 pi w R", "mN"),
    "tabor_parameter": ("Tabor parameter (JKR above 5)", "", ""),
}
"""Key of a result, in SI -> label, symbol and unit for people."""


def model(
    system: ModelSettings,
    path: Path | None,
    shear_force: float | None,
    share: float | None,
    *,
    overwrite: bool,
    as_json: bool,
) -> int:
    """Print the numbers of a contact and write its curves; the exit code."""
    if path is not None:
        if path.suffix.lower() not in SUFFIXES:
            raise UserError(
                f"{path}: results are written as {', '.join(SUFFIXES)}; give such an ending"
            )
        check_writable(path)
        if path.exists() and not overwrite:
            raise UserError(
                f"{path}: a file of that name exists; choose another name or give --overwrite"
            )
    Q = _force(system, shear_force, share)
    try:
        sheared = Sheared(system, Q)
        numbers = sheared.numbers()
        curves = sheared.curves() if path is not None else {}
    except ValueError as error:
        raise UserError(f"this contact can not be solved: {error}") from None
    if path is not None:
        _write(path, numbers, curves, sheared)
    if as_json:
        print_json(numbers)
        return DONE
    print_rows("sphere on a block, pressed and sheared", _rows(numbers))
    if path is not None:
        output().print(f"written: {path}")
    return DONE


def _force(system: ModelSettings, shear_force: float | None, share: float | None) -> float:
    """The shear force Q in newtons, from whichever of the two is given."""
    if shear_force is not None and share is not None:
        raise UserError("--shear-force and --share: both were given; give one of them")
    limit = system.friction * system.normal_force
    Q = limit * (0.6 if share is None else share) if shear_force is None else shear_force
    if not 0 <= Q <= limit:
        raise UserError(
            f"Q = {Q:g} N is not possible; give 0 to mu P = {limit:g} N, by --shear-force or as a"
            " --share of it"
        )
    if limit <= Q and system.length > 0:
        raise UserError("a rough interface only approaches Q = mu P; give less, or --length 0")
    return Q


class Sheared:
    """The contact under Q: that of Cattaneo and Mindlin and, if the elastic length is not 0, that of a
    rough interface.

    With a length below 1e-4 of the shift at which Cattaneo and Mindlin's contact slides, the modes
    represent the edge of the contact to 0.5 % of mu p0.
    """

    def __init__(self, system: ModelSettings, Q: float) -> None:
        self.system, self.Q = system, Q
        self.P, self.E, self.nu, self.R = (
            system.normal_force,
            system.modulus,
            system.poisson,
            system.radius,
        )
        self.L, self.h = system.length, system.roughness
        self.a = hertz.contact_radius(self.P, self.E, self.nu, self.R)
        if self.a > self.R / 2:
            raise UserError(
                f"a contact of radius {self.a * 1e3:.3g} mm found, too wide for Hertz; press less"
                f" on this sphere of {quantity(system, 'radius')}"
            )
        self.cm = system.friction, self.P, self.a, self.E, self.nu
        self.loading: AxisymmetricLoading | None = None
        self.state: LoadingState | None = None
        if self.L > 0:
            contact = SphereContact(
                self.P, self.E, self.nu, self.R, system.friction, self.L, system.depth
            )
            self.loading = AxisymmetricLoading(
                contact, 64 if self.L / contact.full_shift > SHARP else 128
            )
            self.state = self.loading.at_force(Q)
        self.rough: greenwood_tripp.RoughContact | None = None
        # below, Hertz's pressure is right to 0.2 %
        if self.h * self.R / self.a**2 >= greenwood_tripp.SMOOTHEST:
            self.rough = greenwood_tripp.rough_contact(self.P, self.E, self.nu, self.R, self.h)

    def numbers(self) -> dict[str, float]:
        """The results in SI, by key of `QUANTITIES`, in the order in which they are shown."""
        mu, P, a, E, nu = self.cm
        p0, limit = hertz.peak_pressure(P, a), mu * P
        shift = float(cattaneo_mindlin.shift(self.Q, *self.cm))
        found = {
            "normal_force_n": P,
            "young_modulus_pa": E,
            "poisson": nu,
            "sphere_radius_m": self.R,
            "friction": mu,
            "shear_force_n": self.Q,
            "friction_limit_n": limit,
            "hertz_radius_m": a,
            "peak_pressure_pa": p0,
            "indentation_m": hertz.indentation(a, self.R),
            "stick_radius_m": float(cattaneo_mindlin.stick_radius(self.Q, limit, a)),
            "block_shift_m": self.state.D if self.state else shift,
            "block_shift_cm_m": shift,
            "sliding_shift_m": cattaneo_mindlin.full_shift(*self.cm),
            "stiffness_smooth_n_per_m": 8 * hertz.shear_modulus(E, nu) * a / (2 - nu),
        }
        if self.loading and self.state:
            found |= {
                "stiffness_rough_n_per_m": self.loading.at_block(0.0).stiffness,
                "elastic_length_m": self.L,
                "interface_stiffness_pa_per_m": p0 / self.L,
                "peak_radius_m": self.state.peak_radius,
                "centre_slip_m": self._seen(np.zeros(1))[0].item(),
            }
        if self.system.thickness:
            found["thickness_m"] = self.system.thickness
        if self.h > 0:
            found |= {
                "roughness_m": self.h,
                "bureau_length_m": elastic_length(self.h, nu),
                "apparent_radius_m": greenwood_tripp.apparent_radius(a, self.R, self.h),
            }
        if self.rough:
            found |= {
                "roughness_parameter": self.rough.alpha,
                "effective_radius_m": self.rough.effective_radius,
                "faint_radius_m": self.rough.radius_at(FAINT),
                "rough_peak_pressure_pa": self.rough.peak_pressure,
            }
        return found | self._adhesive()

    def _adhesive(self) -> dict[str, float]:
        w = self.system.adhesion
        if w == 0:
            return {}
        a = float(jkr.contact_radius(self.P, w, self.E, self.nu, self.R))
        return {
            "jkr_radius_m": a,
            "jkr_indentation_m": float(jkr.indentation(a, w, self.E, self.nu, self.R)),
            "jkr_pull_off_n": jkr.pull_off_force(w, self.R),
            "tabor_parameter": jkr.tabor_parameter(w, self.E, self.nu, self.R),
        }

    def _seen(self, r: F64) -> tuple[F64, F64]:
        """Displacement as a camera at rest with the sphere sees it: the azimuthal mean of u_x, and the
        amplitude of its part in cos 2 theta.
        """
        D = self.state.D if self.state else float(cattaneo_mindlin.shift(self.Q, *self.cm))
        g0, g2 = (
            self.state.displacement(r)
            if self.state
            else cattaneo_mindlin.radial_displacement(r, self.Q, *self.cm)
        )
        return D - g0, -g2

    def curves(self) -> dict[str, F64]:
        """Columns of the table: profiles over r, then the force over the displacement of the block."""
        mu, P, a, *_ = self.cm
        c = cattaneo_mindlin.stick_radius(self.Q, mu * P, a)
        # c is the peak of Cattaneo and Mindlin's traction
        r = np.union1d(np.linspace(0, WIDEST * a, POINTS), c)
        delta = np.linspace(0, FARTHEST * cattaneo_mindlin.full_shift(*self.cm), len(r))
        mean, double = self._seen(r)
        cm = cattaneo_mindlin.radial_displacement(r, self.Q, *self.cm)[0]
        sigma_cm, Q_cm = (
            cattaneo_mindlin.traction(r, self.Q, mu, P, a),
            cattaneo_mindlin.shear_force(delta, *self.cm),
        )
        Q = (
            np.array([state.Q for state in self.loading.table(len(r), float(delta[-1]))])
            if self.loading
            else Q_cm
        )
        return {
            "r_mm": r * 1e3,
            "p_kpa": hertz.pressure(r, P, a) * 1e-3,
            "p_rough_kpa": (self.rough.pressure(r) if self.rough else hertz.pressure(r, P, a))
            * 1e-3,
            "sigma_kpa": (self.state.traction(r) if self.state else sigma_cm) * 1e-3,
            "sigma_cm_kpa": sigma_cm * 1e-3,
            "ux_um": mean * 1e6,
            "ux_cos2_um": double * 1e6,
            "ux_cm_um": (float(cattaneo_mindlin.shift(self.Q, *self.cm)) - cm) * 1e6,
            "delta_um": delta * 1e6,
            "q_n": Q,
            "q_cm_n": Q_cm,
        }


def _rows(numbers: dict[str, float]) -> list[Row]:
    rows, share = [], numbers["shear_force_n"] / numbers["friction_limit_n"]
    for key, value in numbers.items():
        label, symbol, unit = QUANTITIES[key]
        rows.append(
            Row(label.format(share=share), symbol, f"{value * PER_SI[unit]:.4g} {unit}".rstrip())
        )
    return rows


def _write(path: Path, numbers: dict[str, float], curves: dict[str, F64], sheared: Sheared) -> None:
    if path.suffix.lower() != ".csv":
        _figure(path, curves, sheared)
        return
    lines = [f"# {' '.join(filter(None, (r.label, r.symbol)))}: {r.value}" for r in _rows(numbers)]
    lines += [
        "# over r: pressure p (Hertz; rough: Greenwood-Tripp, exponential heights), shear traction"
        " sigma, and displacement seen from the",
        "# sphere, u_x = ux + ux_cos2 cos(2 theta), u_y = ux_cos2 sin(2 theta); over the"
        " displacement delta of the block: shear force q",
        "# cm: Cattaneo-Mindlin, on a half-space",
        ",".join(curves),
    ]
    lines += [
        ",".join(f"{value:.9g}" for value in row) for row in zip(*curves.values(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _figure(path: Path, curves: dict[str, F64], sheared: Sheared) -> None:
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from app.report.figures import BLUE, GREY, RED, STYLE

    system = sheared.system
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes: Any = figure.subplots(2, 2)
        r, p, mu = curves["r_mm"], curves["p_kpa"], system.friction
        (left, right), (low_left, low_right) = axes
        if sheared.rough:
            left.plot(r, curves["p_rough_kpa"], color=BLUE, label="rough (Greenwood-Tripp)")
        left.plot(r, p, "--", color=RED, label="smooth (Hertz)")
        left.set(ylabel="pressure $p$ (kPa)", title="(a) pressure")
        rough = f"rough interface, $L$ = {_in_words(system, 'length')}" if system.length else ""
        smooth = "Cattaneo-Mindlin" + (", half-space" if system.thickness else "")
        pairs = (
            (right, "r_mm", "sigma", "kpa"),
            (low_left, "r_mm", "ux", "um"),
            (low_right, "delta_um", "q", "n"),
        )
        for panel, x, name, unit in pairs:
            if rough:
                panel.plot(curves[x], curves[f"{name}_{unit}"], color=BLUE, label=rough)
            panel.plot(curves[x], curves[f"{name}_cm_{unit}"], "--", color=RED, label=smooth)
        right.plot(r, mu * p, ":", color=GREY, label=r"$\mu p$")
        right.set(
            ylabel=r"shear traction $\sigma_{xz}$ (kPa)",
            title=f"(b) traction at $Q$ = {sheared.Q:.3g} N",
        )
        low_left.set(
            ylabel="$u_x$, mean over the ring (µm)", title="(c) displacement seen from the sphere"
        )
        low_right.axhline(mu * system.normal_force, color=GREY, ls=":", label=r"$\mu P$")
        low_right.set(
            xlabel=r"displacement of the block $\delta$ (µm)",
            ylabel="shear force $Q$ (N)",
            title=r"(d) $Q(\delta)$",
        )
        pressed = r[curves["p_rough_kpa"] > 1e-3 * curves["p_rough_kpa"][0]][-1]
        for panel, end in ((left, 1.1 * pressed), (right, 1.1 * pressed), (low_left, r[-1])):
            panel.set(xlabel="distance from the centre $r$ (mm)", xlim=(0, min(end, r[-1])))
        for panel in axes.ravel():
            panel.set_ylim(bottom=0)
            panel.legend()
        low_right.set_xlim(0, curves["delta_um"][-1])
        layer = f", {_in_words(system, 'thickness')} thick" if system.thickness else ""
        title = (
            f"$P$ = {_in_words(system, 'normal_force')}, $E$ = {_in_words(system, 'modulus')}, ν ="
            f" {system.poisson:g}, $R$ = {_in_words(system, 'radius')},"
            f" µ = {mu:g}, $h$ = {_in_words(system, 'roughness')}{layer}"
        )
        figure.suptitle(title, fontsize=8, color=GREY)
        figure.savefig(path, dpi=200)


def _in_words(system: ModelSettings, name: str) -> str:
    return quantity(system, name).replace("um", "µm")
