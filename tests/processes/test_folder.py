"""The folders of benches: what a dead one has left stays as long as somebody may ask for it."""

import errno
import io
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import psutil
import pytest
from processes.launched import wait_until

from app.processes import calls, folder as folders, launch, serving
from app.processes.bench import ServedRun, known, methods_of
from app.processes.calls import Server
from app.processes.folder import (
    ANSWER,
    KEPT_S,
    LONGEST,
    RunningBench,
    claim,
    new_folder,
    publish,
    read_stop_answer,
    running,
    shared_image,
    write_stop_answer,
)
from app.processes.serving import KnownBench
from app.records.run_view import RunView
from app.system.errors import UserError
from app.system.stopping import sent_from_outside


@pytest.fixture
def dead(memory):
    """Makes the folder of a bench that has died, with the number of its supervisor."""

    def make(supervisor):
        ended = subprocess.Popen([sys.executable, "-c", ""])
        ended.wait()
        folder = new_folder()
        bench = RunningBench(folder.name, "a", "a.h5", "", "", ended.pid, 1.0, 0, supervisor)
        publish(folder, bench)
        return folder

    return make


def test_a_bench_that_has_died_does_not_run(dead):
    folder = dead(0)
    died = replace(folders._read(folder), address="calls")
    publish(folder, died)
    assert running() == []
    again = replace(died, pid=os.getpid(), born=claim(folder).born)
    publish(folder, again)
    assert running() == [again]
    publish(folder, replace(again, born=again.born - 1))
    assert running() == []  # another process of that number


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system holds the time of birth")
@pytest.mark.parametrize("set_s", [-7200.0, 1.0])
def test_a_bench_is_found_however_the_clock_was_set_since_it_began(memory, monkeypatch, set_s):
    """Linux counts from the start of the computer, whose time of day moves with the clock."""
    folder = new_folder()
    bench = replace(claim(folder), address="calls", session="a.h5")
    publish(folder, bench)
    before = psutil.boot_time()
    monkeypatch.setattr(psutil._psplatform, "boot_time", lambda: before + set_s)
    assert running() == [bench]


def age(folder, seconds):
    then = time.time() - seconds
    os.utime(folder, (then, then))


def test_a_supervisor_that_is_still_there_can_answer_however_many_runs_begin(dead):
    folder = dead(os.getpid())
    age(folder, 10 * KEPT_S)  # the bench ran for long
    new_folder()
    write_stop_answer(folder / ANSWER, sent_from_outside())
    new_folder()
    assert read_stop_answer(folder.name) == sent_from_outside()


def test_an_answer_stays_for_those_who_ask_for_it_and_not_for_ever(dead):
    folder = dead(0)
    write_stop_answer(folder / ANSWER, sent_from_outside())
    new_folder()
    assert read_stop_answer(folder.name) == sent_from_outside()
    age(folder, KEPT_S + 1)
    new_folder()
    assert not folder.exists()


posix = pytest.mark.skipif(sys.platform == "win32", reason="folders of Windows have no mode")


@posix
@pytest.mark.parametrize("mode", [0o777, 0o755, 0o750])
def test_a_folder_that_others_reach_is_refused(tmp_path, monkeypatch, mode):
    """A bench in it could be anybody's, and what it answers is unpickled."""
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    ours = tmp_path / f"slipscope-{os.getuid()}"
    ours.mkdir()
    ours.chmod(mode)
    for look in (running, new_folder, lambda: launch.attached(None)):
        with pytest.raises(UserError, match=rf"slipscope-.*mode is {mode:o}.*remove it"):
            look()
    assert read_stop_answer("a bench") is None
    assert not list(ours.iterdir())


@posix
def test_a_folder_of_another_user_is_refused(memory, monkeypatch):
    ours = new_folder().parent
    user = os.getuid() + 1
    monkeypatch.setattr(folders.os, "getuid", lambda: user)
    ours.rename(memory / f"slipscope-{user}")
    with pytest.raises(UserError, match="it belongs to another user"):
        running()


@posix
def test_a_link_to_a_folder_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / f"slipscope-{os.getuid()}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UserError, match="is no folder"):
        new_folder()


