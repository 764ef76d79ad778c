"""A file from a stranger can kill, stop or fill nothing but the small process that reads it first;
one that this computer closed is not read twice.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import h5py
import psutil
import pytest
from python_program import python
from session_material import Session

from app.session import analyses, contents, trust, vetting
from app.session.reader import SessionReader
from app.system.disk import AppendedFile
from app.system.errors import UserError

POSIX = pytest.mark.skipif(not hasattr(os, "fork"), reason="forks for each file")
# what HDF5 might do with a file, by the name of the file
HARM = """
import os, socket, time
from app.session import contents, vetting
asked = contents.contents_of
def harm(path):
    match path.stem:
        case "crash": os.abort()
        case "endless": time.sleep(600)
        case "greedy": return bytearray(3 << 30)
        case "large": b"x" * (1 << 28)
        case "babble": return [1, 2]
        case "raise": raise RuntimeError("odd {0}")
        case "write": path.with_name("written").write_bytes(b"1")
        case "network": raise contents.Refused(" ".join(n for _, n in socket.if_nameindex()), "")
    return asked(path)
vetting.contents_of = harm
vetting._leave_the_network()
vetting._serve() if len(vetting.sys.argv) == 1 else vetting.sys.stdout.buffer.write(
    vetting._answer(vetting.sys.argv[1]))
"""


@pytest.fixture
def harmful(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """HDF5 does harm."""
    started = subprocess.Popen

    def instead(command: list[str], **how: object) -> subprocess.Popen[bytes]:
        return started([sys.executable, "-c", HARM, *command[4:]], **how)  # type: ignore[call-overload]

    monkeypatch.setattr(vetting, "_idle", [])
    monkeypatch.setattr(vetting, "_seen", {})
    monkeypatch.setattr(vetting, "LEAST_S", 60.0)  # more than any busy computer takes
    monkeypatch.setattr(vetting.subprocess, "Popen", instead)
    yield
    vetting._end_all()


def named(session: Session, name: str) -> Path:
    return session.path.rename(session.path.with_name(f"{name}.h5"))


@POSIX
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("crash", "HDF5 dies of it \\(SIGABRT\\); use a copy"),
        ("endless", "HDF5 does not come to an end with it in 2 s; use a copy"),
        ("greedy", "HDF5 takes more than 1024 MiB for it; use a copy"),
        ("babble", "HDF5 fails at it; use a copy"),
        ("raise", "the session is damaged: odd \\{0}; use a copy"),
    ],
)
@pytest.mark.usefixtures("harmful")
def test_harm_is_one_sentence_and_the_next_file_is_read(
    session: Session, monkeypatch: pytest.MonkeyPatch, name: str, sentence: str
) -> None:
    path = named(session, name)
    with monkeypatch.context() as patience:
        if name == "endless":
            patience.setattr(vetting, "LEAST_S", 2.0)
        with pytest.raises(
            UserError, match=f"^{re.escape(str(path))}: .*{sentence} of it if there is one$"
        ):
            SessionReader(path)
    with SessionReader(path.rename(path.with_name("large.h5"))) as reader:
        assert len(reader.triggers()) == 8
    assert len(vetting._idle) == 1


@pytest.mark.skipif(sys.platform != "linux", reason="no limits of this kind elsewhere")
@pytest.mark.usefixtures("harmful")
def test_it_can_not_write_and_is_not_on_the_network(session: Session) -> None:
    path = named(session, "write")
    with pytest.raises(UserError, match="File too large"):
        SessionReader(path)
    path = path.rename(path.with_name("network.h5"))
    with pytest.raises(UserError) as refused:
        SessionReader(path)
    alone = subprocess.run(["unshare", "-rn", "true"], check=False).returncode == 0
    assert not alone or str(refused.value).startswith(f"{path}: lo;")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("crash", "dies of it"),
        ("endless", "does not come to an end with it in 2 s"),
        ("greedy", "takes more than 1024 MiB"),
        ("raise", "odd"),
        ("session", ""),
    ],
)
@pytest.mark.usefixtures("harmful")
def test_without_fork_each_file_has_a_process(
    session: Session, name: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "fork", raising=False)
    if name == "endless":
        monkeypatch.setattr(vetting, "LEAST_S", 2.0)
    path = named(session, name)
    if name == "session":
        SessionReader(path).close()
    else:
        with pytest.raises(UserError, match=sentence):
            SessionReader(path)
    assert not vetting._idle


@POSIX
class _Emptied(dict[str, object]):
    """What is remembered while other threads look at many files: it is gone at once."""

    def __setitem__(self, key: str, value: object) -> None:
        super().__setitem__(key, value)
        self.clear()


def test_what_another_thread_has_pushed_out_is_given_all_the_same(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(vetting, "_seen", _Emptied())
    with SessionReader(session.path) as read:
        assert len(list(read.frames())) == len(session.images)


@pytest.mark.slow
def test_a_process_that_was_killed_is_replaced(session: Session) -> None:
    SessionReader(session.path).close()
    os.utime(session.path)
    if vetting._idle:
        vetting._idle[-1].send_signal(signal.SIGKILL)
        vetting._idle[-1].wait()
    SessionReader(session.path).close()


def test_a_file_that_is_nothing_but_holes_is_refused(session: Session) -> None:
    os.truncate(session.path, 1 << 40)
    with pytest.raises(
        UserError, match=r"claims 1099511627776 bytes but takes .* the rest is hole"
    ):
        SessionReader(session.path)


def test_only_what_this_computer_closed_is_read_at_once(
    session: Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SLIPSCOPE_HOME", str(tmp_path / "home"))
    asked: list[Path] = []
    monkeypatch.setattr(vetting, "_of_stranger", lambda path: asked.append(path) or _read(path))
    monkeypatch.setattr(vetting, "_seen", {})
    SessionReader(session.path).close()
    SessionReader(session.path).close()  # the second time in one process it is known
    assert asked == [session.path]
    trust.remember(session.path, "0123abcd")
    vetting._seen.clear()
    SessionReader(session.path).close()
    assert (asked, trust.checksum_of(session.path)) == ([session.path], "0123abcd")
    os.utime(session.path)  # the same bytes, but somebody touched them
    assert not trust.is_known(session.path)
    SessionReader(session.path).close()
    assert asked == [session.path] * 2


def test_a_file_system_without_locks_is_read_and_one_that_another_program_writes_is_not(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor is a superblock that HDF5 does not know a lock."""
    made = h5py.File

    def lockless(path: Path, mode: str, locking: bool = True) -> h5py.File:
        if locking:
            raise OSError("Unable to open file (unable to lock file, errno = 37)")
        return made(path, mode, locking=False)

    with monkeypatch.context() as share:
        share.setattr(h5py, "File", lockless)
        assert _read(session.path).datasets
        path = session.path.with_name("a")
        with (
            closing(AppendedFile(path, overwrite=False, locked=True)),
            pytest.raises(contents.Refused, match="another program is writing to it"),
        ):
            _read(path)
    with session.path.open("r+b") as file:
        file.seek(8)
        file.write(b"\x09")
    with pytest.raises(contents.Refused, match="superblock"):
        _read(session.path)


