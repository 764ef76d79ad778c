"""A session from somebody else is data: whatever is done to it, it is read or refused with a
sentence, at once and in little memory.
"""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from changed_files import attribute, changing, linked, put, replaced
from python_program import python
from session_material import Session, make_writer
from spoiled import ask, lookup3

from app.records.record_types import Event
from app.session.contents import LARGEST_TEXTS
from app.session.field_series import is_session, read_fields_file
from app.session.layout import FORMAT_ATTRIBUTE
from app.session.reader import SessionReader
from app.system.errors import UserError


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the limits of a process are POSIX's")
def test_spoiled_sessions_and_settings_are_read_or_refused() -> None:
    """Some of the cases of `benchmarks/fuzz.py`, which holds them to their limits of time."""
    words = ["fuzz", "18", "0", "--workers", "1", "--longest", "200"]
    done = python("-m", "benchmarks", *words, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"cases +18\n", done.stdout)


def test_checksum_of_a_forged_header_is_that_of_the_library(session: Session) -> None:
    """Else the forged headers of the fuzzing were refused for their checksum alone."""
    content = session.path.read_bytes()
    at = content.index(b"OHDR\x02")
    start = at + 6 + (16 if content[at + 5] & 32 else 0) + (4 if content[at + 5] & 16 else 0)
    width = 1 << (content[at + 5] & 3)
    end = start + width + int.from_bytes(content[start : start + width], "little")
    assert struct.pack("<I", lookup3(content[at:end])) == content[end : end + 4]


def _collection_of(path: Path, text: bytes) -> int:
    """Where the global heap collection begins that holds a text."""
    content = path.read_bytes()
    return content.rindex(b"GCOL", 0, content.index(text))


def _overwrite(path: Path, at: int, new: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        file.write(new)


def _endless_collection(path: Path) -> None:
    """An object of no length after another: HDF5 2.0 never comes back from it."""
    _overwrite(path, _collection_of(path, b"the travel is done") + 16, bytes(4064))


def _huge_collection(path: Path) -> None:
    _overwrite(path, _collection_of(path, b"the travel is done") + 8, struct.pack("<Q", 2**40))


def _huge_text(path: Path) -> None:
    at = path.read_bytes().index(b"the travel is done")
    _overwrite(path, at - 8, struct.pack("<Q", 2**62))


def _text_not_utf8(path: Path) -> None:
    _overwrite(path, path.read_bytes().index(b"the travel is done"), b"\xff\xfe")


@changing
def _many_times_the_same_text(file: h5py.File) -> None:
    """A hundred thousand rows that lead to one text of a megabyte."""
    reason = file["/entry/triggers/reason"]
    reason[0] = "x" * 10**6
    first = reason.id.read_direct_chunk((0,))[1][:16]
    for name in ("index", "sample", "image", "reason", "analysed", "checksum"):
        file[f"/entry/triggers/{name}"].resize(10**5, axis=0)
    for row in range(0, 10**5, 1024):
        reason.id.write_direct_chunk((row,), first * 1024)


@changing
def _foreign_filter(file: h5py.File) -> None:
    del file["/entry/forces/normal_force"]
    how = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    how.set_chunk((4096,))
    how.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)  # zstd, which is a plug-in
    space = h5py.h5s.create_simple((1003,), (h5py.h5s.UNLIMITED,))
    h5py.h5d.create(file["/entry/forces"].id, b"normal_force", h5py.h5t.IEEE_F64LE, space, how)


@changing
def _cycle(file: h5py.File) -> None:
    del file["/entry/clock"]
    file["/entry/clock"] = file["/entry"]


