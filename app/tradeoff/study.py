"""A measurement of many variants, one after the other, that can be left and taken up again; and the
best of them.
"""

from __future__ import annotations

import json
import math
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from app.system.durations import duration
from app.system.errors import UserError
from app.system.outputs import check_output, new_file
from app.system.progress import HowFar, unheard

Figures = dict[str, float]
Found = dict[str, Figures]
SAME = 1.01  # figures closer than this are the same: noise would put all of them on a front
LONGEST = 1 << 24  # bytes of a results file


@dataclass(frozen=True, slots=True)
class Variant:
    """What is measured: a method with its `settings` as people write them, its `group` in a
    picture, and the `effort` that is expected of it, in any unit.
    """

    name: str
    group: str
    settings: dict[str, Any]
    effort: float = 1.0


@dataclass(frozen=True, slots=True)
class Study:
    """What is measured of which variants.

    Attributes
    ----------
    subject : str
    about : dict
        What the figures hold for, besides this computer and version: results of another one are
        not continued.
    columns : dict
        Name of a figure, with its unit -> its heading.
    cost, errors : str, tuple of str
        The names of the figures of which a variant is best that has no other below it in all; those
        of `errors` are drawn against the first.
    """

    subject: str
    about: dict[str, Any]
    columns: dict[str, str]
    cost: str
    errors: tuple[str, ...]
    variants: tuple[Variant, ...]
    measure: Callable[[Variant], Figures]

    def identity(self) -> dict[str, Any]:
        """All that figures depend on, as JSON gives it back."""
        about = {"subject": self.subject, **computer(), **self.about}
        return dict(json.loads(json.dumps(about)))


def computer() -> dict[str, str]:
    """This computer, and the version of the program and of what does its arithmetic."""
    from app.session.versions import processor

    packages = ("slipscope", "numpy", "numba", "opencv-python-headless")
    versions = " ".join(f"{name} {metadata.version(name)}" for name in packages)
    return {"machine": platform.node(), **processor(), "version": versions}


def run(
    study: Study,
    results: Path | None,
    overwrite: bool,
    on_progress: HowFar = unheard,
) -> Found:
    """The figures of every variant of a study, by name.

    Each is written to the file `results` as soon as it is measured; what is there already is not
    measured again, and stays there. `overwrite` allows it to replace a file that holds something
    else.

    Raises
    ------
    UserError
        The file cannot be written, or holds something else.
    """
    found: Found = {}
    settings: dict[str, Any] = {}
    if results is not None:
        check_output(results, overwrite=True, endings=(".json",))
        if results.exists():
            try:
                found, settings = read_results(study, results)
            except UserError:
                if not overwrite:
                    raise
    settings |= {v.name: v.settings for v in study.variants}
    left = sum(v.effort for v in study.variants if v.name not in found)
    began, done = time.perf_counter(), 0.0
    for n, variant in enumerate(study.variants, 1):
        if variant.name in found:
            continue
        spent = time.perf_counter() - began
        rest = f"; {duration(spent * (left / done - 1))} left" if done else ""
        text = f"{n} of {len(study.variants)}: {variant.name}{rest}"
        on_progress(text, done / left)
        found[variant.name] = study.measure(variant)
        done += variant.effort
        if results is not None:
            write(study, found, settings, results)
    if results is not None and not done:
        write(study, found, settings, results)
    on_progress("done", 1.0)
    return {v.name: found[v.name] for v in study.variants}


def write(
    study: Study, found: Mapping[str, Figures], settings: Mapping[str, Any], path: Path
) -> None:
    """Keep what was found so far, with the settings of each variant by its name; figures that could
    not be determined are null.
    """
    best = front(found, (study.cost, *study.errors))
    rows = [
        {"name": name, "settings": settings[name], "is_on_the_front": name in best}
        | {key: x if math.isfinite(x) else None for key, x in figures.items()}
        for name, figures in found.items()
    ]
    about = {"about": study.identity(), "columns": study.columns, "variants": rows}
    text = json.dumps(about, indent=1, ensure_ascii=False, allow_nan=False)
    with new_file(path, overwrite=True) as unfinished:
        unfinished.write_text(text + "\n", encoding="utf-8")


def read_results(study: Study, path: Path) -> tuple[Found, dict[str, Any]]:
    """The figures in a file of results of the same study, and the settings, each by the name of its
    variant.

    Raises
    ------
    UserError
        It holds something else.
    """
    try:
        if path.stat().st_size > LONGEST:
            raise ValueError("too long")
        held = json.loads(path.read_text(encoding="utf-8"))
        about = dict(held["about"])
        found = {
            str(row["name"]): {
                key: math.nan if row[key] is None else float(row[key]) for key in study.columns
            }
            for row in held["variants"]
        }
        settings = {str(row["name"]): row["settings"] for row in held["variants"]}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise UserError(
            f"{path}: not the results of `slipscope tradeoff`; choose another name or give"
            " --overwrite"
        ) from None
    mine = study.identity()
    for key in mine | about:
        if mine.get(key) != about.get(key):
            raise UserError(
                f"{path}: measured with another {key.replace('_', ' ')} ({_brief(about.get(key))},"
                f" now {_brief(mine.get(key))}), so that its figures cannot be continued; choose"
                " another name or give --overwrite"
            )
    return found, settings


def front(found: Mapping[str, Figures], axes: tuple[str, ...]) -> list[str]:
    """Names of the variants that no other one beats: as low in all of these figures, and lower in
    one, where a per cent is no difference. A figure that could not be determined is infinite.
    """
    points = {
        name: [x if math.isfinite(x := figures[a]) else math.inf for a in axes]
        for name, figures in found.items()
    }

    def beats(q: list[float], p: list[float]) -> bool:
        pairs = list(zip(q, p, strict=True))
        return all(b <= SAME * a for b, a in pairs) and any(b * SAME < a for b, a in pairs)

    return [
        name
        for name, p in points.items()
        if any(map(math.isfinite, p)) and not any(beats(q, p) for q in points.values())
    ]


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
