"""Processes that do not begin as they should: why is told by name, and nobody waits for ever."""

import errno
import sys
from pathlib import Path
from unittest.mock import MagicMock, Mock

import pytest
from short_run import SMALL

from app.processes import client, folder as folders, starting
from app.processes.client import LaunchedPreview, LaunchedRun
from app.processes.starting import ProcessFailed, start_process, wait_until_ready
from app.settings import config
from drivers.errors import DeviceError

BEGIN = (
    "import os, sys, threading, time\nfrom app.processes.starting import report_ready, payload\n"
)


def launched_run(settings):
    return LaunchedRun(settings, Path("a.h5"), pace=1.0, overwrite=False)


@pytest.fixture
def said_by(tmp_path, monkeypatch):
    """What a process says whose `main` has these lines, and when it has ended."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def run(*lines, **limit):
        body = "\n".join(f"    {line}" for line in lines)
        name = f"begins_{len(list(tmp_path.iterdir()))}"
        (tmp_path / f"{name}.py").write_text(f"{BEGIN}def main():\n{body}\n", encoding="utf-8")
        log = tmp_path / "log"
        process = start_process(name, "a payload", log)
        try:
            return wait_until_ready(process, log, **limit)
        except ProcessFailed:
            assert process.poll() is not None  # nothing of it is left
            raise
        finally:
            process.kill()
            process.communicate()

    return run


@pytest.mark.slow
def test_what_others_print_does_not_reach_the_report(said_by, tmp_path):
    """A vendor's library may write to standard output while it is imported, also from C."""
    report = said_by(
        "print('licence found', flush=True)",
        "os.write(1, b'firmware 1.2')",
        "sys.stdout.write('more')",
        "report_ready(payload())",
    )
    assert report == "a payload"
    assert "licence found" in (tmp_path / "log").read_text(encoding="utf-8")


def test_a_process_that_fails_tells_why_and_where(said_by):
    with pytest.raises(ProcessFailed, match=r"KeyError: 'serial' \(begins_\d.py, line 4\)$"):
        said_by("raise KeyError('serial')")


def test_a_process_that_fails_ends_whatever_threads_it_has(said_by):
    with pytest.raises(ProcessFailed, match="code 1 before it was ready: ValueError: 3"):
        said_by("threading.Thread(target=time.sleep, args=(600,)).start()", "raise ValueError(3)")


def test_a_process_that_the_system_does_not_start_is_told_by_name(said_by, monkeypatch):
    refused = Mock(side_effect=OSError(errno.EAGAIN, "Resource temporarily unavailable"))
    monkeypatch.setattr(starting.subprocess, "Popen", refused)
    with pytest.raises(ProcessFailed, match=r"^begins_\d: .* cannot be started: Resource temp"):
        said_by("pass")


def test_a_process_that_has_a_folder_goes_by_its_own_name(tmp_path):
    process = start_process("app.processes.none", None, folder=tmp_path)
    with pytest.raises(ProcessFailed, match=r"^none: its process ended with code 1"):
        wait_until_ready(process)
    process.communicate()


def test_a_process_that_hangs_is_ended(said_by):
    with pytest.raises(ProcessFailed, match=r"begins_\d: its process was not ready within 2 s and"):
        said_by("time.sleep(600)", within_s=2.0)


def test_an_error_of_a_kind_that_nobody_else_knows_arrives_as_one_of_a_device(said_by):
    with pytest.raises(DeviceError, match="the oven is at 40 degrees") as raised:
        said_by(
            "from drivers.errors import DeviceError",
            "class Hot(DeviceError):",
            "    def __init__(self, what, degrees):",
            "        super().__init__(f'the {what} is at {degrees} degrees')",
            "report_ready(Hot('oven', 40))",
        )
    assert type(raised.value) is DeviceError


@pytest.mark.parametrize("launch", [LaunchedPreview, launched_run], ids=["preview", "run"])
def test_a_bench_that_nobody_waits_for_any_more_is_ended(launch, memory, monkeypatch):
    process = MagicMock()
    monkeypatch.setattr(client, "start_process", Mock(return_value=process))
    monkeypatch.setattr(client, "wait_until_ready", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        launch(config.load(None, SMALL))
    process.terminate.assert_called_once_with()
    assert not list(folders.root().iterdir())


DRIVER = """
print("a licence was found", flush=True)

class Stage:
    def __init__(self, *given, **named):
        {}["serial"]

    def open(self):
        pass

    close = open
"""


def run(settings, path):
    LaunchedRun(settings, path, pace=1.0, overwrite=False)


def preview(settings, _):
    LaunchedPreview(settings)


@pytest.mark.slow
@pytest.mark.parametrize("launch", [run, preview])
def test_a_driver_that_can_not_be_made_is_told_with_its_line(launch, tmp_path, memory, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "broken_stage.py").write_text(DRIVER, encoding="utf-8")
    settings = config.load(None, [*SMALL, "actuator.source=broken_stage:Stage"])
    with pytest.raises(DeviceError, match=r"KeyError: 'serial' \(broken_stage.py, line 6\)"):
        launch(settings, tmp_path / "a.h5")
    assert not list(folders.root().iterdir())
    sys.modules.pop("broken_stage", None)
