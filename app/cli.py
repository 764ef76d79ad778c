"""The command `slipscope`: names, arguments and help of every command. What a command does lies in `app.commands`.

Nothing heavy is imported here, so that `slipscope --help` answers at once.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

EPILOG = """
Examples:

- `slipscope run` - a simulated loading experiment at P = 0.5 N
- `slipscope config > bench.toml` - every setting, with its meaning, unit and limits
- `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7` - your own bench, 0.7 N
- `slipscope replay sample7.h5` - the same analysis again, from the file

Exit codes: 0 done; 1 a device or the run failed; 2 something that was asked can not be used.
"""

app = typer.Typer(
    name="slipscope",
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=EPILOG,
)

JsonFlag = Annotated[
    bool, typer.Option("--json", help="One JSON document on standard output (SI units, named in the keys), also for errors.")
]
Headless = Annotated[
    bool, typer.Option("--headless", help="No window: a progress bar in the terminal. Chosen by itself without a display.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace output files that exist. Without it they are never touched.")]
SessionFile = Annotated[Path, typer.Argument(metavar="SESSION.h5", help="A session that `slipscope run` wrote.", show_default=False)]

_debug = False


def _show_version(asked: bool) -> None:
    if asked:
        from importlib import metadata

        try:
            typer.echo(f"slipscope {metadata.version('slipscope')}")
        except metadata.PackageNotFoundError:
            typer.echo("slipscope, not installed (running from its folder)")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def slipscope(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="The version, then exit.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Friction between a rough rubber block and a glass sphere, live: forces, images, displacement fields, stick radius.

    Without a command the window opens on the default (simulated) bench.
    """
    global _debug  # noqa: PLW0603 - one process, one command line
    del version
    _debug = debug
    if context.invoked_subcommand is None:
        from app.commands.terminal import plain_errors

        with plain_errors(as_json=False, debug=debug):
            from app.commands import experiment

            raise typer.Exit(experiment.run(None, None, False, "1", (), overwrite=False, as_json=False, autostart=False))


@app.command()
def run(
    bench: Annotated[
        Path | None, typer.Argument(metavar="[BENCH.toml]", help="Settings, see `slipscope config`; or hil-emulated.", show_default=False)
    ] = None,
    session: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="SESSION.h5", help="Session to write; else slipscope-DATE-TIME.h5 here.", show_default=False
        ),
    ] = None,
    headless: Headless = False,
    pace: Annotated[
        str, typer.Option(metavar="1|max|NUMBER", help="Simulated seconds per second; max: as fast as the machine. A real bench runs at 1.")
    ] = "1",
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="TABLE.KEY=VALUE", help="One setting, over the file's; may be repeated.", show_default=False),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Run one loading experiment: press, take the reference, drive, report.

    Writes the session (HDF5, NeXus style) and beside it a picture of the same name (.png): Q against the stage displacement, the stick
    radius c against Q, u_x in time, and the u_x field at six instants. Ends with a, Q_s, mu_s, mu_d, t_s and the account of every frame
    and sample. Ctrl-C stops the block first, then closes the session in good order; what was measured is kept.

    Example (N and um): `slipscope run bench.toml -o sample7.h5 --set run.normal_force=0.7 --set run.travel=200`
    """
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import experiment

        raise typer.Exit(experiment.run(bench, session, headless, pace, overrides or (), overwrite, as_json, autostart=True))


@app.command()
def replay(
    session: SessionFile,
    headless: Headless = False,
    pace: Annotated[
        str | None,
        typer.Option(metavar="1|max|NUMBER", help="Seconds of the experiment per second; 1 in the window, else max.", show_default=False),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Send a saved session through the same analysis again and compare, frame by frame and bit by bit.

    The session is only read; a picture is drawn beside it if there is none. No device is needed, and none can be moved.
    """
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import experiment

        raise typer.Exit(experiment.replay(session, headless, pace, as_json))


@app.command()
def info(session: SessionFile, as_json: JsonFlag = False) -> None:
    """Print what a session holds: how it ended, frames and samples, phases, results, changed settings."""
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import inspect

        raise typer.Exit(inspect.info(session, as_json))