def _read(path: Path) -> contents.Contents:
    return contents.contents_of(path)


def test_the_oldest_are_forgotten_and_a_folder_that_can_not_be_is_none(
    session: Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("SLIPSCOPE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(trust, "MOST_KNOWN", 3)
    for n in range(5):
        os.utime(session.path, ns=(n, n))
        trust.remember(session.path, str(n))
        known = tmp_path / "home/sessions" / trust.identity_of(session.path)
        os.utime(known, ns=(n, n))
    assert len(list((tmp_path / "home/sessions").iterdir())) == 3
    assert trust.checksum_of(session.path) == "4"
    (tmp_path / "file").write_text("x")
    monkeypatch.setenv("SLIPSCOPE_HOME", str(tmp_path / "file"))
    trust.remember(session.path, "5")
    assert not trust.is_known(session.path)


@POSIX
def test_nothing_is_left_running_when_the_program_ends(session: Session) -> None:
    code = (
        "import sys, pathlib; from app.session.reader import SessionReader\n"
        "from app.session import vetting\n"
        "SessionReader(pathlib.Path(sys.argv[1])).close(); print(vetting._idle[0].pid)"
    )
    done = python("-c", code, session.path)
    assert done.returncode == 0
    assert not psutil.pid_exists(int(done.stdout))
    assert not done.stderr


@POSIX
@pytest.mark.usefixtures("harmful")
def test_what_lies_beside_the_session_that_is_asked_about_does_no_harm(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    SessionReader(session.path).close()  # it is known from now on, however busy the computer is
    monkeypatch.setattr(vetting, "LEAST_S", 2.0)
    for name in ("crash", "endless", "greedy", "raise"):
        shutil.copy(session.path, session.path.with_name(f"{name}.h5"))
    assert analyses.analyses_of(session.path) == []


def test_what_follows_files_that_took_too_long_is_left_out(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files that can be read take what they take."""
    asked: list[str] = []
    now = 0.0

    def read(path: Path) -> SessionReader:
        nonlocal now
        asked.append(path.name)
        now += 2.0
        if path.name.startswith("bad"):
            raise UserError("HDF5 does not come to an end with it")
        return SessionReader(path)

    folder = session.path.parent
    session.path.rename(folder / "a.h5")
    for name in ("bad-1", "bad-2", "bad-3", "good"):
        shutil.copy(folder / "a.h5", folder / f"{name}.h5")
    monkeypatch.setattr(analyses, "SessionReader", read)
    monkeypatch.setattr(analyses, "time", SimpleNamespace(monotonic=lambda: now))
    assert analyses.analyses_of(folder / "a.h5") == []
    assert asked == ["a.h5", "a.h5", "bad-1.h5", "bad-2.h5"]
