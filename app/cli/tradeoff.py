"""`slipscope tradeoff`: what accuracy costs on this computer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option, Typer

from analysis.options import options
from analysis.settings import Correlation
from app.cli.command_options import Overwrite, command, option_of, output_file
from app.cli.names import check_known
from app.system.errors import UserError
from app.system.interrupting import reason_of

if TYPE_CHECKING:
    from app.tradeoff.study import Found, Study
    from app.tradeoff.texture import Texture

SIZE = (1200, 1600)  # rows and columns of the standard pictures
CORRELATED = 0.1  # correlation of neighbours from which the noise is not independent
LEAST_SIZE = 128
app = Typer()


@command(app)
def tradeoff(
    pictures: Annotated[
        list[Path] | None,
        Argument(
            metavar="REFERENCE REST",
            help="Your image, and others of the same scene at rest; default: standard speckle.",
            show_default=False,
        ),
    ] = None,
    rest: Annotated[
        list[Path] | None,
        Option(metavar="IMAGE...", help="Images at rest, as after REFERENCE."),
    ] = None,
    methods: Annotated[
        list[str] | None,
        option_of("shared|icgn|direct", "--method", meaning="Only this method; may be repeated."),
    ] = None,
    boxes: Annotated[
        list[int] | None,
        Option("--box", metavar="PX", help="Only this box; may be repeated."),
    ] = None,
    rate_hz: Annotated[
        float, Option("--rate", metavar="HZ", help="Images per second to keep up with.")
    ] = 23.8,
    free: Annotated[
        float, Option(metavar="SHARE", help="Share of this computer to be left free.")
    ] = 0.5,
    period_px: Annotated[
        float | None,
        Option(
            "--period",
            metavar="PX",
            help="Shortest period of u_x to be resolved; default: that of the standard settings.",
        ),
    ] = None,
    threads: Annotated[int, Option(min=1, max=64, help="Threads of the correlation.")] = 2,
    full_scale: Annotated[
        int, Option(min=0, max=65535, help="End of the grey scale, 4095 for 12 bits.")
    ] = 0,
    quick: Annotated[
        bool, Option("--quick", help="Fewer variants and smaller images, in a minute.")
    ] = False,
    results: Annotated[
        Path | None,
        Option(
            "--json",
            metavar="FILE.json",
            help="File for all values. An earlier, unfinished run in this file is continued.",
        ),
    ] = None,
    picture: Annotated[
        Path | None, output_file("FILE.png|.pdf|.svg", "File for the picture.")
    ] = None,
    overwrite: Overwrite = False,
) -> int:
    """Measure speed against accuracy on this computer, for your texture and its noise: bias, sigma,
    spatial resolution and cost of every method, box, step and tolerance.

    The grains, the contrast and the noise of the image are measured, and speckle of the same kind
    is generated from blobs, which can be displaced exactly. The period is that of a wave of u_x
    whose amplitude is measured to 90 %. A star marks choices that no other one beats. Finally
    recommends settings for --rate frames/s. Takes minutes; after Ctrl-C the same command continues
    from --json.

    Example: `slipscope tradeoff rest_000.tif rest_*.tif --json trade.json -o trade.png`
    """
    from app.cli.terminal import DONE, FAILED, Bar, print_line, say
    from app.system.outputs import check_output, new_file
    from app.tradeoff import correlation_study as correlation, study

    given, resting = pictures or [], rest or []
    if picture is not None:
        inputs = {"picture": [*given, *resting]}
        check_output(picture, overwrite, endings=(".png", ".pdf", ".svg"), inputs=inputs)
    if not (0 < rate_hz < math.inf and 0 <= free < 1):
        raise UserError(
            f"--rate {rate_hz:g} and --free {free:g}: a rate above 0 and a share from 0 to less"
            " than 1 are needed"
        )
    if period_px is not None and not 0 < period_px < math.inf:
        raise UserError(f"--period {period_px:g}: a number of pixels above 0 is needed")
    chosen = _methods(methods or ()), _boxes(boxes or ())
    texture, size = _texture(given, resting, full_scale)
    wanted = correlation.variants(size, *chosen, quick)
    measured = correlation.study(texture, size, threads, wanted, quick)
    try:
        with Bar("preparing", quiet=False) as bar:
            found = study.run(measured, results, overwrite, bar.show)
    except KeyboardInterrupt as interrupt:
        goes_on = "the same command goes on from there" if results else "nothing is kept"
        place = f"{results}: " if results else ""
        say(f"{reason_of(interrupt)}: left before the end; {place}{goes_on}")
        return FAILED
    _print_table(measured, found)
    for sentence in correlation.advice(found, rate_hz, free, period_px):
        print_line(sentence)
    if picture is not None:
        from app.tradeoff.drawing import draw

        with new_file(picture, overwrite) as unfinished:
            draw(measured, found, unfinished)
    for path in filter(None, (results, picture)):
        print_line(f"written: {path}")
    return DONE


def _texture(
    pictures: Sequence[Path], rest: Sequence[Path], full_scale: int
) -> tuple[Texture, tuple[int, int]]:
    """The texture and the size of somebody's pictures, the first of which is the reference."""
    import numpy as np

    from app.cli.terminal import say
    from app.files.grey_images import size_text
    from app.tradeoff.texture import Texture, texture_of

    if not pictures:
        if rest:
            raise UserError("--rest: there is no reference; name it before the pictures at rest")
        say("no picture given: standard speckle with noise of 2 grey levels")
        return Texture(), SIZE
    first, *others = (_read(path) for path in [*pictures, *rest])
    for path, image in zip([*pictures, *rest][1:], others, strict=True):
        if image.shape != first.shape or image.dtype != first.dtype:
            raise UserError(
                f"{path}: {size_text(image)} found, the reference is {size_text(first)}; use"
                " pictures of one size and depth"
            )
    if min(first.shape) < LEAST_SIZE:
        raise UserError(
            f"{pictures[0]}: {size_text(first)} found; {LEAST_SIZE} px or more are needed on either"
            " side to measure a texture"
        )
    others = [image for image in others if not np.array_equal(image, first)]  # itself, by rest_*
    try:
        found = texture_of(first, others, full_scale)
    except ValueError as error:
        raise UserError(f"{pictures[0]}: {error}") from None
    source = f"by {len(others) + 1} pictures at rest" if others else "by the reference alone"
    say(f"{found.sentence()} {source}")
    if abs(found.neighbours) > CORRELATED:
        say(
            f"the noise of neighbouring pixels is correlated ({found.neighbours:.2f}), as after"
            " smoothing or compression; sigma is larger than predicted"
        )
    return found, (first.shape[0], first.shape[1])