@app.command()
def dic(
    reference: Annotated[Path, typer.Argument(metavar="REFERENCE", help="The image before any displacement.", show_default=False)],
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Images to compare with it, in order.", show_default=False)],
    fields: Annotated[Path, typer.Option("-o", "--output", metavar="FIELDS.h5|.csv|.npz", help="Where the fields go.", show_default=False)],
    method: Annotated[
        str, typer.Option(help="shared: passes over the whole image; icgn: each box by itself; direct: the paper's search.")
    ] = "shared",
    box: Annotated[int, typer.Option(help="Side of the correlation box, 4 to 200 px.")] = 20,
    step: Annotated[int, typer.Option(help="Pitch of the grid of boxes, px.")] = 10,
    order: Annotated[int, typer.Option(help="Deformation of a box in icgn: 0 shift, 1 and its gradient, 2 and its curvature.")] = 1,
    interpolant: Annotated[
        str,
        typer.Option(help="Reading between pixels: matched to the texture, bilinear, bicubic, bspline3, bspline5, sinc6 or sinc8."),
    ] = "matched",
    precision: Annotated[str, typer.Option(help="single, or double (icgn only).")] = "single",
    tolerance: Annotated[float, typer.Option(help="A step shorter than this is the last, px; 0: the method's own limit.")] = 0.0,
    search: Annotated[int, typer.Option(help="Largest jump between two images that must be found, 1 to 200 px.")] = 64,
    min_correlation: Annotated[float, typer.Option(help="A point whose correlation (0 to 1) is lower is lost.")] = 0.5,
    min_contrast: Annotated[float, typer.Option(help="Least standard deviation in a box, grey levels.")] = 2.0,
    max_saturated: Annotated[float, typer.Option(help="Share of a box (0 to 1) that may be at full scale (shared, icgn).")] = 0.2,
    full_scale: Annotated[int, typer.Option(help="End of the grey scale, 4095 for 12 bit; 0: that of the image type.")] = 0,
    mask: Annotated[
        Path | None, typer.Option(metavar="IMAGE", help="Image of the same size: pixels that are not 0 may be used.", show_default=False)
    ] = None,
    roi: Annotated[
        tuple[int, int, int, int] | None,
        typer.Option(metavar="LEFT TOP RIGHT BOTTOM", help="Region of the box centres, px. Without it all.", show_default=False),
    ] = None,
    update: Annotated[str, typer.Option(help="When an image becomes the new reference: never, every, quality.")] = "never",
    update_every: Annotated[int, typer.Option(help="Images from one reference to the next, with --update every.")] = 100,
    update_below: Annotated[float, typer.Option(help="Median correlation that asks for a new one, with --update quality.")] = 0.8,
    threads: Annotated[int, typer.Option(help="Threads that share a field; the result does not depend on it.")] = 2,
    overwrite: Overwrite = False,
) -> None:
    """Displacement fields between plain image files: grey PNG or TIFF, 8 or 16 bit, all of one size.

    A CSV begins with the columns frame,x_px,y_px,ux_px,uy_px,status: frame 1 is the first image after the reference, x_px and y_px are box
    centres with (0, 0) the centre of the top-left pixel, y points down, status says ok or why a point is lost. Ends with the points per
    second, the medians of standard uncertainty and correlation, and how many points were lost and why.

    Example: `slipscope dic rest.tif pull_*.tif -o fields.csv --box 27`
    """
    asked = {key: value for key, value in locals().items() if key not in {"reference", "images", "fields", "mask", "roi", "overwrite"}}
    from app.commands.terminal import plain_errors

    with plain_errors(False, _debug):
        from app.commands import images as image_files

        raise typer.Exit(image_files.dic(reference, images, fields, mask=mask, roi=roi, overwrite=overwrite, **asked))


