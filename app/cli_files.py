"""The commands of `slipscope` that work on files and on theory, without a bench: names, arguments
and help.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli_options import JsonFlag, Overrides, Overwrite, SessionFile, plain_errors

app = typer.Typer()


@app.command()
def dic(
    reference: Annotated[
        Path,
        typer.Argument(
            metavar="REFERENCE", help="The image before any displacement.", show_default=False
        ),
    ],
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="IMAGE...", help="Images to compare with it, in order.", show_default=False
        ),
    ],
    fields: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FIELDS.h5|.csv|.npz",
            help="Where the fields go.",
            show_default=False,
        ),
    ],
    method: Annotated[
        str,
        typer.Option(
            help=(
                "shared: passes over the whole image; icgn: each box by itself; direct: the paper's"
                " search."
            )
        ),
    ] = "shared",
    box: Annotated[int, typer.Option(help="Side of the correlation box, 4 to 200 px.")] = 20,
    step: Annotated[int, typer.Option(help="Pitch of the grid of boxes, px.")] = 10,
    order: Annotated[
        int,
        typer.Option(
            help="Deformation of a box in icgn: 0 shift, 1 and its gradient, 2 and its curvature."
        ),
    ] = 1,
    interpolant: Annotated[
        str,
        typer.Option(
            help=(
                "Reading between pixels: matched to the texture, bilinear, bicubic, bspline3,"
                " bspline5, sinc6 or sinc8."
            )
        ),
    ] = "matched",
    precision: Annotated[str, typer.Option(help="single, or double (icgn only).")] = "single",
    tolerance: Annotated[
        float,
        typer.Option(help="A step shorter than this is the last, px; 0: the method's own limit."),
    ] = 0.0,
    search: Annotated[
        int, typer.Option(help="Largest jump between two images that must be found, 1 to 200 px.")
    ] = 64,
    min_correlation: Annotated[
        float, typer.Option(help="A point whose correlation (0 to 1) is lower is lost.")
    ] = 0.5,
    min_contrast: Annotated[
        float, typer.Option(help="Least standard deviation in a box, grey levels.")
    ] = 2.0,
    max_saturated: Annotated[
        float,
        typer.Option(help="Share of a box (0 to 1) that may be at full scale (shared, icgn)."),
    ] = 0.2,
    full_scale: Annotated[
        int, typer.Option(help="End of the grey scale, 4095 for 12 bit; 0: that of the image type.")
    ] = 0,
    mask: Annotated[
        Path | None,
        typer.Option(
            metavar="IMAGE",
            help="Image of the same size: pixels that are not 0 may be used.",
            show_default=False,
        ),
    ] = None,
    roi: Annotated[
        tuple[int, int, int, int] | None,
        typer.Option(
            metavar="LEFT TOP RIGHT BOTTOM",
            help="Region of the box centres, px. Without it all.",
            show_default=False,
        ),
    ] = None,
    update: Annotated[
        str, typer.Option(help="When an image becomes the new reference: never, every, quality.")
    ] = "never",
    update_every: Annotated[
        int, typer.Option(help="Images from one reference to the next, with --update every.")
    ] = 100,
    update_below: Annotated[
        float,
        typer.Option(help="Median correlation that asks for a new one, with --update quality."),
    ] = 0.8,
    threads: Annotated[
        int, typer.Option(help="Threads that share a field; the result does not depend on it.")
    ] = 2,
    overwrite: Overwrite = False,
) -> None:
    """Displacement fields between plain image files: grey PNG or TIFF, 8 or 16 bit, all of one
    size.

    A CSV begins with the columns frame,x_px,y_px,ux_px,uy_px,status: frame 1 is the first image
    after the reference, x_px and y_px are box centres with (0, 0) the centre of the top-left pixel,
    y points down, status says ok or why a point is lost. Ends with the points per second, the
    medians of standard uncertainty and correlation, and how many points were lost and why.

    Example: `slipscope dic rest.tif pull_*.tif -o fields.csv --box 27`
    """
    asked = {
        key: value
        for key, value in locals().items()
        if key not in {"reference", "images", "fields", "mask", "roi", "overwrite"}
    }
    with plain_errors():
        from app.commands import images as image_files

        raise typer.Exit(
            image_files.dic(
                reference, images, fields, mask=mask, roi=roi, overwrite=overwrite, **asked
            )
        )


@app.command()
def model(
    normal_force: Annotated[float, typer.Option(help="Normal force P, N.")] = 0.5,
    modulus: Annotated[float, typer.Option(help="Young's modulus E of the block, MPa.")] = 3.43,
    poisson: Annotated[float, typer.Option(help="Its Poisson's ratio, 0 to 0.5.")] = 0.5,
    radius: Annotated[float, typer.Option(help="Radius R of the sphere, mm.")] = 128.8,
    friction: Annotated[
        float, typer.Option(help="Friction coefficient mu of the interface.")
    ] = 0.93,
    length: Annotated[
        float, typer.Option(help="Elastic length L of the interface, um; 0: Cattaneo-Mindlin.")
    ] = 0.8,
    shear_force: Annotated[
        float | None, typer.Option(help="Shear force Q of the profiles, N.", show_default=False)
    ] = None,
    share: Annotated[
        float | None,
        typer.Option(help="Or Q/(mu P), 0 to 1; without either 0.6.", show_default=False),
    ] = None,
    roughness: Annotated[
        float, typer.Option(help="Standard deviation h of the surface's heights, um.")
    ] = 0.595,
    thickness: Annotated[
        float, typer.Option(help="Thickness of the block on its rigid plate, mm; 0: a half-space.")
    ] = 0.0,
    adhesion: Annotated[
        float, typer.Option(help="Work of adhesion w, mJ/m2; adds the numbers of JKR.")
    ] = 0.0,
    path: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.csv|.png|.pdf|.svg",
            help="Curves to write.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """What theory says of the contact: radii, pressures, stick radius, displacement of the block;
    and the curves, as a table or a figure.

    The curves are p(r), sigma_xz(r) and u_x(r) at the shear force Q, and Q over the displacement of
    the block, with those of Cattaneo and Mindlin beside. The defaults are those of the paper, at
    0.5 N. Needs no bench.

    Example: `slipscope model --normal-force 1.4 --share 0.9 -o contact.png`
    """
    asked = {
        key: value for key, value in locals().items() if key not in {"path", "overwrite", "as_json"}
    }
    with plain_errors(as_json):
        from app.commands import model as theory

        raise typer.Exit(theory.model(path, overwrite=overwrite, as_json=as_json, **asked))


@app.command()
def invert(
    fields: Annotated[
        Path,
        typer.Argument(
            metavar="FIELDS.h5|.csv",
            help="A session, a file of `slipscope dic`, or a table.",
            show_default=False,
        ),
    ],
    modulus: Annotated[
        float | None,
        typer.Option("--modulus", "--E", help="Young's modulus E, MPa.", show_default=False),
    ] = None,
    poisson: Annotated[
        float | None, typer.Option(help="Poisson's ratio, 0 to 0.5.", show_default=False)
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help="Radius R of the sphere, mm.", show_default=False)
    ] = None,
    normal_force: Annotated[
        float | None, typer.Option(help="Normal force P, N.", show_default=False)
    ] = None,
    roughness: Annotated[
        float | None,
        typer.Option(help="Standard deviation h of the heights, um.", show_default=False),
    ] = None,
    thickness: Annotated[
        float | None,
        typer.Option(
            help="Of the block on its rigid plate, mm; 0: a half-space.", show_default=False
        ),
    ] = None,
    method: Annotated[
        str,
        typer.Option(
            help=(
                "axisymmetric: a profile; regularised: the whole field, best; cgls; van-cittert:"
                " the paper's."
            )
        ),
    ] = "axisymmetric",
    pixel: Annotated[
        float | None,
        typer.Option(
            help="Size of a pixel, um, where the file counts in pixels.", show_default=False
        ),
    ] = None,
    box: Annotated[
        float | None,
        typer.Option(
            help="Side of the box that a displacement is the mean of, um; default two pitches.",
            show_default=False,
        ),
    ] = None,
    centre: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="X Y",
            help="Centre of the contact, mm, as the file counts; else it is found.",
            show_default=False,
        ),
    ] = None,
    frame: Annotated[
        list[int] | None,
        typer.Option(help="Only this field; may be repeated. Without it all.", show_default=False),
    ] = None,
    path: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE.csv|.npz",
            help="Where the tractions go.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Shear tractions sigma_xz from displacement fields, by the Green's tensor of the block; the
    block's far displacement D is fitted.

    A session knows its own E, nu, R, P and pixel; options go before them. A table has a header with
    x, y, ux and their units: x_px, y_mm, ux_um; ux_std and frame if there are any; nan where
    nothing was measured. u_x is counted in the frame of the sphere, which stands still.

    Example: `slipscope invert fields.csv --E 3.43 --poisson 0.5 --radius 128.8 --normal-force 0.5
    --pixel 7.04 -o sigma.csv`
    """
    asked = {
        key: value for key, value in locals().items() if key not in {"fields", "path", "frame"}
    }
    with plain_errors(as_json):
        from app.commands import invert as inversion

        raise typer.Exit(inversion.invert(fields, path, frames=frame or [], **asked))


