"""The commands of `slipscope` about a bench: its settings, which devices there are, and whether
they work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option, Typer

from app.cli import completion
from app.cli.command_options import (
    Bench,
    JsonFlag,
    Overrides,
    Overwrite,
    command,
    output_file,
)
from app.system.errors import UserError

if TYPE_CHECKING:
    from app.bench_checks.doctor import Checked

app = Typer()


@command(app)
def config(
    name: Annotated[
        str | None,
        Argument(
            metavar="[NAME]",
            help="A bench that comes with the program: hil-emulated, pci-6251, slide-hold-slide,"
            " cyclic-shear; or six-loads.",
            autocompletion=completion.files(benches=True, campaigns=True),
        ),
    ] = None,
    overrides: Overrides = None,
) -> int:
    """Print the default settings, each with its meaning, unit and limits: `slipscope config >
    bench.toml`.

    With a name: the few settings of a bench, or the campaign, that comes with the program. With
    --set: all settings, including those of a driver given by --set
    actuator.source=package.module:Class.
    """
    from app.settings.config import BENCHES, CAMPAIGNS, load, to_toml

    if name is None or overrides:
        text = to_toml(load(None if name is None else Path(name), overrides or ()))
    else:
        own = {file.stem: file for at in (BENCHES, CAMPAIGNS) for file in sorted(at.glob("*.toml"))}
        if name not in own:
            raise UserError(f"config: nothing is called '{name}'; known: {', '.join(own)}")
        text = own[name].read_text(encoding="utf-8")
    typer.echo(text, nl=False)
    return 0


@command(app)
def check(
    bench: Bench = None,
    home: Annotated[
        bool, Option("--home", help="Let the stage search its origin. It moves.")
    ] = False,
    move_um: Annotated[
        float,
        Option(
            "--move",
            metavar="UM",
            help="Move the stage by this distance in um at the velocity of a run, and back.",
            show_default=False,
        ),
    ] = 0.0,
    sync: Annotated[
        bool,
        Option(
            "--sync",
            help="Measure when the exposure of a trigger is counted, and write a certificate for"
            " later sessions.",
        ),
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Test a bench item by item: devices, samples, triggers, frames, sensors, image. Nothing moves
    unless an option allows it.

    Takes two seconds of data and records nothing. The exit code is 1 if something does not work.

    Example: `slipscope check bench.toml --move 10`
    """
    from app.bench_checks.bench_check import check as checked
    from app.bench_checks.doctor import as_data
    from app.bench_checks.sync_check import sync_check
    from app.cli.terminal import DONE, FAILED, print_json, print_line
    from app.processes.stoppable import stoppable
    from app.runs.live import make_bench, unpressed
    from app.settings.config import load

    config = load(bench, overrides or ())
    with ExitStack() as stack:
        make = partial(make_bench, unpressed(config), 1.0)
        if home or move_um:
            make = partial(_made_stoppable, make, stack.enter_context(stoppable(config, "check")))
        steps: Iterator[Checked] = checked(config, make, home=home, move_um=move_um)
        if sync:  # a simulated bench runs only once
            steps = chain(steps, sync_check(config, make_bench(config, 1.0)))
        findings = _printed(steps, quiet=as_json)
    works = _works(findings)
    if as_json:
        print_json({"works": works, "findings": [as_data(finding) for finding in findings]})
    else:
        moved = "" if home or move_um else "; nothing was moved (--home and --move allow it)"
        print_line(f"the bench {'works' if works else 'does not work'}{moved}")
    return DONE if works else FAILED


def _printed(findings: Iterator[Checked], *, quiet: bool = False) -> list[Checked]:
    """What was found, each of which is printed as it comes."""
    from app.cli.terminal import print_line

    found = []
    for finding in findings:
        found.append(finding)
        if not quiet:
            print_line(f"{finding.mark} {finding.label}: {finding.value}")
    return found


def _works(findings: Iterable[Checked]) -> bool:
    """Whether all that is needed is fine."""
    return all(finding.is_fine or not finding.needed for finding in findings)


def _made_stoppable(make: Callable[[], Any], stoppable: Callable[[Any], Any]) -> Any:
    made = make()
    return replace(made, actuator=stoppable(made.actuator))


@command(app)
def setup(
    bench: Annotated[Path, output_file("BENCH.toml", "File for the settings of the bench.")],
    yes: Annotated[
        bool,
        Option(
            "--yes",
            help="Ask nothing; use the first board and camera found, a simulated stage, and the"
            " defaults.",
        ),
    ] = False,
    overwrite: Overwrite = False,
) -> int:
    """Set up a new bench: find boards, cameras and ports, ask what only you know, write the
    settings with comments, check each device, and list the calibrations that are missing. Nothing
    moves.

    Enter accepts the value in brackets. The exit code is 1 if a device does not work.

    Example: `slipscope setup -o bench.toml`
    """
    from app.bench_checks.bench_check import check as checked
    from app.bench_checks.bench_setup import DeviceChoice, answered, bench_file_of, choices
    from app.calibrations.kinds import KINDS
    from app.cli.terminal import DONE, FAILED, print_line, say
    from app.runs.live import make_bench, unpressed
    from app.settings.certificates import certificates_of
    from app.system.outputs import check_output, new_file

    check_output(bench, overwrite, what="settings file", endings=(".toml",))

    def ask(question: str, now: str) -> str:
        try:
            return now if yes else str(typer.prompt(question, default=now, err=True))
        except typer.Abort:
            raise UserError(
                f"setup: no answer to '{question}', so that {bench} was not written; answer, or"
                " give --yes to take what is proposed"
            ) from None

    devices: dict[str, DeviceChoice] = {}
    for kind, found in choices().items():
        for number, choice in enumerate(found, 1):
            say(f"{kind} {number}: {choice.about}")
        # any device may be on a port, and a check would talk to it
        proposed = str(len(found) if kind == "actuator" else 1)
        while kind not in devices:
            answer = ask(f"Which {kind}", proposed)
            if answer.isdecimal() and 0 < int(answer) <= len(found):
                devices[kind] = found[int(answer) - 1]
            else:
                say(f"'{answer}' is none of them; give a number from 1 to {len(found)}")
    config, text = bench_file_of(answered(devices, ask, say))
    with new_file(bench, overwrite) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    make = partial(make_bench, unpressed(config), 1.0)
    works = _works(_printed(checked(config, make, home=False, move_um=0.0)))
    known = {one.what for one in certificates_of(config).values()}
    for name, calibration in KINDS.items():
        if name not in known:
            print_line(f"to do  slipscope calibrate {name}: {calibration.title}")
    print_line(f"settings: {bench}; slipscope run {bench} begins with them")
    return DONE if works else FAILED