@app.command()
def model(
    normal_force: Annotated[float, typer.Option(help="Normal force P, N.")] = 0.5,
    modulus: Annotated[float, typer.Option(help="Young's modulus E of the block, MPa.")] = 3.43,
    poisson: Annotated[float, typer.Option(help="Its Poisson's ratio, 0 to 0.5.")] = 0.5,
    radius: Annotated[float, typer.Option(help="Radius R of the sphere, mm.")] = 128.8,
    friction: Annotated[float, typer.Option(help="Friction coefficient mu of the interface.")] = 0.93,
    length: Annotated[float, typer.Option(help="Elastic length L of the interface, um; 0: Cattaneo-Mindlin.")] = 0.8,
    shear_force: Annotated[float | None, typer.Option(help="Shear force Q of the profiles, N.", show_default=False)] = None,
    share: Annotated[float | None, typer.Option(help="Or Q/(mu P), 0 to 1; without either 0.6.", show_default=False)] = None,
    roughness: Annotated[float, typer.Option(help="Standard deviation h of the surface's heights, um.")] = 0.595,
    thickness: Annotated[float, typer.Option(help="Thickness of the block on its rigid plate, mm; 0: a half-space.")] = 0.0,
    adhesion: Annotated[float, typer.Option(help="Work of adhesion w, mJ/m2; adds the numbers of JKR.")] = 0.0,
    path: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.csv|.png|.pdf|.svg", help="Curves to write.", show_default=False)
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """What theory says of the contact: radii, pressures, stick radius, displacement of the block; and the curves, as a table or a figure.

    The curves are p(r), sigma_xz(r) and u_x(r) at the shear force Q, and Q over the displacement of the block, with those of Cattaneo
    and Mindlin beside. The defaults are those of the paper, at 0.5 N. Needs no bench.

    Example: `slipscope model --normal-force 1.4 --share 0.9 -o contact.png`
    """
    asked = {key: value for key, value in locals().items() if key not in {"path", "overwrite", "as_json"}}
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import model as theory

        raise typer.Exit(theory.model(path, overwrite=overwrite, as_json=as_json, **asked))


@app.command()
def invert(
    fields: Annotated[
        Path, typer.Argument(metavar="FIELDS.h5|.csv", help="A session, a file of `slipscope dic`, or a table.", show_default=False)
    ],
    modulus: Annotated[float | None, typer.Option("--modulus", "--E", help="Young's modulus E, MPa.", show_default=False)] = None,
    poisson: Annotated[float | None, typer.Option(help="Poisson's ratio, 0 to 0.5.", show_default=False)] = None,
    radius: Annotated[float | None, typer.Option(help="Radius R of the sphere, mm.", show_default=False)] = None,
    normal_force: Annotated[float | None, typer.Option(help="Normal force P, N.", show_default=False)] = None,
    roughness: Annotated[float | None, typer.Option(help="Standard deviation h of the heights, um.", show_default=False)] = None,
    thickness: Annotated[
        float | None, typer.Option(help="Of the block on its rigid plate, mm; 0: a half-space.", show_default=False)
    ] = None,
    method: Annotated[
        str, typer.Option(help="axisymmetric: a profile; regularised: the whole field, best; cgls; van-cittert: the paper's.")
    ] = "axisymmetric",
    pixel: Annotated[float | None, typer.Option(help="Size of a pixel, um, where the file counts in pixels.", show_default=False)] = None,
    box: Annotated[
        float | None, typer.Option(help="Side of the box that a displacement is the mean of, um; default two pitches.", show_default=False)
    ] = None,
    centre: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="Centre of the contact, mm, as the file counts; else it is found.", show_default=False),
    ] = None,
    frame: Annotated[list[int] | None, typer.Option(help="Only this field; may be repeated. Without it all.", show_default=False)] = None,
    path: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.csv|.npz", help="Where the tractions go.", show_default=False)
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Shear tractions sigma_xz from displacement fields, by the Green's tensor of the block; the block's far displacement D is fitted.

    A session knows its own E, nu, R, P and pixel; options go before them. A table has a header with x, y, ux and their units: x_px, y_mm,
    ux_um; ux_std and frame if there are any; nan where nothing was measured. u_x is counted in the frame of the sphere, which stands still.

    Example: `slipscope invert fields.csv --E 3.43 --poisson 0.5 --radius 128.8 --normal-force 0.5 --pixel 7.04 -o sigma.csv`
    """
    asked = {key: value for key, value in locals().items() if key not in {"fields", "path", "frame"}}
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import invert as inversion

        raise typer.Exit(inversion.invert(fields, path, frames=frame or [], **asked))


@app.command()
def config(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="A bench that comes with the program: hil-emulated, pci-6251.", show_default=False),
    ] = None,
) -> None:
    """Print the default settings, each with its meaning, unit and limits: `slipscope config > bench.toml`.

    With a name, the few settings of a bench that comes with the program.
    """
    from app.commands.terminal import plain_errors

    with plain_errors(False, _debug):
        from app.config import bench_text, default_toml

        typer.echo(default_toml() if name is None else bench_text(name), nl=False)


@app.command()
def check(
    bench: Annotated[
        Path | None, typer.Argument(metavar="[BENCH.toml]", help="Settings, or hil-emulated; else the simulated bench.", show_default=False)
    ] = None,
    home: Annotated[bool, typer.Option("--home", help="Let the stage look for its origin. It moves.")] = False,
    move: Annotated[
        float, typer.Option("--move", metavar="UM", help="Let the stage move by so many um at run.velocity, and back.", show_default=False)
    ] = 0.0,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="TABLE.KEY=VALUE", help="One setting, over the file's; may be repeated.", show_default=False),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Go through a bench and say what works: devices, samples, triggers, frames, sensors, picture. Nothing moves unless it is allowed.

    Takes two seconds of data and records nothing. Exit code 1 if something does not work.

    Example: `slipscope check bench.toml --move 10`
    """
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import bench as on_bench

        raise typer.Exit(on_bench.check(bench, overrides or (), home=home, move_um=move, as_json=as_json))


@app.command()
def cameras(
    producer: Annotated[
        str, typer.Option(metavar="FILE.cti", help="GenTL producer of a camera's vendor: its cameras too.", show_default=False)
    ] = "",
    as_json: JsonFlag = False,
) -> None:
    """List the cameras on this computer, with what to write in the settings as camera.device."""
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import bench as on_bench

        raise typer.Exit(on_bench.cameras(producer, as_json))


@app.command()
def doctor(as_json: JsonFlag = False) -> None:
    """Check this computer: versions, devices, display, disk, cores; what is missing and how to get it.

    Exit code 1 if something that every run needs is missing.
    """
    from app.commands.terminal import plain_errors

    with plain_errors(as_json, _debug):
        from app.commands import bench as on_bench

        raise typer.Exit(on_bench.doctor(as_json))


def main() -> None:
    """Read the command line, do it, and end the program with its exit code."""
    # the arrays here are small: threads of the linear algebra library would only take the cores from the correlation
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    app(prog_name="slipscope")
