"""How Sphinx makes a site of the pages of docs/, without a network:

    python -m sphinx -W --keep-going docs docs/_build/html

The pages of docs/ are plain Markdown, as they are read in the repository; docs/index.md orders
them. The pages of docs/site/ exist on the site only: the API and the gallery, which are made here
of docstrings, declarations and pictures, and README.md and CHANGELOG.md.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.inspect import TypeAliasForwardRef
from sphinx.util.nodes import make_refnode

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS.parent))  # the program of this folder, not one that is installed

import analysis  # noqa: E402
from app.records import schema  # noqa: E402
from app.records.record_types import Snapshot  # noqa: E402
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
    """What each package of `analysis` exports, and the classes of what these functions return."""
    for package in ("dic", "inversion", "friction", "contact", "calibration", "mechanics"):
        yield f"\n## analysis.{package}\n"
        yield from rst(f".. automodule:: analysis.{package}")
        module = getattr(analysis, package)
        exported = [getattr(module, name) for name in module.__all__]
        for one in exported:
            if isinstance(one, ModuleType):
                yield f"\n### analysis.{package}.{one.__name__.rpartition('.')[2]}\n"
                yield from rst(f".. automodule:: {one.__name__}")
        functions = filter(inspect.isfunction, exported)
        kinds = {kind for function in functions for kind in returned(function)} - {*exported}
        for kind in sorted(kinds, key=lambda kind: kind.__name__):
            yield from rst(f".. autoclass:: {kind.__module__}.{kind.__name__}")


def returned(function: Any) -> Iterator[type]:
    """The classes of `analysis` in what a function says that it returns."""
    for name in re.findall(r"\w+", str(function.__annotations__.get("return"))):
        kind = getattr(inspect.getmodule(function), name, None)
        if inspect.isclass(kind) and kind.__module__.startswith("analysis."):
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
    elif what == "class" and one in schema._SCHEMAS:
        columns = {column.attribute: column for column in schema.columns_of(one)}
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
    named = "Attributes\n---" in text or one in schema._SCHEMAS
    return None if not named and (is_dataclass(one) or hasattr(one, "_fields")) else ("", None)


def left_out(app: Sphinx, what: str, name: str, one: Any, skips: bool, how: Any) -> bool | None:
    """The fields of a named tuple, which are among its parameters."""
    return True if str(inspect.getdoc(one)).startswith("Alias for field number") else None


def find(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, text: nodes.Node
) -> nodes.Node | None:
    """The class or function of a name that a docstring gives without its module, or by another."""
    if node.get("refdomain") != "py":
        return None
    name = node["reftarget"].rpartition(".")[2]
    found = {
        (one.docname, one.node_id): full
        for full, one in env.domaindata["py"]["objects"].items()
        if full.rpartition(".")[2] == name and one.objtype in ("class", "function", "exception")
    }
    if len(found) != 1:
        return None
    ((page, place), full), *_ = found.items()
    return make_refnode(app.builder, node["refdoc"], page, place, text, full)


def setup(app: Sphinx) -> None:
    app.connect("source-read", complete)
    app.connect("autodoc-process-docstring", declared, priority=600)  # after numpydoc
    app.connect("autodoc-process-signature", shortened)
    app.connect("autodoc-skip-member", left_out)
    app.connect("missing-reference", find)