@command(app)
def check_driver(
    source: Annotated[
        str,
        Argument(
            metavar="PACKAGE.MODULE:CLASS",
            help="The class of the driver; Python must be able to import it.",
        ),
    ],
    move: Annotated[
        bool,
        Option("--move", help="Move the stage of an actuator, by up to 1 mm in both directions."),
    ] = False,
    overrides: Overrides = None,
    as_json: JsonFlag = False,
) -> int:
    """Test a driver of your own, with its device connected, against the requirements for drivers of
    its kind: one line for each.

    A camera is tested with the sample clock of the forces in the settings (default: simulated
    forces). The exit code is 1 if a requirement is not met, 2 if there is no such driver.

    Example: `slipscope check-driver my_lab.stage:Stage --move --set actuator.port=COM3`
    """
    from app.cli.check_driver import check_driver as tried

    return tried(source, overrides or (), move=move, as_json=as_json)


@command(app)
def trust(
    code: Annotated[
        Path,
        Argument(
            metavar="FILE|FOLDER", help="A GenTL producer, a module, or the folder of a package."
        ),
    ],
    as_json: JsonFlag = False,
) -> int:
    """Allow settings to run code that came with them: a GenTL producer, or a driver beside the
    settings or in the current folder.

    The file is identified by its SHA-256 and must be confirmed again after any change. The
    confirmation covers all code that it loads.

    Example: `slipscope trust my_stage.py`
    """
    from app.cli.terminal import DONE, print_json, print_line
    from app.settings.trusted_settings import confirm

    known = confirm(code)
    if as_json:
        print_json({"file": str(code), "sha256": known})
    else:
        print_line(f"{code} may be run as it is now, SHA-256 {known}")
    return DONE


@command(app)
def cameras(
    producer: Annotated[
        str,
        Option(
            metavar="FILE.cti",
            help="GenTL producer of a camera vendor, to list the vendor's cameras too.",
            show_default=False,
        ),
    ] = "",
    as_json: JsonFlag = False,
) -> int:
    """List the cameras of this computer, with the value of camera.device for each."""
    from app.bench_checks.doctor import as_data, found_by
    from app.cli.terminal import DONE, print_json, print_line, print_rows

    findings = {
        "pylon": found_by("drivers.cameras.pylon_camera"),
        "gentl": found_by("drivers.cameras.gentl_camera", producer) if producer else [],
    }
    if as_json:
        print_json({driver: [as_data(f) for f in found] for driver, found in findings.items()})
        return DONE
    for driver, found in findings.items():
        if found:
            print_rows(f'camera.source = "{driver}"', [(f.label, f.symbol, f.value) for f in found])
    if not producer:
        print_line("cameras of other vendors: slipscope cameras --producer PRODUCER.cti")
    return DONE


@command(app)
def doctor(as_json: JsonFlag = False) -> int:
    """Check this computer: versions, devices, display, disk, cores; what is missing and how to
    install it.

    The exit code is 1 if something that every run needs is missing.
    """
    from app.bench_checks.doctor import as_data, examine
    from app.cli.terminal import DONE, FAILED, print_json, print_rows

    findings = examine()
    is_able = _works(chain.from_iterable(findings.values()))
    if as_json:
        groups = {heading: [as_data(f) for f in group] for heading, group in findings.items()}
        print_json({"is_able_to_run": is_able, **groups})
    else:
        for heading, group in findings.items():
            print_rows(heading, [(f.label, f.symbol, f.value) for f in group])
    return DONE if is_able else FAILED


@command(app)
def menu_entry(
    is_removed: Annotated[bool, Option("--remove", help="Remove the entry and its icon.")] = False,
    as_json: JsonFlag = False,
) -> int:
    """Add SlipScope to the menu of your desktop: a desktop entry on Linux, a shortcut in the start
    menu on Windows.

    The entry starts this installation; give the command again after you have moved it.
    """
    from app.cli.terminal import DONE, print_json, print_line
    from app.system.menu_entry import add, remove

    def save_icon(path: Path) -> None:
        from app.gui.icon import save_icon

        save_icon(path)

    files = [str(file) for file in (remove() if is_removed else add(save_icon))]
    if as_json:
        print_json({"removed" if is_removed else "written": files})
    elif files:
        print_line(f"{'removed' if is_removed else 'written'}: {', '.join(files)}")
    else:
        print_line("there is no entry to remove")
    return DONE
