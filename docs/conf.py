"""How Sphinx makes a site of the pages of docs/, without a network:

    python -m sphinx -W --keep-going docs docs/_build/html

The pages of docs/ are plain Markdown, as they are read in the repository; docs/index.md orders
them. The pages of docs/site/ exist on the site only: the API and the gallery, which are made here
of docstrings, declarations and pictures, and README.md and CHANGELOG.md.
"""

from __future__ import annotations

import inspect
import itertools as it
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import is_dataclass
from functools import reduce
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.addnodes import desc, pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.inspect import TypeAliasForwardRef
from sphinx.util.nodes import make_refnode

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))  # the program of this folder, not one that is installed

import analysis  # noqa: E402
from app.records.record_types import Snapshot  # noqa: E402
from app.records.schema import columns_of, is_record  # noqa: E402
from app.records.snapshot_numbers import NUMBERS  # noqa: E402

project = "SlipScope"
release = tomllib.loads((DOCS.parent / "pyproject.toml").read_text("utf-8"))["project"]["version"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "numpydoc"]
exclude_patterns = ["_build"]
nb_execution_mode = "off"  # the notebooks hold their output, and tests run them
myst_heading_anchors = 4
smartquotes = False  # "--set" is an option
html_theme = "furo"
html_title = f"SlipScope {release}"
html_copy_source = html_show_sphinx = False

nitpicky = True  # a name that leads nowhere is a warning
OTHERS = r"(np|numpy|xarray|os|pathlib|collections\.abc)\..*|ArrayLike|NDArray|DTypeLike|Axes"
nitpick_ignore_regex = [("py:(class|obj)", OTHERS)]  # of other libraries: there is no network

default_role = "py:obj"  # docstrings name an object, or code, in single backticks
add_module_names = False
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_preserve_defaults = True
ALIASES = ("ArrayLike", "NDArray", "Array", "Bool", "U8", "I64", "F32", "F64", "Columns")
autodoc_type_aliases = {name: name for name in ALIASES}
TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # Sphinx shows it in F64 | None
numpydoc_show_class_members = False

# ------------------------------------------------------------------ pages

ON_SITE = {"README.md": "site/start.md", "CHANGELOG.md": "site/changelog.md"}
PICTURE = re.compile(r"!\[([^\]]*)\]\(([^)]*)\)")


def complete(app: Sphinx, page: str, text: list[str]) -> None:
    """Add what is made to a page, and lead links out of docs/ to where the site has these files."""
    text[0] += "\n".join({"site/analysis": functions, "site/gallery": pictures}.get(page, list)())
    up = "../" * page.count("/")
    for file, there in ON_SITE.items():
        text[0] = text[0].replace(f"]({up}../{file}", f"]({up}{there}")


def functions() -> Iterator[str]:
    """What each package of `analysis` exports, and the classes that these name in signatures."""
    packages = [
        getattr(analysis, name)
        for name in ("dic", "inversion", "friction", "contact", "calibration", "mechanics")
    ]
    shown = {getattr(package, name) for package in packages for name in package.__all__}
    for package in packages:
        yield f"\n## {package.__name__}\n"
        yield from rst(f".. automodule:: {package.__name__}")
        exported = [getattr(package, name) for name in package.__all__]
        for one in exported:
            if isinstance(one, ModuleType):
                yield f"\n### {package.__name__}.{one.__name__.rpartition('.')[2]}\n"
                yield from rst(f".. automodule:: {one.__name__}")
        for kind in sorted(classes_of(exported) - shown, key=lambda kind: kind.__name__):
            yield from rst(f".. autoclass:: {kind.__module__}.{kind.__name__}")
            shown.add(kind)


def classes_of(exported: list[Any]) -> set[type]:
    """The classes of `analysis` that these name in their signatures, with those that they name."""
    known = [*exported]
    for one in known:
        members = vars(one).items() if isinstance(one, type | ModuleType) else ()
        public = [member for name, member in members if name == "__init__" or name[0] != "_"]
        if isinstance(one, ModuleType):  # its own, not what it imports
            public = [each for each in public if inspect.getmodule(each) is one]
        for each in (one, *public):
            for kind in named_classes(each):
                if kind.__module__.startswith("analysis.") and kind not in known:
                    known.append(kind)
    modules = {one.__name__ for one in exported if isinstance(one, ModuleType)}
    return {kind for kind in known[len(exported) :] if kind.__module__ not in modules}


def named_classes(one: Any, *kinds: str) -> Iterator[type]:
    """The public classes in the annotations of a function, property or class, or in some of
    these.
    """
    for made_by in ("fget", "func", "__func__"):  # property, cached property, class method
        one = getattr(one, made_by, one)
    said = getattr(one, "__annotations__", {})
    for text in (str(said.get(kind)) for kind in kinds or said):
        for name in re.findall(r"\b[A-Z]\w+", text):
            kind = getattr(inspect.getmodule(one), name, None)
            if inspect.isclass(kind):
                yield kind


def rst(line: str) -> list[str]:
    return ["```{eval-rst}", line, "```"]


