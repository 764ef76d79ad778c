"""How large the program is, and how its packages rest on each other.

    python tests/structure.py
    python tests/structure.py app/report analysis/dic/icgn.py    # how large these are

Nodes are those of the syntax trees, which do not depend on how wide lines are. A room is a package
or a module directly in `app`; it stands one floor above the highest room that it imports from.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter, defaultdict
from collections.abc import Sequence
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGES = ("analysis", "app", "drivers", "slipscope")


class Structure(NamedTuple):
    """What a newcomer has to keep in mind."""

    nodes: Counter[str]  # by package, those of the window apart
    arrows: set[tuple[str, str]]  # from a room to one that it imports from
    floors: dict[str, int]  # of the rooms; empty where some stand on each other
    # modules by the name of a class, private or not, or of a module that several have
    same_classes: dict[str, list[str]]
    same_modules: dict[str, list[str]]


def imported(tree: ast.AST) -> set[str]:
    """Every name of ours that is imported, also within functions and for annotations."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {f"{node.module}.{one.name}" for one in node.names}
        elif isinstance(node, ast.Import):
            names |= {one.name for one in node.names}
    return {name for name in names if name.partition(".")[0] in PACKAGES}


def room_of(module: str) -> str:
    """The second part of a dotted name."""
    return module.split(".")[1]


def sources(places: Sequence[str] = PACKAGES) -> list[Path]:
    """The files of the program, or of some folders and files of it, in order."""
    found = (ROOT / place for place in places)
    return sorted(path for one in found for path in ([one] if one.suffix else one.rglob("*.py")))


def size(path: Path) -> int:
    """Nodes of a file."""
    return sum(1 for _ in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def structure() -> Structure:
    """Of the sources as they are."""
    nodes: Counter[str] = Counter()
    classes, modules = defaultdict(list), defaultdict(list)
    above: dict[str, set[str]] = defaultdict(set)
    for path in sources():
        parts = path.relative_to(ROOT).with_suffix("").parts
        tree, module = ast.parse(path.read_text(encoding="utf-8")), ".".join(parts)
        nodes["app.gui" if parts[1] == "gui" else parts[0]] += sum(1 for _ in ast.walk(tree))
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name.lstrip("_")].append(module)
        if not parts[-1].startswith("__"):
            modules[parts[-1]].append(module)
        if parts[0] == "app" and parts[1] != "__init__":
            rooms = {room_of(name) for name in imported(tree) if name.startswith("app.")}
            above[parts[1]] |= rooms - {parts[1]}
    floors: dict[str, int] = {}
    try:
        for room in TopologicalSorter(above).static_order():
            floors[room] = 1 + max((floors[below] for below in above[room]), default=0)
    except CycleError:
        floors = {}
    return Structure(
        nodes,
        {(room, below) for room, rooms in above.items() for below in rooms},
        floors,
        {name: found for name, found in classes.items() if len(found) > 1},
        {name: found for name, found in modules.items() if len(found) > 1},
    )


def main() -> None:
    """Print it, or the nodes of what is named."""
    for place in sys.argv[1:]:
        print(f"{place:35s} {sum(map(size, sources([place]))):8,d} nodes")
    if sys.argv[1:]:
        return
    found = structure()
    for package, count in sorted(found.nodes.items()):
        print(f"{package:10s} {count:8,d} nodes")
    print(f"{'all':10s} {sum(found.nodes.values()):8,d} nodes")
    print(f"{len(found.floors)} rooms of app, {len(found.arrows)} arrows, floors:")
    for floor in range(max(found.floors.values(), default=0), 0, -1):
        print(
            f"  {floor:2d}  {'  '.join(r for r, n in sorted(found.floors.items()) if n == floor)}"
        )
    for what, same in (("classes", found.same_classes), ("modules", found.same_modules)):
        print(f"{len(same)} names of several {what}")
        for name, where in sorted(same.items()):
            print(f"  {name}: {', '.join(where)}")


if __name__ == "__main__":
    main()