def _block_before(path: Path) -> None:
    content = path.read_bytes()
    with h5py.File(path, "w", userblock_size=512) as file:
        file.attrs[FORMAT_ATTRIBUTE] = 1
    assert content


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (_endless_collection, "HDF5 does not come to an end with it in 5 s; use a copy of it"),
        (_huge_collection, "damaged at /entry/.*: the bytes are not those that were written"),
        (_huge_text, "damaged at /entry/.*: the bytes are not those that were written"),
        (_text_not_utf8, "damaged at /entry/run/reason: .*utf-8"),
        (
            _many_times_the_same_text,
            f"damaged at /entry/triggers/reason: its texts claim more than {LARGEST_TEXTS} bytes",
        ),
        (
            replaced("/entry/run/reason", data=np.bytes_("fixed")),
            "damaged at /entry/run/reason: it is 0-dimensional",
        ),
        (
            replaced("/entry/run/reason", shape=(), dtype=h5py.ref_dtype),
            "damaged at /entry/run/reason: it is 0-dimensional",
        ),
        (
            replaced("/entry/clock/divisor", shape=(), dtype=h5py.regionref_dtype),
            "damaged at /entry/clock/divisor: it is 0-dimensional",
        ),
        (
            replaced("/entry/clock/divisor", data=h5py.Empty("i8")),
            "damaged at /entry/clock/divisor: ",
        ),
        (replaced("/entry/clock", data=1.0), "damaged at /entry/clock/sample_rate: it is missing"),
        (
            replaced(
                "/entry/forces/normal_force",
                shape=(2**26,),
                chunks=(2**26,),
                dtype="f8",
                compression="gzip",
            ),
            "damaged at /entry/forces/normal_force: it claims chunks of",
        ),
        (
            replaced(
                "/entry/instrument/camera/data",
                shape=(7, 10**6, 10**6),
                chunks=(1, 1000, 1000),
                dtype="u1",
            ),
            r"damaged at /entry/instrument/camera/data: it claims the shape",
        ),
        (
            _foreign_filter,
            "damaged at /entry/forces/normal_force: it is compressed by filter 32015, which needs"
            " a plug-in",
        ),
        (_cycle, "damaged at /entry/clock/sample_rate: it is missing"),
        (
            linked("/entry/clock", h5py.SoftLink("/entry/clock")),
            "damaged at /entry/clock/sample_rate: it is a link to elsewhere",
        ),
        (
            linked("/entry/summary", h5py.ExternalLink("/etc/hostname", "/")),
            "damaged at /entry/summary: it is a link to elsewhere",
        ),
        (
            linked("/entry/profile", h5py.SoftLink("/entry/rings")),
            "damaged at /entry/profile/radius: it is a link to elsewhere",
        ),
        (
            put("/entry/clock/sample_rate", float("nan")),
            "damaged at /entry/clock/sample_rate: it is nan",
        ),
        (put("/entry/clock/divisor", 0), "damaged at /entry/clock/divisor: it is 0"),
        (
            put("/entry/instrument/camera/pixel", float("inf")),
            "damaged at /entry/instrument/camera/pixel: it is inf",
        ),
        (
            put("/entry/clock/first_trigger", -3),
            "damaged at /entry/clock/first_trigger: it is -3",
        ),
        (attribute(FORMAT_ATTRIBUTE, np.zeros(4000, np.int64)), "not a SlipScope session"),
        (_block_before, "not as SlipScope writes it"),
    ],
)
def test_what_is_made_to_do_harm_is_refused(
    session: Session, spoil: Callable[[Path], None], sentence: str
) -> None:
    spoil(session.path)
    with pytest.raises(UserError, match=f"session\\.h5: .*{sentence}"):
        ask(session.path)


def test_a_text_can_not_steer_the_terminal(tmp_path: Path) -> None:
    writer = make_writer(tmp_path / "text.h5")
    writer.append(Event(0, "error", "\x1b]0;owned\x07\tand\n\x9b2J µ"))
    writer.close()
    with SessionReader(tmp_path / "text.h5") as read:
        assert read.events()[0].text == "\\x1b]0;owned\\x07\tand\n\\x9b2J µ"


def test_many_and_long_texts_come_back(tmp_path: Path) -> None:
    """More than one chunk of rows and more than one collection of texts."""
    writer = make_writer(tmp_path / "many.h5", config_toml="# " + "µ" * 50_000)
    events = [Event(n, "error", f"{n} " + "x" * (n % 97)) for n in range(3000)]
    for event in events:
        writer.append(event)
    writer.close()
    with SessionReader(tmp_path / "many.h5") as read, h5py.File(tmp_path / "many.h5") as file:
        assert read.events() == events
        assert read.header.config_toml == "# " + "µ" * 50_000
        assert [event.text for event in read.events()] == file["/entry/events/text"].asstr()[
            ()
        ].tolist()


PLUGIN = """
#include <stdio.h>
#include <stdlib.h>
__attribute__((constructor)) static void loaded(void) {
    FILE *f = fopen(getenv("MARK"), "w");
    if (f) fclose(f);
}
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="builds a shared library with gcc")
@pytest.mark.skipif(shutil.which("gcc") is None, reason="it compiles a plug-in with gcc")
def test_no_plug_in_is_loaded_for_a_session(session: Session, tmp_path: Path) -> None:
    """A library on HDF5's path says when it is loaded: by h5py for such a file, not by
    SlipScope.
    """
    _foreign_filter(session.path)
    with h5py.File(session.path, "r+") as file:
        file["/entry/forces/normal_force"].id.write_direct_chunk((0,), bytes(100))
    (tmp_path / "plugin.c").write_text(PLUGIN)
    folder = tmp_path / "plugins"
    folder.mkdir()
    subprocess.run(
        ["gcc", "-shared", "-fPIC", "-o", folder / "libplugin.so", tmp_path / "plugin.c"],
        check=True,
        timeout=400,
    )
    mark = tmp_path / "loaded"
    environment = {"HDF5_PLUGIN_PATH": str(folder), "MARK": str(mark)}
    read = (
        "import sys; from app.session.reader import SessionReader\nwith SessionReader(sys.argv[1])"
        " as r: r.forces()"
    )
    naive = "import sys, h5py\nh5py.File(sys.argv[1])['/entry/forces/normal_force'][()]"
    for code, is_loaded in ((read, False), (naive, True)):
        assert python("-c", code, session.path, environment=environment).returncode
        assert mark.exists() == is_loaded


def test_fields_of_somebody_else_are_checked_likewise(tmp_path: Path) -> None:
    path = tmp_path / "fields.h5"
    with h5py.File(path, "w") as file:
        file["entry/fields"] = h5py.ExternalLink("other.h5", "/")
    with pytest.raises(
        UserError,
        match=(
            r"fields\.h5: the file of displacement fields is damaged at"
            r" /entry/fields: it is a link"
        ),
    ):
        read_fields_file(path)
    assert not is_session(path)
    path.write_text("x_px,y_px,ux_px\n")
    with pytest.raises(UserError, match="not an HDF5 file"):
        read_fields_file(path)
    assert not is_session(path)
    make_writer(tmp_path / "real.h5").close()
    assert is_session(tmp_path / "real.h5")
