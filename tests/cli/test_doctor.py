"""`slipscope doctor` says what is missing on this computer, and how to install it."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib import import_module, metadata
from typing import Any

import pytest
from typer.testing import Result

from app.bench_checks import doctor

Command = Callable[..., Result]


def test_doctor_names_every_package_and_the_sources_of_devices(slipscope: Command) -> None:
    data = json.loads(slipscope("doctor", "--json").stdout)
    found = {item["name"]: item["found"] for item in data["program"]}
    assert found["h5py"] == metadata.version("h5py")
    assert {item["name"]: item["found"] for item in data["sources of devices"]}[
        "camera"
    ].startswith("sim, pylon")
    assert {"cores", "memory", "disk", "display", "compiled code"} <= {
        item["name"] for item in data["computer"]
    }


def test_doctor_fails_where_a_package_is_missing_and_says_how_to_get_it(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        metadata,
        "requires",
        lambda _: ["numpy>=2", "no-such-package-here>=1", 'extra-one>=3; extra == "ni"'],
    )
    monkeypatch.setattr(metadata, "version", _version_of(metadata.version))
    result = slipscope("doctor")
    assert result.exit_code == 1
    # the path of this Python, before or behind it, decides where a line ends
    assert 'pip install "no-such-package-here>=1"' in " ".join(result.stdout.split())
    assert "extra-one" not in result.stdout


def test_doctor_does_not_fail_where_only_the_window_is_missing(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def version(name: str) -> str:
        if name == "pyqtgraph":
            raise metadata.PackageNotFoundError(name)
        return "9.9"

    monkeypatch.setattr(metadata, "requires", lambda _: ["h5py>=3", "pyqtgraph>=0.13"])
    monkeypatch.setattr(metadata, "version", version)
    result = slipscope("doctor", "--json")
    assert result.exit_code == 0
    found = {item["name"]: item for item in json.loads(result.stdout)["program"]}
    assert found["pyqtgraph"]["found"] == "missing, needed only for the window"
    assert 'pip install "pyqtgraph>=0.13"' in found["pyqtgraph"]["advice"]


def test_doctor_fails_where_a_package_is_too_old_and_says_how_to_get_a_newer_one(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = ["h5py>=999", "msgspec<1; python_version < '3'", "psutil>=1"]
    monkeypatch.setattr(metadata, "requires", lambda _: declared)
    result = slipscope("doctor", "--json")
    assert result.exit_code == 1
    found = {item["name"]: item for item in json.loads(result.stdout)["program"]}
    assert found["h5py"]["found"] == f"{metadata.version('h5py')}, which is not >=999"
    assert 'pip install "h5py>=999"' in found["h5py"]["advice"]
    assert found["psutil"]["is_fine"]
    assert "msgspec" not in found


def test_doctor_fails_where_a_part_of_the_program_can_not_be_imported(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def imported(name: str) -> Any:
        if name == "app.records.record_types":
            raise IndexError("tuple index out of range")
        return import_module(name)

    monkeypatch.setattr(doctor, "import_module", imported)
    result = slipscope("doctor")
    assert result.exit_code == 1
    words = " ".join(result.stdout.split())
    assert (
        "app.records.record_types cannot be imported: IndexError: tuple index out of range" in words
    )


def _version_of(known: Callable[[str], str]) -> Callable[[str], str]:
    return lambda name: "0.1.0" if name == "slipscope" else known(name)