def claimed_by(folder):
    """A process that uses a folder, as a preview or a bench that is not published yet."""
    code = (
        "import sys; from pathlib import Path; from app.processes.folder import claim;"
        "claim(Path(sys.argv[1])); print(flush=True); sys.stdin.read()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout.readline()
    return process


def test_what_a_killed_preview_has_left_goes_a_while_after_it_was_found_dead(dead):
    folder = new_folder()
    with claimed_by(folder) as preview:
        age(folder, 10 * KEPT_S)  # it is connected for long
        new_folder()
        assert folder.exists()
        preview.kill()
    new_folder()
    assert folder.exists()  # its supervisor may still answer
    new_folder()
    assert folder.exists()
    age(folder, KEPT_S + 1)
    new_folder()
    assert not folder.exists()


@posix
def test_the_folder_of_a_bench_in_a_container_stays_as_long_as_it_listens(dead):
    """It shares the memory and the number of the user, and is not among our processes."""
    folder = dead(0)
    publish(folder, replace(folders._read(folder), address=str(folder / "calls")))
    server = Server(folder, b"key", dict)
    for _ in range(2):
        age(folder, 10 * KEPT_S)
        new_folder()
        assert folder.exists()
    assert running() == []
    server.close()
    wait_until(lambda: not folders.is_open(server.address), "its end")
    new_folder()
    age(folder, KEPT_S + 1)
    new_folder()
    assert not folder.exists()


@posix
def test_a_bench_that_takes_no_further_call_is_there(short_path):
    address = str(short_path / "calls")
    assert not folders.is_open(address)
    with ExitStack() as held:
        listener = held.enter_context(socket.socket(socket.AF_UNIX))
        listener.bind(address)
        listener.listen(0)
        for _ in range(9):
            caller = held.enter_context(socket.socket(socket.AF_UNIX))
            caller.setblocking(False)
            with suppress(BlockingIOError):
                caller.connect(address)
        assert folders.is_open(address)


def test_two_benches_that_begin_in_one_second_have_folders_of_their_own(memory, monkeypatch):
    monkeypatch.setattr(folders, "datetime", Mock(now=lambda: datetime(2026, 1, 1)))
    drawn = iter(["abcd", "abcd", "ef01"])
    monkeypatch.setattr(folders.secrets, "token_hex", lambda _: next(drawn))
    assert [new_folder().name for _ in range(2)] == ["000000-abcd", "000000-ef01"]


@pytest.mark.parametrize("denied", ["memory", "both"])
def test_where_no_folder_can_be_made_it_is_said_what_to_do(tmp_path, monkeypatch, denied):
    monkeypatch.setattr(folders, "MEMORY", memory := tmp_path / "memory")
    (memory if denied == "memory" else tmp_path / "temporary").touch()  # which is no folder
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    run = Mock(title="a", output=tmp_path / "a.h5")
    for make in (new_folder, running, lambda: known(run).__enter__()):
        with pytest.raises(UserError, match=r"cannot be written: .*; make room there, or .*TMPDIR"):
            make()


@posix
def test_a_folder_of_a_long_name_is_refused_and_one_that_is_just_short_enough_is_not(
    short_path, monkeypatch
):
    rest = LONGEST - len(f"{short_path}/") - len(f"/slipscope-{os.getuid()}")
    for more in (1, 0):
        monkeypatch.setattr(folders, "MEMORY", longest := short_path / ("x" * (rest + more)))
        longest.mkdir()
        if more:
            with pytest.raises(UserError, match=r"name is too long for .* TMPDIR"):
                folders.root()
    with known(Mock(title="a", output=short_path / "a.h5")):
        assert [bench.title for bench in running()] == ["a"]


def test_a_bench_that_cannot_be_called_leaves_no_folder(tmp_path, memory, monkeypatch):
    full = OSError(errno.EMFILE, "Too many open files")
    monkeypatch.setattr(calls, "Listener", Mock(side_effect=full))
    with (
        pytest.raises(UserError, match="Too many open files; make room"),
        known(Mock(title="a", output=tmp_path / "a.h5")),
    ):
        pytest.fail("it has begun")
    assert not list(folders.root().iterdir())


@pytest.mark.parametrize("ends", ["at its end", "while a window looks on"])
def test_an_interrupted_run_of_a_script_is_known_no_more(tmp_path, memory, monkeypatch, ends):
    threads = threading.active_count()
    if ends == "while a window looks on":
        monkeypatch.setattr(KnownBench, "is_called", property(Mock(side_effect=KeyboardInterrupt)))

    def run():
        with known(Mock(title="a", output=tmp_path / "a.h5")):
            assert [bench.title for bench in running()] == ["a"]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert running() == list(folders.root().iterdir()) == []
    wait_until(lambda: threading.active_count() <= threads, "the end of its threads")


def test_a_run_of_a_script_is_begun_by_it_alone():
    """A window that is attached while its thread prepares it would begin it a second time."""
    begun = {"start"}
    served = SimpleNamespace(run=Mock(), folder=Path(), _numbers=count())
    methods = ServedRun.methods(served)
    assert methods.keys() - methods_of(served.run, served.folder, 0).keys() == begun


def test_the_images_of_a_caller_go_with_its_connection(tmp_path):
    share = folders.image_publisher(tmp_path, "image-3")
    for value in (1, 2, 3):
        name = share(np.full((4, 5), value, np.uint8))
        assert (tmp_path / name).read_bytes() == bytes([value]) * 20
    assert len([*tmp_path.iterdir()]) == 2
    del share
    assert [*tmp_path.iterdir()] == []


def lose_all(folder):
    shutil.rmtree(folder.parent)


def lose_the_files(folder):
    for path in folder.iterdir():
        path.unlink()


def lose_the_record(folder):
    (folder / folders.FILE).unlink()


def known_bench(**supervised):
    """A bench that others know and may call."""
    bench = KnownBench(new_folder())
    bench.publish(title="a", session="a.h5", **supervised)
    bench.answer_calls(dict)
    return bench


@pytest.mark.parametrize("lose", [lose_all, lose_the_files, lose_the_record])
def test_a_bench_is_known_again_although_that_fails_at_first(memory, monkeypatch, caplog, lose):
    bench = known_bench()
    lose(bench.folder)
    listens = (serving, "publish") if lose is lose_the_record else (calls, "Listener")
    for place, name in (listens, (serving, "publish")):
        with monkeypatch.context() as denied:
            full = OSError(errno.EMFILE, "Too many open files")
            denied.setattr(place, name, Mock(side_effect=full))
            for _ in range(2):
                bench.stay_known()
            assert running() == []
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(told) == 1
    assert "cannot be made again yet ([Errno 24] Too many open files)" in told[0]
    bench.stay_known()
    assert running() == [bench.bench]
    assert folders.is_open(bench.bench.address) == hasattr(socket, "AF_UNIX")
    bench.forget()


def test_a_bench_that_ran_for_long_and_dies_with_its_supervisor_has_just_died(memory, monkeypatch):
    bench = known_bench(supervisor_pid=2**22 + 1)
    age(bench.folder / folders.FILE, 10 * KEPT_S)
    bench.stay_known()
    bench._server.close()
    monkeypatch.setattr(RunningBench, "is_alive", False)
    assert folders.died() == [bench.bench]
    age(bench.folder / folders.FILE, KEPT_S + 1)
    assert folders.died() == []


def test_a_bench_of_windows_is_known_again_at_the_pipe_that_it_has(memory, monkeypatch):
    """A pipe is no file of the folder, and can be neither removed nor made twice."""
    bench = known_bench()
    lose_the_record(bench.folder)
    with monkeypatch.context() as windows:
        windows.setattr(serving, "sys", Mock(platform="win32"))
        windows.setattr(serving, "is_open", Mock(return_value=False))
        windows.setattr(calls, "Listener", Mock(side_effect=PermissionError("Access is denied")))
        bench.stay_known()
    assert running() == [bench.bench]
    bench.forget()


@pytest.mark.skipif(sys.platform == "win32", reason="files that are open on Windows")
def test_what_a_driver_prints_does_not_fill_the_memory(tmp_path):
    """It lies beside the images that processes share, and the run may take hours."""
    log, sizes = tmp_path / "bench.log", []
    with log.open("ab", buffering=0) as printed:

        def is_alive():
            sizes.append(log.stat().st_size)
            printed.write(bytes(300_000))
            if len(sizes) == 8:
                served.has_ended.set()

        served = SimpleNamespace(
            folder=tmp_path,
            has_ended=threading.Event(),
            stay_known=is_alive,
            is_called=True,
        )
        serving._attend(served)
    assert sizes == [0, 300_000, 600_000, 900_000, 0, 300_000, 600_000, 900_000]


def test_what_a_launch_that_was_killed_has_left_goes(dead):
    folder = new_folder()
    new_folder()
    assert folder.exists()
    age(folder, KEPT_S + 1)
    new_folder()
    assert not folder.exists()


def test_a_file_that_lies_there_does_no_harm(dead):
    stray = new_folder().with_name("stray")
    stray.touch()
    age(stray, 2 * KEPT_S)
    new_folder()
    assert running() == []


def test_a_process_claims_its_folder_once(dead):
    folder = new_folder()
    claim(folder)
    age(folder, 10 * KEPT_S)
    new_folder()
    assert folder.exists()


@pytest.fixture
def full_disk(monkeypatch):
    """A disk that has no room for an image."""

    class Full(io.BytesIO):
        def write(self, content):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(folders.Path, "open", lambda path, mode: path.touch() or Full())


def test_no_room_for_a_shared_image_is_said_before_a_mapped_page_ends_the_process(
    tmp_path, full_disk
):
    path = tmp_path / "benches" / "one" / "image"
    path.parent.mkdir(parents=True)
    with pytest.raises(UserError, match=r"no room for an image of 3\.8 MB .* in .+, which in a"):
        shared_image(path, (1200, 1600), np.dtype(np.uint16))
    assert not path.exists()


def test_no_room_for_the_record_of_a_bench_is_said(tmp_path, monkeypatch):
    full = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr(folders.Path, "write_text", full)
    with pytest.raises(UserError, match="a bench share cannot be written: No space left"):
        claim(tmp_path)


def test_a_run_goes_on_although_nobody_can_see_its_images(tmp_path, full_disk):
    image = np.zeros((4, 6), np.uint8)
    run = Mock()
    run.look.return_value = RunView("health", None, None, contact="contact", image=image)
    served = SimpleNamespace(run=run, folder=tmp_path, _numbers=count())
    look = ServedRun.methods(served)["look"]
    for shared in ({"contact": "contact"}, {}):
        view, new = look(0, True)
        assert (view.health, view.image, new) == ("health", None, shared)
