"""What wheel and sdist contain, by the rules of pyproject.toml: the data that the program reads,
and the manual, whose links lead somewhere where only the wheel is.
"""

from __future__ import annotations

import re
import tomllib
from fnmatch import fnmatch
from importlib import metadata
from pathlib import Path, PurePosixPath
from types import SimpleNamespace
from typing import Any

import pytest
from structure import PACKAGES, ROOT, sources

from app.system import manual

MADE = {"__pycache__"}
DECLARED: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SETUPTOOLS = DECLARED["tool"]["setuptools"]
SHIPPED = {  # file of the sources -> where a wheel puts it
    file.relative_to(ROOT).as_posix(): f"{folder}/{file.name}"
    for folder, patterns in SETUPTOOLS["data-files"].items()
    for pattern in patterns
    for file in ROOT.glob(pattern)
}
PAGES = [name for name in SHIPPED if name.endswith(".md")]


def test_every_file_of_a_package_is_in_the_wheel() -> None:
    data = SETUPTOOLS["package-data"]
    for package in PACKAGES:
        everywhere = [*data["*"], *data.get(package, [])]
        for file in (ROOT / package).rglob("*"):
            name = file.relative_to(ROOT / package).as_posix()
            if file.is_dir() or MADE & set(file.parts):
                continue
            if file.suffix == ".py":
                assert (file.parent / "__init__.py").exists(), f"{package}/{name} is in no package"
            else:
                assert any(fnmatch(name, one) or fnmatch(file.name, one) for one in everywhere), (
                    f"{package}/{name}: package-data names it not"
                )


@pytest.mark.parametrize("pattern", [p for ps in SETUPTOOLS["data-files"].values() for p in ps])
def test_each_pattern_of_the_manual_finds_a_file(pattern: str) -> None:
    assert list(ROOT.glob(pattern))


@pytest.mark.parametrize("page", PAGES)
def test_links_between_pages_lead_somewhere_in_the_wheel_too(page: str) -> None:
    folder = PurePosixPath(SHIPPED[page]).parent
    there = {str(PurePosixPath(place)) for place in SHIPPED.values()}
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:|#)([^)#\s]+)", text):
        parts: list[str] = []
        for part in (folder / target).parts:
            if part == "..":
                parts.pop()
            else:
                parts.append(part)
        assert "/".join(parts) in there, f"{page} leads to {target}, which no wheel has"


def test_the_program_names_no_file_that_a_wheel_lacks() -> None:
    for file in sources():
        for name in re.findall(r"\bdocs/[\w./-]*\w", file.read_text(encoding="utf-8")):
            assert name in SHIPPED, f"{file} names {name}"


def test_the_sdist_has_what_the_tests_read() -> None:
    rules = (ROOT / "MANIFEST.in").read_text(encoding="utf-8").splitlines()
    assert {f"graft {folder}" for folder in ("docs", "tests", "benchmarks")} <= set(rules)


def test_the_manual_is_found_beside_the_sources_and_where_a_wheel_puts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert manual.manual_folder() == ROOT / "docs"
    site = tmp_path / "lib/site-packages"
    held = [
        metadata.PackagePath("slipscope/__init__.py"),
        metadata.PackagePath("../..", SHIPPED[f"docs/{manual.FIRST_PAGE}"]),
    ]
    for file in held:
        file.dist = SimpleNamespace(locate_file=site.joinpath)
    site.mkdir(parents=True)
    monkeypatch.setattr(metadata, "files", lambda _: held)
    assert manual.manual_folder(tmp_path) == (tmp_path / manual.PAGES).resolve()
    monkeypatch.setattr(metadata, "files", lambda _: held[:1])
    assert manual.manual_folder(tmp_path) == tmp_path / "docs"


def test_the_citation_is_of_this_version_and_of_the_paper() -> None:
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", cited, re.MULTILINE) == [DECLARED["project"]["version"]]
    assert "Probing the micromechanics of a multi-contact interface" in " ".join(cited.split())
