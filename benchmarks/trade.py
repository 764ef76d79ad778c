"""A study of `app.tradeoff.study` as a benchmark."""

from __future__ import annotations

from app.tradeoff.study import Study, front, run
from benchmarks.report import Report


def report_study(report: Report, study: Study) -> None:
    """Measure all variants, and report those figures that could be determined."""
    found = run(study, None, True, lambda text, share: print(f"{share:4.0%} {text}", flush=True))
    best = front(found, (study.cost, *study.errors))
    about = "; ".join(f"{key.replace('_', ' ')}: {value}" for key, value in study.about.items())
    report.table(f"{about}; no other variant is better than those with a star")
    for name, figures in found.items():
        for key, heading in study.columns.items():
            column, _, unit = heading.rstrip(")").partition(" (")
            if figures[key] == figures[key]:
                star = " *" if name in best else ""
                report.add(name + star, figures[key], unit, column=column)
