"""What `benchmarks.fuzz` does to the program: files damaged at random and by ill will, each given
to a command as a user would. A case raises `WrongEnd` where a command did not end as it should.
"""

from __future__ import annotations

import contextlib
import io
import random
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.report import ROOT

sys.path += [str(ROOT / "tests"), str(ROOT / "tests/session")]

from session_material import CONTACT, OUTCOME, copy_recording, record
from spoiled import ask, spoil
from spoiled_images import spoil_folder, spoil_image
from spoiled_inputs import spoil_journal, spoil_table
from spoiled_settings import VALUES, spoil_settings

from analysis.options import options
from app.cli import app
from app.session.field_series import fields_file
from app.session.reader import SessionReader
from app.settings.config import from_record, load, tables

KEYS = [f"{table}.{key}" for table, kind in tables().items() for key in options(kind)]
SHAPE = (64, 80)  # of the images that are imported
SECRET = 251  # the grey of the image that nobody has asked for
SMALL_BOXES = ("--set", "dic.box=20", "--set", "dic.step=10")
Case = tuple[str, Callable[[], object]]  # its kind, and what is done


UNEXPECTED = re.compile(r"unexpected \w+: .*where it came")


class WrongEnd(Exception):
    """A command that ended with another exit code than it should, or without a sentence."""


def command(*words: object, codes: tuple[int, ...] = (0, 2)) -> int:
    """The exit code of a command of `slipscope`, in this process."""
    told, said, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stderr(told), contextlib.redirect_stdout(said):
        try:
            app([str(word) for word in words], prog_name="slipscope")
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
    sentence = told.getvalue().strip() or said.getvalue().strip()
    if code not in codes or UNEXPECTED.search(sentence) or (code and not sentence):
        raise WrongEnd(f"{' '.join(map(str, words))}: exit code {code}: {sentence[-800:]}")
    return code


def settings_case(folder: Path, seed: int) -> Case:
    """Settings from a file, from the command line, or from a session."""
    rng = random.Random(seed)
    content = spoil_settings(rng)
    path = folder / "case/bench.toml"
    path.write_bytes(content)
    text = content.decode("utf-8", "replace")
    override = f"{rng.choice(KEYS)}={rng.choice(VALUES)}"
    overrides = [override, *text.splitlines()[: rng.randint(0, 2)]]
    ways: dict[str, Callable[[], object]] = {
        "settings file": lambda: load(path),
        "settings --set": lambda: load(None, overrides),
        "settings of a session": lambda: from_record(text, "session"),
    }
    way = rng.choice(list(ways))
    return way, ways[way]


def bench_case(folder: Path, seed: int) -> Case:
    """A bench file from somebody else, with whose names `slipscope check` would do harm."""
    rng, spied = random.Random(seed), folder / "decoy/secret.png"
    (folder / "case/evil.py").write_text("raise SystemExit('code was run')")
    (folder / "case/cam.cti").write_bytes(b"\x7fELF" + rng.randbytes(50))
    urls = [
        *(f"spy://loop://?file={spied}", f"spy:///dev/ttyS0?file={spied}", "loop://", "alt://COM1"),
        *("hwgrep://.*", "cp2110://", "rfc2217://127.0.0.1:9", "socket://127.0.0.1", str(spied)),
        *("SPY://loop://", " spy://loop://", "socket://127.0.0.1:9/?logging=debug", "file:///x"),
        *("http://127.0.0.1:9/x.csv", "ftp://127.0.0.1/x", "//127.0.0.1/x", "\\\\127.0.0.1\\x"),
        *("/dev/zero", "/dev/stdin", "/proc/self/mem", "../decoy/secret.png", "~/.bashrc", "-"),
        *("evil:Camera", "./cam.cti", str(folder / "case/cam.cti"), "os:system", "evil", "\0"),
    ]
    keys = [
        *("actuator.port", "sim.law_table", "camera.producer", "camera.source", "forces.source"),
        *("actuator.source", "camera.folder", "camera.device", "replay.session", "forces.server"),
        *("forces.certificate", "forces.device"),
    ]
    chosen = rng.sample(keys, rng.choice([1, 1, 2, 3]))
    lines: dict[str, list[str]] = {}
    sources = {"actuator.port": "conex-cc", "camera.producer": "gentl", "camera.folder": "folder"}
    sources |= {"forces.server": "ni", "replay.session": "replay"}
    for key in chosen:
        table, _, name = key.partition(".")
        lines.setdefault(table, []).append(f"{name} = {_toml(rng.choice(urls))}")
        if key in sources and f"{table}.source" not in chosen:
            kind = "camera" if table == "replay" else table
            lines.setdefault(kind, []).append(f"source = {_toml(sources[key])}")
    text = "\n".join(f"[{table}]\n" + "\n".join(rows) for table, rows in lines.items())
    path = folder / "case/bench.toml"
    path.write_text(text, encoding="utf-8")
    return "bench file", lambda: command("check", path, codes=(0, 1, 2))


