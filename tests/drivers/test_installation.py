"""A message that a package is missing gives the command for the installation that runs."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

import pytest

from drivers import installation

DECLARED = [
    "numpy>=2.0,<3",
    "PySide6-Essentials<1; python_version < '3'",
    "PySide6-Essentials>=6.7; python_version >= '3'",
    'nidaqmx[grpc]>=1.0; extra == "grpc"',
    "nidaqmx>=1.2",
    'pypylon>=26; extra == "basler"',
]
RECEIPT = """
[tool]
requirements = [
    { name = "pillow", extras = ["xmp"], specifier = ">=10" },
    { name = "slipscope", extras = ["basler"], {own} },
]
python = "C:/My Programs/python.exe"
"""


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty environment in which `slipscope` is declared and pip is not installed."""
    folder = tmp_path / "slipscope"
    folder.mkdir()
    monkeypatch.setattr(sys, "prefix", str(folder))
    monkeypatch.setattr(sys, "executable", "/somewhere/bin/python")
    monkeypatch.setattr(installation, "find_spec", lambda name: None)
    monkeypatch.setattr(metadata, "requires", lambda name: DECLARED)
    return folder


@pytest.mark.parametrize(
    ("package", "requirement"),
    [
        ("nidaqmx", "nidaqmx>=1.2"),
        ("nidaqmx[grpc]", "nidaqmx[grpc]>=1.0"),
        ("pypylon", "pypylon>=26"),
        ("PySide6-Essentials", "PySide6-Essentials>=6.7"),
        ("numpy", "numpy<3,>=2.0"),
        ("unheard-of", "unheard-of"),
    ],
)
def test_the_version_is_the_one_that_is_required(
    environment: Path, package: str, requirement: str
) -> None:
    assert installation.required(package) == requirement


def test_a_program_that_is_not_installed_names_the_package(
    environment: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", missing)
    assert installation.required("pypylon") == "pypylon"


@pytest.mark.parametrize(
    ("python", "word"),
    [("/somewhere/bin/python", "/somewhere/bin/python"), ("/a b/python", '"/a b/python"')],
)
def test_pip_where_there_is_one_and_uv_where_there_is_none(
    environment: Path, monkeypatch: pytest.MonkeyPatch, python: str, word: str
) -> None:
    monkeypatch.setattr(sys, "executable", python)
    for needed in (False, True):
        assert (
            installation.add("pypylon", needed=needed)
            == f'uv pip install "pypylon>=26" --python {word}'
        )
    monkeypatch.setattr(installation, "find_spec", lambda name: name == "pip")
    assert installation.add("pypylon") == f'{word} -m pip install "pypylon>=26"'


def test_a_tool_of_pipx(environment: Path) -> None:
    (environment / "pipx_metadata.json").write_text("{}")
    assert installation.add("pypylon") == 'pipx inject slipscope "pypylon>=26"'
    assert installation.add("numpy", needed=True) == "pipx reinstall slipscope"


@pytest.mark.parametrize(
    ("own", "source"),
    [
        ('path = "/wheels/s.whl"', '"/wheels/s.whl[basler]"'),
        ('directory = "/my sources"', '"/my sources[basler]"'),
        ('editable = "/sources"', '--editable "/sources[basler]"'),
        ('url = "https://example.org/s.whl"', '"slipscope[basler] @ https://example.org/s.whl"'),
        ('specifier = ">=0.1"', '"slipscope[basler]>=0.1"'),
    ],
)
def test_a_tool_of_uv_keeps_what_it_was_installed_with(
    environment: Path, own: str, source: str
) -> None:
    (environment / "uv-receipt.toml").write_text(RECEIPT.replace("{own}", own))
    assert installation.add("pypylon") == (
        f'uv tool install --python "C:/My Programs/python.exe" {source}'
        ' --with "pillow[xmp]>=10" --with "pypylon>=26"'
    )
    assert installation.add("numpy", needed=True) == "uv tool upgrade --reinstall slipscope"