def _read(path: Path) -> Any:
    from analysis.dic.tracker import checked
    from app.files.grey_images import read_image

    image = read_image(path)
    try:
        return checked(image, str(path))
    except ValueError as error:
        raise UserError(str(error)) from None


def _methods(names: Sequence[str]) -> list[str]:
    """The methods of these names, all where none is given."""
    from app.tradeoff.correlation_study import METHODS as known

    for name in names:
        check_known("--method", name, known)
    return list(dict.fromkeys(names or known))


def _boxes(sides: Sequence[int]) -> list[int]:
    declared = options(Correlation)["box"]
    for side in sides:
        if not declared.allows(side):
            raise UserError(f"--box {side}: {declared.wanted} is needed")
    return sorted(set(sides))


def _print_table(measured: Study, found: Found) -> None:
    """A table of all variants; a star at those which no other one beats."""
    from app.cli.terminal import print_line, print_table
    from app.tradeoff.study import front

    best = front(found, (measured.cost, *measured.errors))
    headings = [heading.replace(" (", "\n(") for heading in measured.columns.values()]
    rows = [
        ["*" if name in best else "", name, *(_cell(figures[key]) for key in measured.columns)]
        for name, figures in found.items()
    ]
    print_table(["", measured.subject, *headings], rows, texts=("", measured.subject), widest=44)
    axes = ", ".join(measured.columns[key] for key in (measured.cost, *measured.errors))
    print_line(f"*: no other is better in {axes}")


def _cell(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    digits = 3 - math.ceil(math.log10(abs(value))) if value else 0
    return f"{round(value, digits):,.{max(0, digits)}f}" if abs(value) > 1e-4 else f"{value:.1e}"
