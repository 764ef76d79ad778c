"""Ctrl-C and the signal to end: each command that computes is over soon, says one sentence and
leaves what was there before it, whatever it is at.
"""

import json
import resource
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0
MOST_CPU_S = 2.0

STUCK = """
import os
import time
from pathlib import Path

place = Path.replace

def stuck(self, target):
    # all was written, and a function of a library hears no Ctrl-C
    if ".part" not in str(self) or ".parts" in str(self):
        return place(self, target)
    said = 0
    while True:
        try:
            said = said or os.write(1, b"at work\\n")
            time.sleep(60)
        except KeyboardInterrupt:
            pass

Path.replace = stuck
from app.cli import main
main()
"""


@pytest.fixture
def images(sessions, tmp_path):
    from app.files.exporting import export

    export(sessions[0], tmp_path / "images", "images", frames="0:40")
    return tmp_path / "images"


def begun(words, code=("-m", "app")):
    return subprocess.Popen(
        [sys.executable, *code, *map(str, words)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def ended(process, number):
    """What it says after a signal, its exit code, the seconds of processor time until its end, and
    which of its processes are left.
    """
    program = psutil.Process(process.pid)
    family = [program, *program.children(recursive=True)]

    def spent():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    before = spent() + sum(sum(one.cpu_times()[:2]) for one in family)
    process.send_signal(number)
    try:
        out, said = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    _, left = psutil.wait_procs(family, timeout=10.0)
    return out, said, process.returncode, spent() - before, left


def words_of(command, folder, sessions, once, images):
    """A command, and the file or folder that it replaces."""
    image, field = sorted(images.glob("*.tif*")), folder / "field.csv"
    field.write_text("x_um,y_um,ux_um\n" + "".join(f"{x},0,{x / 100}\n" for x in range(0, 90, 9)))
    return {
        "analyze": ([*sessions, "--jobs", 1], "out.h5"),
        "dic": ([image[0], image[1]], "out.csv"),
        "export": ([sessions[0], "--what", "rings"], "out.csv"),
        "film": ([sessions[0], "--what", "ux"], "out.gif"),
        "figures": ([once, "--only", 5], "out"),
        "import": ([images], "out.h5"),
        "model": ([], "out.csv"),
    }[command]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "command", ["analyze", "dic", "export", "film", "figures", "import", "model"]
)
def test_an_interrupted_command_ends_soon_and_leaves_what_was_there(
    command, number, sessions, once, images, tmp_path
):
    words, name = words_of(command, tmp_path, sessions, once, images)
    target = tmp_path / name
    if is_folder := not target.suffix:
        target.mkdir()
    (target / "fig05.png" if is_folder else target).write_text("earlier")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    command = "export" if command == "film" else command
    process = begun([command, *words, "-o", target, "--overwrite"], ("-c", STUCK))
    assert process.stdout.readline() == "at work\n", process.communicate()
    out, said, code, cpu_s, left = ended(process, number)
    assert (code, out, left) == (1, "", [])
    (sentence,) = [line for line in said.splitlines() if "%" not in line and "note:" not in line]
    reason = "Ctrl-C" if number == signal.SIGINT else "the signal to end"
    assert sentence.startswith(f"slipscope: {reason}: left before the end; ")
    assert cpu_s < MOST_CPU_S
    files = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    kept = {path: data for path, data in files.items() if ".parts" not in str(path)}
    assert kept == before


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("jobs", [1, 2])
def test_an_analysis_in_the_midst_of_its_work_ends_with_all_its_processes(jobs, sessions, tmp_path):
    target = tmp_path / "out.h5"
    process = begun(["analyze", *sessions, "-o", target, "--jobs", jobs, "--json"])
    program = psutil.Process(process.pid)
    while sum(program.cpu_times()[:2]) < 2.5 and len(program.children()) < jobs:
        assert process.poll() is None
    out, said, code, cpu_s, left = ended(process, signal.SIGTERM)
    assert (code, said.splitlines(), left) == (1, said.splitlines()[:1], [])
    assert "the signal to end" in (said or json.loads(out)["error"])
    assert cpu_s < MOST_CPU_S
    assert not target.exists()