@app.command()
def export(
    session: SessionFile,
    destination: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER|FILE.csv|.npz|.mat|.pvd",
            help="Where it goes.",
            show_default=False,
        ),
    ],
    what: Annotated[
        str,
        typer.Option(
            metavar="fields|results|forces",
            help="What a .csv holds; else fields.",
            show_default=False,
        ),
    ] = "",
    frames: Annotated[
        str,
        typer.Option(
            metavar="FIRST:END:STEP",
            help="Only these triggers, END not included; or one.",
            show_default=False,
        ),
    ] = "",
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Write what a session holds as files of other programs.

    A folder gets the raw images (TIFF, lossless), metadata.csv with the fate of every frame,
    forces.csv and settings.toml, which `slipscope import` reads again. A .csv is a table of
    displacement fields (as `slipscope dic` writes them), of results by frame or of forces by
    sample; .npz and .mat hold all three as arrays; .pvd is a series of displacement fields for
    ParaView, in m, y upwards.

    Example: `slipscope export sample7.h5 -o sample7 --frames 100:400:10`
    """
    with plain_errors(as_json):
        from app.commands import exchange

        raise typer.Exit(
            exchange.export(
                session, destination, what, frames, overwrite=overwrite, as_json=as_json
            )
        )


@app.command("import")
def import_(
    images: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER|IMAGE...", help="Grey PNG or TIFF, 8 or 16 bit.", show_default=False
        ),
    ],
    session: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="SESSION.h5", help="Session to write.", show_default=False
        ),
    ],
    forces: Annotated[
        Path | None,
        typer.Option(
            metavar="FORCES.csv",
            help="sample or time_s; P_N and Q_N, or normal_V and shear_V; stage_um.",
            show_default=False,
        ),
    ] = None,
    metadata: Annotated[
        Path | None,
        typer.Option(
            metavar="METADATA.csv",
            help="One row per frame: frame, sample or time_s, file, phase, reason.",
            show_default=False,
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        typer.Option(
            metavar="BENCH.toml",
            help="Sample, sensors, correlation; see `slipscope config`.",
            show_default=False,
        ),
    ] = None,
    pixel_um: Annotated[
        float | None,
        typer.Option("--pixel", metavar="UM", help="Size of a pixel.", show_default=False),
    ] = None,
    rate_hz: Annotated[
        int | None,
        typer.Option("--rate", metavar="HZ", help="Force samples per second.", show_default=False),
    ] = None,
    divisor: Annotated[
        int | None, typer.Option(help="Samples from one image to the next.", show_default=False)
    ] = None,
    background: Annotated[
        int | None,
        typer.Option(
            metavar="FRAME", help="Image of the free block; else none.", show_default=False
        ),
    ] = None,
    reference: Annotated[
        int | None,
        typer.Option(
            metavar="FRAME", help="Image at rest under load; else the first.", show_default=False
        ),
    ] = None,
    drive: Annotated[
        int | None,
        typer.Option(
            metavar="FRAME",
            help="First frame of the drive; else from where Q rises.",
            show_default=False,
        ),
    ] = None,
    overrides: Overrides = None,
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Make a session of images and forces of other benches and programs, and analyse it; `slipscope
    replay` then repeats that to the bit.

    Images are taken in the order of the numbers in their names, frame 0 first; a missing number is
    a lost frame. In a folder metadata.csv, forces.csv and settings.toml are used if they are there.
    Forces between the rows of a slower table are read off a line; where rows are missing they are a
    gap. Without --settings --pixel, --rate and --divisor (or times in the metadata) must be given,
    and the sample and the lens are those of `slipscope config`.

    Example: `slipscope import images -o other.h5 --forces load.csv --pixel 5.2 --rate 1000
    --divisor 100 --reference 12`
    """
    given = {
        key: value
        for key, value in locals().items()
        if key not in {"session", "overwrite", "as_json", "overrides"}
    }
    with plain_errors(as_json):
        from app.commands import exchange

        raise typer.Exit(
            exchange.import_(
                session, overwrite=overwrite, as_json=as_json, overrides=overrides or (), **given
            )
        )


@app.command()
def repair(
    session: SessionFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="REPAIRED.h5", help="Session to write.", show_default=False
        ),
    ],
    overwrite: Overwrite = False,
    as_json: JsonFlag = False,
) -> None:
    """Bring back every frame and sample of a session that was cut short, into a new file; the
    session itself is only read.

    Uses the journal (SESSION.h5.journal) that lies beside a session until it is closed in good
    order. Says what was lost.
    """
    with plain_errors(as_json):
        from app.commands import repair as repairs

        raise typer.Exit(repairs.repair(session, output, overwrite, as_json))