def pictures() -> Iterator[str]:
    """The pictures of all pages and notebooks, each below the title of its page."""
    for page in sorted(DOCS.glob("*.md")):
        text = page.read_text("utf-8")
        if found := PICTURE.findall(text):
            yield f"\n## [{text.splitlines()[0].strip('# ')}](../{page.name})\n"
            yield from (
                f"![{said}](../{file})\n\n{' '.join(said.split())}\n" for said, file in found
            )
    for notebook in sorted((DOCS / "notebooks").glob("*.ipynb")):
        heading = "##"
        for cell in json.loads(notebook.read_text("utf-8"))["cells"]:
            for output in cell.get("outputs", ()):
                if png := output.get("data", {}).get("image/png"):
                    data = f"data:image/png;base64,{png.strip()}"
                    yield f'<img alt="{heading}" src="{data}">\n\n{heading}\n'
            source = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                first, *_ = source.splitlines()
                if first.startswith("# "):
                    yield f"\n## [{first.strip('# ')}](../notebooks/{notebook.name})\n"
                heading = first.strip("# ")


# ------------------------------------------------------------------ docstrings


def declared(app: Sphinx, what: str, name: str, one: Any, how: Any, lines: list[str]) -> None:
    """Add the fields of a record with their units, and lead to the pages that are named."""
    lines[:] = [re.sub(r"docs/([\w-]+)\.md", r":doc:`/\1`", line) for line in lines]
    if what == "module":  # a heading would be one of the page
        lines[:] = re.sub(r"^(\w+)\n-+$", r".. rubric:: \1\n", "\n".join(lines), flags=re.M).split(
            "\n"
        )
    columns = {}
    if one is Snapshot:
        columns = NUMBERS
    elif what == "class" and is_record(one):
        columns = {column.attribute: column for column in columns_of(one)}
    if columns:
        lines += ["", ".. list-table::", "   :header-rows: 1", ""]
        rows = [("attribute", "unit", "meaning")]
        rows += [(f"``{key}``", column.unit, column.meaning) for key, column in columns.items()]
        for field, unit, meaning in rows:
            lines += [f"   * - {field}", f"     - {unit}", f"     - {meaning}"]


def shortened(
    app: Sphinx, what: str, name: str, one: Any, how: Any, given: str | None, gives: str | None
) -> tuple[str, None] | None:
    """No parameters of a class that only functions make, unless nothing else names its fields."""
    if what != "class" or "Parameters\n---" in (text := inspect.getdoc(one) or ""):
        return None
    named = "Attributes\n---" in text or is_record(one)
    return None if not named and (is_dataclass(one) or hasattr(one, "_fields")) else ("", None)


def left_out(app: Sphinx, what: str, name: str, one: Any, skips: bool, how: Any) -> bool | None:
    """The fields of a named tuple, which are among its parameters."""
    return True if str(inspect.getdoc(one)).startswith("Alias for field number") else None


def find(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, text: nodes.Node
) -> nodes.Node | None:
    """The class or function of a name that a docstring gives without its module, or by another; or
    the name as it stands, if it is one of what the docstring describes.
    """
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    for name in (target, target.rpartition(".")[0]):  # or what a class has of that name
        found = {
            (one.docname, one.node_id): full
            for full, one in env.domaindata["py"]["objects"].items()
            if full.rpartition(".")[2] == (name.rpartition(".")[2] or name)
            and one.objtype in ("class", "function", "exception", "type")
        }
        if len(found) == 1:
            ((page, place), full), *_ = found.items()
            if name == target or target.rpartition(".")[2] in names_of(located(full)):
                return make_refnode(app.builder, node["refdoc"], page, place, text, full)
    return text if target in own_names(node) or inspect.ismodule(located(target)) else None


def own_names(node: nodes.Node) -> set[str]:
    """The parameters, fields and neighbours of the object whose docstring holds a node, and the
    fields of what it returns.
    """
    said = node
    while said and not isinstance(said, desc):
        said = said.parent
    full = f"{said[0]['module']}.{said[0]['fullname']}" if said else str(node.get("py:module"))
    one, holder = located(full), located(full.rpartition(".")[0])
    modules = inspect.getmodule(one), inspect.getmodule(holder)
    known = (one, holder, *modules, *named_classes(one, "return"))
    return {*it.chain.from_iterable(map(names_of, known))}


def located(full: str) -> Any:
    """The object of a full name; a module before a function of its name; or None."""
    module = full
    while module and module not in sys.modules:
        module = module.rpartition(".")[0]
    names = filter(None, full.removeprefix(module).split("."))
    return reduce(lambda one, name: getattr(one, name, None), names, sys.modules.get(module))


def names_of(one: Any) -> Iterator[str]:
    """The attributes, fields and parameters of an object."""
    yield from (*dir(one), *getattr(one, "__annotations__", ()))
    with suppress(TypeError, ValueError):
        yield from inspect.signature(one).parameters


def setup(app: Sphinx) -> None:
    app.connect("source-read", complete)
    app.connect("autodoc-process-docstring", declared, priority=600)  # after numpydoc
    app.connect("autodoc-process-signature", shortened)
    app.connect("autodoc-skip-member", left_out)
    app.connect("missing-reference", find)
