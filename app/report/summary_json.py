"""All numbers of an analysis of sessions as plain data for `summary.json`: SI units, named in the
keys; null where nothing was measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from app.records.quantities import Measurement
from app.records.study_results import StudyResults
from app.report.document import DocumentPicture
from app.report.findings import Findings, paper_of
from app.report.practice import PracticeRows
from app.report.summary_rows import plain


def summary_data(
    results: StudyResults,
    found: Findings,
    practice: PracticeRows,
    pictures: Sequence[DocumentPicture],
) -> dict[str, Any]:
    """The document, in a fixed order."""
    data: dict[str, Any] = plain(
        {
            "made_with": dict(sorted(results.made_with.items())),
            "inputs": _numbers(found.inputs),
            "inputs_that_differ": {key: list(texts) for key, texts in found.differing.items()},
            "joint": {"numbers": _numbers(found.joint), "notes": list(found.notes)},
            "runs": [
                {
                    "session": run.session,
                    **run.about,
                    "numbers": _numbers(run.numbers, run.load),
                    "notes": list(run.notes),
                }
                for run in found.runs
            ],
            "correlation": {item: value for _, item, value in practice},
            "figures": {one.name: _figure(one) for one in pictures},
        }
    )
    return data


def _numbers(found: Sequence[Measurement], load: float = math.nan) -> dict[str, Any]:
    numbers = {}
    for one in found:
        number: dict[str, Any] = {
            "name": one.name,
            "value": one.value,
            "sd": one.total,
            "sd_noise": one.sd,
            "sd_inputs": one.systematic,
        }
        if not one.is_resolved:
            number["not_resolved_upper_bound"] = one.bound
        if one.budget:
            number["budget"] = one.budget
        if (published := paper_of(one, load)) is not None:
            number["paper"] = {
                "value": published.value,
                "sd": published.sd,
                "where": published.where,
            }
        numbers[one.key] = number
    return numbers


def _figure(one: DocumentPicture) -> dict[str, Any]:
    if not one.png:
        return {"title": one.title, "left_out": one.caption}
    return {"title": one.title, "caption": one.caption, "files": list(one.files)}
