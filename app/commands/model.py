"""`slipscope model`: what theory says of a sphere pressed on a rough block and sheared, as numbers,
a table of curves, or a figure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mechanics import cattaneo_mindlin, greenwood_tripp, hertz, jkr
from analysis.mechanics.interface import elastic_length
from analysis.mechanics.loading import AxisymmetricLoading, Contact, State
from app.commands.terminal import DONE, output, print_json, print_rows
from app.errors import UserError
from app.outputs import check_output, new_file
from app.report.summary import Row

F64 = NDArray[np.float64]

ENDINGS = (".csv", ".png", ".pdf", ".svg")
POINTS = 301  # a is one of them
# of the curves: contact radii, and shifts at which Cattaneo and Mindlin's contact slides
WIDEST, FARTHEST = 3.0, 1.5
SHARP = 2e-3  # a length below this part of that shift asks for more modes
FAINT = 0.01  # of the peak pressure: where a rough contact is taken to end


LIMITS = {  # of the options, mostly those of the settings file
    "normal_force": (1e-6, 100, "N"),
    "modulus": (1e-6, 1e6, "MPa"),
    "poisson": (0, 0.5, ""),
    "radius": (1e-3, 1e5, "mm"),
    "friction": (1e-3, 5, ""),
    "length": (0, 1000, "um"),
    "roughness": (0, 1000, "um"),
    "thickness": (0, 1e4, "mm"),
    "adhesion": (0, 1e4, "mJ/m2"),
}


@dataclass(frozen=True, slots=True)
class System:
    """What is asked, in the units of the command line."""

    normal_force: float
    modulus: float
    poisson: float
    radius: float
    friction: float
    length: float
    roughness: float
    thickness: float
    adhesion: float

    def __post_init__(self) -> None:
        for name, (least, most, unit) in LIMITS.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise UserError(
                    f"--{name.replace('_', '-')}: {value:g} found; give {least:g} to {most:g} {unit}".rstrip()
                )
        if self.thickness > 0 and self.length == 0:
            raise UserError(
                "--thickness: a layer is solved for a rough interface only; give --length more than"
                " 0 with it"
            )


@dataclass(frozen=True, slots=True)
class Quantity:
    """One result: its name in files, what it is, its symbol, its value in SI, and the unit and
    factor for people.
    """

    key: str
    label: str
    symbol: str
    value: float
    unit: str = ""
    per_si: float = 1.0

    @property
    def text(self) -> str:
        """The value with its unit, for people."""
        return f"{self.value * self.per_si:.4g} {self.unit}".rstrip()


def model(
    path: Path | None,
    shear_force: float | None,
    share: float | None,
    *,
    overwrite: bool,
    as_json: bool,
    **asked: float,
) -> int:
    """Print the numbers of a contact and write its curves; the exit code.

    `asked` are the fields of `System`.
    """
    system = System(**asked)
    if path is not None:
        check_output(path, overwrite, endings=ENDINGS)
    Q = _force(system, shear_force, share)
    try:
        sheared = Sheared(system, Q)
        numbers = sheared.numbers()
        curves = sheared.curves() if path is not None else {}
    except ValueError as error:
        raise UserError(f"this contact can not be solved: {error}") from None
    if path is not None:
        with new_file(path, overwrite) as unfinished:
            _write(unfinished, numbers, curves, sheared)
    if as_json:
        print_json({q.key: q.value for q in numbers})
        return DONE
    print_rows(
        "sphere on a block, pressed and sheared", [Row(q.label, q.symbol, q.text) for q in numbers]
    )
    if path is not None:
        output().print(f"written: {path}")
    return DONE


def _force(system: System, shear_force: float | None, share: float | None) -> float:
    """The shear force Q in newtons that is asked for, one way or the other."""
    if shear_force is not None and share is not None:
        raise UserError("--shear-force and --share: both were given; give one of them")
    limit = system.friction * system.normal_force
    Q = limit * (0.6 if share is None else share) if shear_force is None else shear_force
    if not 0 <= Q <= limit:
        raise UserError(
            f"Q = {Q:g} N asked; give 0 to mu P = {limit:g} N, by --shear-force or as a --share of"
            " it"
        )
    if limit <= Q and system.length > 0:
        raise UserError(
            "Q = mu P asked, which a rough interface only nears; give less, or --length 0"
        )
    return Q


class Sheared:
    """The contact under Q: Cattaneo and Mindlin's, and that of a rough interface if its length is
    not 0.

    A length below 1e-4 of the shift at which Cattaneo and Mindlin's contact slides leaves an edge
    that the modes hold to 0.5 % of mu p0.
    """

    def __init__(self, system: System, Q: float) -> None:
        self.system, self.Q = system, Q
        self.P, self.E, self.nu, self.R = (
            system.normal_force,
            system.modulus * 1e6,
            system.poisson,
            system.radius * 1e-3,
        )
        self.L, self.h = system.length * 1e-6, system.roughness * 1e-6
        self.a = hertz.contact_radius(self.P, self.E, self.nu, self.R)
        if self.a > self.R / 2:
            raise UserError(
                f"a contact of radius {self.a * 1e3:.3g} mm found, too wide for Hertz; press less"
                f" on this sphere of {system.radius:g} mm"
            )
        self.cm = system.friction, self.P, self.a, self.E, self.nu
        self.loading: AxisymmetricLoading | None = None
        self.state: State | None = None
        if self.L > 0:
            thickness = system.thickness * 1e-3 or math.inf
            contact = Contact(self.P, self.E, self.nu, self.R, system.friction, self.L, thickness)
            self.loading = AxisymmetricLoading(
                contact, 64 if self.L / contact.full_shift > SHARP else 128
            )
            self.state = self.loading.at_force(Q)
        self.rough: greenwood_tripp.RoughContact | None = None
        # below, Hertz's pressure is right to 0.2 %
        if self.h * self.R / self.a**2 >= greenwood_tripp.SMOOTHEST:
            self.rough = greenwood_tripp.rough_contact(self.P, self.E, self.nu, self.R, self.h)

    def numbers(self) -> list[Quantity]:
        """The results, in the order in which they are shown."""
        mm, um, kpa = ("mm", 1e3), ("um", 1e6), ("kPa", 1e-3)
        mu, P, a, E, nu = self.cm
        p0, limit = hertz.peak_pressure(P, a), mu * P
        shift = float(cattaneo_mindlin.shift(self.Q, *self.cm))
        smooth, stiff = 8 * hertz.shear_modulus(E, nu) * a / (2 - nu), ("N/mm", 1e-3)
        block = self.state.D if self.state else shift
        found = [
            Quantity("normal_force_n", "normal force", "P", P, "N"),
            Quantity("young_modulus_pa", "Young's modulus", "E", E, "MPa", 1e-6),
            Quantity("poisson", "Poisson's ratio", "nu", nu),
            Quantity("sphere_radius_m", "radius of the sphere", "R", self.R, *mm),
            Quantity("friction", "friction coefficient", "mu", mu),
            Quantity(
                "shear_force_n",
                f"shear force, {self.Q / limit:.4g} of the greatest",
                "Q",
                self.Q,
                "N",
            ),
            Quantity("friction_limit_n", "greatest shear force", "mu P", limit, "N"),
            Quantity("hertz_radius_m", "contact radius, Hertz", "a_H", a, *mm),
            Quantity("peak_pressure_pa", "pressure at the centre, Hertz", "p0", p0, *kpa),
            Quantity(
                "indentation_m", "indentation, Hertz", "a_H^2/R", hertz.indentation(a, self.R), *um
            ),
            Quantity(
                "stick_radius_m",
                "stick radius, Cattaneo-Mindlin",
                "c",
                float(cattaneo_mindlin.stick_radius(self.Q, limit, a)),
                *mm,
            ),
            Quantity("block_shift_m", "displacement of the block", "delta", block, *um),
            Quantity("block_shift_cm_m", "the same, Cattaneo-Mindlin", "delta", shift, *um),
            Quantity(
                "sliding_shift_m",
                "at which Cattaneo-Mindlin's slides",
                "delta_max",
                cattaneo_mindlin.full_shift(*self.cm),
                *um,
            ),
            Quantity(
                "stiffness_smooth_n_per_m",
                "contact stiffness at rest, smooth",
                "8 G a/(2-nu)",
                smooth,
                *stiff,
            ),
        ]
        if self.loading and self.state:
            start = self.loading.at_block(0.0).stiffness
            found += [
                Quantity(
                    "stiffness_rough_n_per_m",
                    "the same, rough interface",
                    "dQ/ddelta",
                    start,
                    *stiff,
                ),
                Quantity("elastic_length_m", "elastic length of the interface", "L", self.L, *um),
                Quantity(
                    "interface_stiffness_pa_per_m",
                    "its stiffness at the centre",
                    "p0/L",
                    p0 / self.L,
                    "kPa/um",
                    1e-9,
                ),
                Quantity(
                    "peak_radius_m",
                    "where the traction is greatest",
                    "r",
                    self.state.peak_radius,
                    *mm,
                ),
                Quantity(
                    "centre_slip_m",
                    "displacement at the centre",
                    "u_x(0)",
                    self._seen(np.zeros(1))[0].item(),
                    *um,
                ),
            ]
        if self.system.thickness:
            found.append(
                Quantity(
                    "thickness_m", "thickness of the block", "H", self.system.thickness * 1e-3, *mm
                )
            )
        if self.h > 0:
            apparent = greenwood_tripp.apparent_radius(a, self.R, self.h)
            found += [
                Quantity("roughness_m", "standard deviation of the heights", "h", self.h, *um),
                Quantity(
                    "bureau_length_m",
                    "L of a surface of this roughness",
                    "L(h)",
                    elastic_length(self.h, nu),
                    *um,
                ),
                Quantity("apparent_radius_m", "apparent radius", "a_H + sqrt(R h)", apparent, *mm),
            ]
        if self.rough:
            found += [
                Quantity(
                    "roughness_parameter", "roughness, Greenwood-Tripp", "alpha", self.rough.alpha
                ),
                Quantity(
                    "effective_radius_m", "effective radius", "a*", self.rough.effective_radius, *mm
                ),
                Quantity(
                    "faint_radius_m",
                    f"radius of {FAINT:.0%} of its peak pressure",
                    "",
                    self.rough.radius_at(FAINT),
                    *mm,
                ),
                Quantity(
                    "rough_peak_pressure_pa",
                    "its peak pressure",
                    "p(0)",
                    self.rough.peak_pressure,
                    *kpa,
                ),
            ]
        return found + self._adhesive()

    def _adhesive(self) -> list[Quantity]:
        w = self.system.adhesion * 1e-3
        if w == 0:
            return []
        a = float(jkr.contact_radius(self.P, w, self.E, self.nu, self.R))
        return [
            Quantity("jkr_radius_m", "contact radius, JKR", "a", a, "mm", 1e3),
            Quantity(
                "jkr_indentation_m",
                "indentation, JKR",
                "",
                float(jkr.indentation(a, w, self.E, self.nu, self.R)),
                "um",
                1e6,
            ),
            Quantity(
                "jkr_pull_off_n",
                "pull-off force, JKR",
                "-3/2 pi w R",
                jkr.pull_off_force(w, self.R),
                "mN",
                1e3,
            ),
            Quantity(
                "tabor_parameter",
                "Tabor parameter (JKR above 5)",
                "",
                jkr.tabor_parameter(w, self.E, self.nu, self.R),
            ),
        ]

    def _seen(self, r: F64) -> tuple[F64, F64]:
        """What a camera at rest with the sphere sees: azimuthal mean of u_x, and its part that goes
        with cos 2 theta.
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
        # where Cattaneo and Mindlin's traction has its peak
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


def _write(path: Path, numbers: list[Quantity], curves: dict[str, F64], sheared: Sheared) -> None:
    if path.suffix.lower() != ".csv":
        _figure(path, curves, sheared)
        return
    lines = [f"# {q.label}{f' {q.symbol}' if q.symbol else ''}: {q.text}" for q in numbers]
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
        rough = f"rough interface, $L$ = {system.length:g} µm" if system.length else ""
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
        layer = f", {system.thickness:g} mm thick" if system.thickness else ""
        title = (
            f"$P$ = {system.normal_force:g} N, $E$ = {system.modulus:g} MPa, ν ="
            f" {system.poisson:g}, $R$ = {system.radius:g} mm,"
            f" µ = {mu:g}, $h$ = {system.roughness:g} µm{layer}"
        )
        figure.suptitle(title, fontsize=8, color=GREY)
        figure.savefig(path, dpi=200)
