"""`slipscope model`: what theory says about a sphere that is pressed on a rough block and sheared,
as numbers, a table of curves, or a figure.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option, Typer

from app.cli.command_options import JsonFlag, Overwrite, command, output_file
from app.settings.sections import ModelSettings
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.cli.contact_theory import ShearedContact
    from app.records.quantities import Measurement

ENDINGS = (".csv", ".png", ".pdf", ".svg")
app = Typer()


@command(app)
def model(
    system: ModelSettings,
    shear_force: Annotated[float | None, Option(help="Shear force Q of the profiles [N].")] = None,
    share: Annotated[
        float | None, Option(help="Q/(mu P), 0 to 1, instead of Q; default: 0.6.")
    ] = None,
    curves: Annotated[
        Path | None, output_file("FILE.csv|.png|.pdf|.svg", "File for the curves.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> int:
    """Compute the predictions of theory for the contact: radii, pressures, stick radius,
    displacement of the block; and curves, as a table or a figure.

    The curves are p(r), sigma_xz(r) and u_x(r) at the shear force Q, and Q against the displacement
    of the block, each with Cattaneo and Mindlin's solution. The defaults are those of the paper, at
    0.5 N. No bench is needed.

    Example: `slipscope model --normal-force 1.4 --share 0.9 -o contact.png`
    """
    from app.cli.contact_theory import ShearedContact
    from app.cli.terminal import DONE, print_json, print_line, print_rows
    from app.system.outputs import check_output, new_file

    if curves is not None:
        check_output(curves, overwrite, endings=ENDINGS)
    Q = _shear_force(system, shear_force, share)
    try:
        contact = ShearedContact(system, Q)
        numbers = contact.numbers()
        if curves is not None:
            with new_file(curves, overwrite) as unfinished:
                write = _write_table if curves.suffix.lower() == ".csv" else _draw
                write(unfinished, contact, numbers)
    except ValueError as error:
        raise UserError(f"this contact cannot be solved: {error}") from None
    if as_json:
        print_json({q.key: q.value for q in numbers})
        return DONE
    rows = [(q.name, q.symbol, f"{q.in_unit[0]:.4g} {q.unit}".rstrip()) for q in numbers]
    print_rows("sphere on a block, pressed and sheared", rows)
    if curves is not None:
        print_line(f"written: {curves}")
    return DONE


def _shear_force(system: ModelSettings, shear_force: float | None, share: float | None) -> float:
    """The shear force Q in newtons, given as a force, as a share of the greatest, or not at all."""
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
        raise UserError(
            "Q = mu P is only approached by a rough interface; give less, or --length 0"
        )
    return Q


def _write_table(path: Path, contact: ShearedContact, numbers: list[Measurement]) -> None:
    """Write the curves, and beside them the numbers, in SI units, the same in all rows.

    Over r: pressure p (Hertz; rough: Greenwood and Tripp), traction sigma, and the displacement
    seen from the sphere, u_x = ux + ux_cos2 cos(2 theta), u_y = ux_cos2 sin(2 theta); over the
    displacement delta of the block: Q. cm: Cattaneo and Mindlin, on a half-space.
    """
    import numpy as np

    from app.report.paper.style import write_table

    curves = dict(contact.curves())
    rows = len(next(iter(curves.values())))
    curves |= {one.key: np.full(rows, one.value) for one in numbers}
    write_table(curves, path)


def _draw(path: Path, contact: ShearedContact, _numbers: list[Measurement]) -> None:
    import matplotlib as mpl

    from app.report.figures import BLUE, GREY, RED, STYLE
    from app.report.paper.style import new_figure

    system, curves = contact.system, contact.curves()
    with mpl.rc_context(STYLE):
        figure = new_figure(7.2, 5.2)
        axes: Any = figure.subplots(2, 2)
        r, p, mu = curves["r_mm"], curves["p_kPa"], system.friction
        (left, right), (low_left, low_right) = axes
        if contact.rough:
            left.plot(r, curves["p_rough_kPa"], color=BLUE, label="rough (Greenwood-Tripp)")
        left.plot(r, p, "--", color=RED, label="smooth (Hertz)")
        left.set(ylabel="pressure $p$ (kPa)", title="(a) pressure")
        rough = f"rough interface, $L$ = {system.length * 1e6:g} µm" if system.length else ""
        smooth = "Cattaneo-Mindlin" + (", half-space" if system.thickness else "")
        pairs = (
            (right, "r_mm", "sigma", "kPa"),
            (low_left, "r_mm", "ux", "um"),
            (low_right, "delta_um", "Q", "N"),
        )
        for panel, x, name, unit in pairs:
            if rough:
                panel.plot(curves[x], curves[f"{name}_{unit}"], color=BLUE, label=rough)
            panel.plot(curves[x], curves[f"{name}_cm_{unit}"], "--", color=RED, label=smooth)
        right.plot(r, mu * p, ":", color=GREY, label=r"$\mu p$")
        right.set(
            ylabel=r"shear traction $\sigma_{xz}$ (kPa)",
            title=f"(b) traction at $Q$ = {contact.Q:.3g} N",
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
        pressed = r[curves["p_rough_kPa"] > 1e-3 * curves["p_rough_kPa"][0]][-1]
        for panel, end in ((left, 1.1 * pressed), (right, 1.1 * pressed), (low_left, r[-1])):
            panel.set(xlabel="distance from the centre $r$ (mm)", xlim=(0, min(end, r[-1])))
        for panel in axes.ravel():
            panel.set_ylim(bottom=0)
            panel.legend()
        low_right.set_xlim(0, curves["delta_um"][-1])
        layer = f", {system.thickness * 1e3:g} mm thick" if system.thickness else ""
        title = (
            f"$P$ = {system.normal_force:g} N, $E$ = {system.modulus * 1e-6:g} MPa, ν ="
            f" {system.poisson:g}, $R$ = {system.radius * 1e3:g} mm,"
            f" µ = {mu:g}, $h$ = {system.roughness * 1e6:g} µm{layer}"
        )
        figure.suptitle(title, fontsize=8, color=GREY)
        figure.savefig(path, dpi=200)
