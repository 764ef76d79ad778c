"""`slipscope check`, `slipscope cameras` and `slipscope doctor`: which devices there are, and
whether they work.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import chain
from pathlib import Path

from app.bench_checks.doctor import Checked, as_data, examine, found_by
from app.cli.terminal import DONE, FAILED, output, print_json, print_rows
from app.settings.config import load
from app.settings.trusted_settings import confirm


def check(
    bench: Path | None,
    overrides: Sequence[str],
    *,
    home: bool,
    move_um: float,
    sync: bool,
    as_json: bool,
) -> int:
    """Check a bench and print what works; the exit code."""
    from app.bench_checks.bench_check import check as check_all
    from app.bench_checks.bench_check import unpressed
    from app.bench_checks.sync_check import sync_check
    from app.runs.live import make_bench

    config = load(bench, tuple(overrides))
    findings: list[Checked] = []
    make = partial(make_bench, unpressed(config), 1.0)
    steps: Iterator[Checked] = check_all(config, make, home=home, move_um=move_um)
    if sync:  # a simulated bench runs only once
        steps = chain(steps, sync_check(config, make_bench(config, 1.0)))
    for finding in steps:
        findings.append(finding)
        if not as_json:
            output().print(
                f"{'ok    ' if finding.is_fine else 'FAILS ' if finding.needed else 'look  '}"
                f" {finding.label}: {finding.value}"
            )
    works = all(finding.is_fine or not finding.needed for finding in findings)
    if as_json:
        print_json({"works": works, "findings": [as_data(finding) for finding in findings]})
    else:
        moved = "" if home or move_um else "; nothing was moved (--home and --move allow it)"
        output().print(f"the bench {'works' if works else 'does not work'}{moved}")
    return DONE if works else FAILED


def trust(code: Path, as_json: bool) -> int:
    """Let settings run this code from now on, as it is; the exit code."""
    known = confirm(code)
    if as_json:
        print_json({"file": str(code), "sha256": known})
    else:
        output().print(f"{code} may be run as it is now, SHA-256 {known}")
    return DONE


def cameras(producer: str, as_json: bool) -> int:
    """List the cameras that the drivers find; the exit code, 0 also if there is none."""
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
        output().print("cameras of other vendors: slipscope cameras --producer PRODUCER.cti")
    return DONE


def doctor(as_json: bool) -> int:
    """Print the findings; the exit code, 1 if something is missing that every run needs."""
    findings = examine()
    is_able = all(
        finding.is_fine or not finding.needed for group in findings.values() for finding in group
    )
    if as_json:
        print_json(
            {
                "is_able_to_run": is_able,
                **{heading: [as_data(f) for f in group] for heading, group in findings.items()},
            }
        )
    else:
        for heading, group in findings.items():
            print_rows(heading, [(f.label, f.symbol, f.value) for f in group])
    return DONE if is_able else FAILED