def _toml(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\0", "\\u0000") + '"'


def session_case(folder: Path, seed: int) -> Case:
    """A session: all that is in it is read, and a command that reads sessions is given it, or one
    that lies beside it.
    """
    rng, path = random.Random(seed), folder / "case/session.h5"
    how = spoil(folder / "whole.h5", path, seed)
    made = folder / "case/made"
    commands: dict[str, Callable[[], object]] = {
        "ask": lambda: ask(path),
        "info": lambda: command("info", path, *rng.choice([[], ["--json"]])),
        "verify": lambda: command("info", path, "--verify", codes=(0, 1, 2)),
        "export": lambda: command("export", path, "-o", made.with_suffix(rng.choice(ENDINGS))),
        "repair": lambda: command("repair", path, "-o", f"{made}.h5", codes=(0, 1, 2)),
        "invert": lambda: command("invert", path, "-o", f"{made}.csv", codes=(0, 2)),
        "beside": lambda: _beside(folder, path),
    }
    name = rng.choice(list(commands))
    return f"session by {name}, {how}", commands[name]


ENDINGS = (".csv", ".npz", ".mat", ".pvd", "")


def _beside(folder: Path, path: Path) -> None:
    """`info` of a good session beside which lies a bad one that seems to belong to it."""
    good = path.with_name("good.h5")
    shutil.copy(folder / "whole.h5", good)
    path.replace(path.with_name("good-analysis.h5"))
    if command("info", good) != 0:
        raise WrongEnd("info of a good session refused it for what lies beside it")


def replay_case(folder: Path, seed: int) -> Case:
    """A session that can be replayed, damaged."""
    path = folder / "case/replayed.h5"
    how = spoil(folder / "replayed.h5", path, seed)
    words: list[object] = ["replay", path, "--headless"]
    if seed % 2:
        words += ["-o", folder / "case/analysis.h5"]
    return f"replay, {how}", lambda: command(*words, codes=(0, 1, 2))


def repair_case(folder: Path, seed: int) -> Case:
    """The repair of a session that was cut short, from its files, which are damaged; everything in
    the repaired session is read.
    """
    path, output = folder / "case/cut.h5", folder / "case/repaired.h5"
    how = "repair by journal, " + spoil_journal(folder / "cut.h5", path, seed)

    def repair_and_ask() -> None:
        command("repair", path, "-o", output, codes=(0, 1, 2))
        if output.exists():
            ask(output)

    return how, repair_and_ask


def import_case(folder: Path, seed: int) -> Case:
    """An import of images with tables of metadata and forces."""
    rng = random.Random(seed)
    images = folder / "case/images"
    which = rng.choice(["metadata", "forces", "metadata and forces"])
    shutil.copytree(folder / "images", images)
    for name in ("metadata", "forces"):
        if name in which:
            table = images / f"{name}.csv"
            table.write_bytes(spoil_table(table.read_bytes(), rng))
    return f"import, {which}", lambda: _import(folder, rng)


def _import(folder: Path, rng: random.Random) -> None:
    """Import what lies in the case; an image of somewhere else must not be in it."""
    made = folder / "case/imported.h5"
    more: list[object] = []
    for option, values in (
        ("--divisor", [None, 125]),
        ("--reference", [None, None, 1]),
        ("--drive", [None, 3]),
    ):
        if (value := rng.choice(values)) is not None:
            more += [option, value]
    rate = rng.choice([1000, 1000, 1000, 100, 100_000])
    asked = ("--pixel", 7.04, "--rate", rate, *SMALL_BOXES, *more)
    command("import", folder / "case/images", "-o", made, *asked, codes=(0, 1, 2))
    if made.exists():
        with SessionReader(made) as read:
            if any((image == SECRET).all() for _, _, image in read.frames()):
                raise WrongEnd("an image of somewhere else was imported")


def image_case(folder: Path, seed: int) -> Case:
    """Images to correlate or to import, one of them damaged or a bomb."""
    rng, images = random.Random(seed), folder / "case/images"
    shutil.copytree(folder / "images", images)
    ending = rng.choice([".png", ".tif"])
    victim = images / f"2{ending}"
    how, content = spoil_image((folder / f"one{ending}").read_bytes(), rng)
    (images / "2.png").unlink()
    victim.write_bytes(content)
    (images / "metadata.csv").unlink()
    if rng.random() < 0.4:
        return f"image by import, {how}", lambda: _import(folder, rng)
    words = ["dic", images / "0.png", images / "1.png", victim]
    if rng.random() < 0.3:
        words[1], words[3] = victim, images / "0.png"
    made = folder / "case/fields.csv"
    return f"image by dic, {how}", lambda: command(*words, "-o", made, "--box", 20, "--step", 10)


def folder_case(folder: Path, seed: int) -> Case:
    """A folder to import, with links and names that lead out of it."""
    rng, images = random.Random(seed), folder / "case/images"
    shutil.copytree(folder / "images", images)
    how = spoil_folder(images, folder / "decoy/secret.png", rng)
    return f"folder, {how}", lambda: _import(folder, rng)


def fields_case(folder: Path, seed: int) -> Case:
    """A file of displacement fields, as `slipscope invert` reads it."""
    path = folder / "case/fields.h5"
    how = spoil(folder / "whole-fields.h5", path, seed)
    made = folder / "case/tractions.csv"
    return f"fields, {how}", lambda: command("invert", path, "-o", made, *MATERIAL)


MATERIAL = ("--E", 3.43, "--poisson", 0.5, "--radius", 128.8, "--normal-force", 0.5, "--pixel", 7)
CASES = (
    *(session_case, repair_case, settings_case, session_case, image_case, repair_case),
    *(session_case, import_case, fields_case, session_case, repair_case, bench_case),
    *(session_case, settings_case, folder_case, session_case, repair_case, import_case),
    *(session_case, replay_case),
)


def make_whole(folder: Path) -> None:
    """Write what the cases damage: a session, one cut short, one that can be replayed, fields,
    images and tables to import; and what must stay as it is.
    """
    writer, _ = record(folder / "whole.h5")
    writer.append(CONTACT)
    copy_recording(folder / "whole.h5", folder / "cut.h5")
    writer.append(OUTCOME)
    writer.close()
    for name in ("images", "decoy", "case"):
        (folder / name).mkdir(exist_ok=True)
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.integers(0, 256, SHAPE, np.uint8), (0, 0), 1.5)
    rows = ["sample,phase,stage_um,file"]
    for n, phase in enumerate(["background", "reference", "drive", "drive", "drive", "end"]):
        cv2.imwrite(str(folder / f"images/{n}.png"), np.roll(image, n, axis=1))
        rows.append(f"{125 * n},{phase},{2.5 * n},{n}.png")
    for ending in ("png", "tif"):
        cv2.imwrite(str(folder / f"one.{ending}"), np.roll(image, 2, axis=1))
    cv2.imwrite(str(folder / "decoy/secret.png"), np.full(SHAPE, SECRET, np.uint8))
    (folder / "images/metadata.csv").write_text("\n".join(rows), encoding="utf-8")
    forces = [f"{n},{n / 1000},{0.03},{max(0.0, n - 250) * 1e-4}" for n in range(800)]
    text = "\n".join(["sample,time_s,P_N,Q_N", *forces])
    (folder / "images/forces.csv").write_text(text, encoding="utf-8")
    asked = ("--pixel", 7.04, "--rate", 1000, *SMALL_BOXES)
    command("import", folder / "images", "-o", folder / "replayed.h5", *asked, codes=(0, 1))
    axis = np.arange(4.0)
    settings, units = {"reference": "r.tif", "box": 20}, {"box": "px"}
    fields = folder / "whole-fields.h5"
    with fields_file(fields, ["a.tif"], axis, axis, ["ok"], settings, units):
        pass
