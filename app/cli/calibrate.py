"""`slipscope calibrate WHAT`: measures what is calibrated on a bench, or takes it from files, and
writes its certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Typer

from app.calibrations.calibration import Calibration
from app.calibrations.kinds import KINDS
from app.cli.command_options import (
    Bench,
    Given,
    Headless,
    JsonFlag,
    Overrides,
    Overwrite,
    Pace,
    command,
    output_file,
)
from app.cli.names import JsonData
from app.settings.certificates import ENDING, CalibrationCertificate
from app.settings.sections import Config
from app.system.errors import CalibrationRefused, UserError

if TYPE_CHECKING:
    from app.calibrations.certifying import Evaluated

app = Typer()
Output = Annotated[Path, output_file("CERTIFICATE.zip", "File for the certificate.")]


def _command_of(calibration: Calibration[Any]) -> None:
    """The command of a calibration."""

    def calibrate(
        files: list[Path] | None = None,
        *,
        certificate: Output,
        given: dict[str, Any],
        headless: Headless = False,
        pace: Pace = "1",
        overrides: Overrides = None,
        overwrite: Overwrite = False,
        as_json: JsonFlag = False,
    ) -> int:
        from app.calibrations.certifying import evaluated
        from app.settings.config import bench_names, campaign_names, load
        from app.system.outputs import check_output

        sources, options = files or [], calibration.Options(**given)
        names = {*bench_names(), *campaign_names()}  # `load` refuses a campaign, and says why
        benches = [path for path in sources if path.suffix == ".toml" or str(path) in names]
        check_output(certificate, overwrite, what="certificate", endings=(ENDING,))
        config = None
        if len(sources) <= len(benches) <= 1:
            config = load(benches[0] if benches else None, overrides or ())
            try:
                plan = calibration.plan(config, options)
            except ValueError as error:
                raise UserError(f"calibrate {calibration.name}: {error}") from None
            sources = measured(plan, certificate, headless, pace, overwrite, as_json)
        elif len(benches) > 1:
            raise UserError(f"calibrate {calibration.name}: {len(benches)} benches found; give one")
        elif benches or overrides:
            raise UserError(
                f"calibrate {calibration.name}: {benches[0] if benches else '--set'} is about a"
                f" bench that measures, and {sources[-1]} was measured; give one bench, or files"
                " only"
            )
        found = evaluated(calibration, sources, options, given)
        return certified(found, config, certificate, overwrite, as_json)

    calibrate.__name__ = calibration.name.replace("-", "_")
    # annotations are text here, which knows nothing of this calibration
    what = Argument(
        metavar=f"[BENCH.toml|{calibration.files}|CERTIFICATE.zip]",
        help="The bench on which to measure (default: the simulated bench), or measured files, or"
        " a certificate whose data are to be evaluated again.",
    )
    calibrate.__annotations__ |= {
        "files": Annotated[list[Path] | None, what],
        "given": Annotated[dict[str, Any], Given(calibration.Options, has_defaults=True)],
    }
    calibrate.__doc__ = f"{calibration.title}\n\nExample: `{calibration.example}`"
    command(app)(calibrate)


for _one in KINDS.values():
    _command_of(_one)


def measured(
    plan: Sequence[Config],
    certificate: Path,
    headless: bool,
    pace: str,
    overwrite: bool,
    as_json: bool,
) -> list[Path]:
    """The sessions of the runs of a calibration, which lie beside its certificate.

    Raises
    ------
    UserError, DeviceError
        A run cannot be made.
    CalibrationRefused
        One did not come to its end.
    """
    from app.cli.names import parse_pace
    from app.cli.run_and_replay import run_to_end, window_problem
    from app.processes.prepared import prepared_run
    from app.session.files import check_new_session

    sessions = [
        certificate.with_name(f"{certificate.stem}-{number}.h5")
        for number in range(1, len(plan) + 1)
    ]
    for session in sessions:
        check_new_session(session, overwrite)
    problem, speed = window_problem(headless), parse_pace(pace)
    for config, session in zip(plan, sessions, strict=True):
        done = run_to_end(
            partial(prepared_run, config, session, speed, overwrite),
            problem,
            as_json=as_json,
            closes=True,
        )
        ended = done.reports[-1] if done.reports else {"state": "stopped", "reason": done.signal}
        if ended["state"] != "done":
            raise CalibrationRefused(
                f"calibrate: the run of {session.name} {ended['state']}: {ended.get('reason')};"
                " no certificate was written"
            )
    return sessions


def certified(
    found: Evaluated, config: Config | None, path: Path, overwrite: bool, as_json: bool
) -> int:
    """Write and print a certificate; the exit code."""
    from app.cli.terminal import DONE, print_json, print_line, print_rows
    from app.report.summary_rows import known_rows

    found.write(path, overwrite)
    if as_json:
        print_json({"file": str(path), **as_data(found.certificate)})
        return DONE
    print_rows(f"calibration: {found.certificate.what}", known_rows(found.result.values))
    if found.certificate.settings:
        print_rows("settings that follow", changes(found.certificate, config))
    for remark in found.result.remarks:
        print_line(f"note: {remark}")
    print_line(
        f"certificate: {path}, valid until {found.certificate.due}; write into the settings of the"
        f' bench: [calibration] certificates = ["{path.name}"]'
    )
    return DONE


def changes(
    certificate: CalibrationCertificate, config: Config | None
) -> list[tuple[str, str, str]]:
    """Each setting that follows, what it was, and what it is."""
    from app.settings.config import keyed
    from app.settings.plain_values import toml_text

    before = keyed(config) if config else {}
    return [
        (key, "", f"{toml_text(value)}" + (f" (was {toml_text(before[key])})" if before else ""))
        for key, value in certificate.settings.items()
    ]


def as_data(certificate: CalibrationCertificate) -> JsonData:
    """A certificate as plain data."""
    import msgspec

    held: JsonData = msgspec.to_builtins(certificate)
    return held | {"due": certificate.due}


@command(app)
def _list(bench: Bench = None, overrides: Overrides = None, as_json: JsonFlag = False) -> int:
    """List all calibrations, with the certificates of a bench, their age and the date when they are
    due again.

    Example: `slipscope calibrate list bench.toml`
    """
    from app.cli.terminal import DONE, print_json, print_table
    from app.settings.certificates import certificates_of
    from app.settings.config import load

    held = certificates_of(load(bench, overrides or ()))
    if as_json:
        print_json({str(path): as_data(one) for path, one in held.items()})
        return DONE
    rows = []
    for name, calibration in KINDS.items():
        of = {path.name: one for path, one in held.items() if one.what == name}
        rows += [
            (name, calibration.title, file, f"{one.age_days:.0f}", one.due + " !" * one.is_due)
            for file, one in of.items()
        ] or [(name, calibration.title, "none", "", "")]
    print_table(
        ("calibration", "finds", "certificate", "age (days)", "due"),
        rows,
        texts=("calibration", "finds", "certificate", "due"),
    )
    return DONE
