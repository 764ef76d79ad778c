"""The data of another lab, with tables of any form and clocks that do not agree, become a session
by one command; the results are those of the world behind them.
"""

from __future__ import annotations

import math
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import foreign_lab as foreign
import numpy as np
import pytest
from command_line import call
from foreign_lab import Lab, Style

from app.cli import file_commands as files
from app.files.clocks import StartOfMotion, matches
from app.files.forms import TableForm
from app.files.frames import Sources
from app.files.importing import Understood, import_files, understood
from app.files.phases import _rise
from app.files.text_tables import FORCES, read_table
from app.records.record_types import Phase
from app.session.reader import SessionReader
from app.system.errors import UserError

RATE = 8.0
PLAIN = Style(
    names=("time_s", "P_N", "Q_N", "note"), separator=",", decimal=".", encoding="utf-8", ahead=0.0
)


@pytest.fixture(scope="module", autouse=True)
def looked_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        foreign.look_once(patch)
        yield


@pytest.fixture(scope="module")
def lab() -> Lab:
    return foreign.measured(foreign.Plan())


@pytest.fixture(scope="module")
def folder(lab: Lab, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images, a table of forces as Excel writes it in Germany, and what the operator knows."""
    path = tmp_path_factory.mktemp("lab")
    foreign.write_images(lab, path / "images")
    foreign.write_forces(lab, path / "kraft.csv")
    foreign.write_settings(lab, path / "lab.toml")
    return path


def slipscope(*words: object) -> tuple[int, str]:
    """The exit code of a command, and all that it says on one line."""
    done = call(*words)
    return done.exit_code, " ".join(done.output.split())


def began(read: Understood) -> dict[str, int]:
    return {event.text: event.sample for event in read.measured.events if event.kind == "phase"}


def index_at(read: Understood, sample: int) -> int:
    return next(frame.index for frame in read.frames if frame.sample == sample)


def check_phases(read: Understood, lab: Lab, *, clock_s: float = 0.03) -> None:
    """Background, reference and drive are those of the world; times within `clock_s`."""
    rate, phases = read.config.forces.sample_rate, began(read)
    start = read.frames[0].sample
    exposure = read.config.exposure_samples
    assert index_at(read, phases["reference"]) in (lab.rest, lab.rest - 1)
    background = phases["contact"] - exposure
    assert index_at(read, background) in lab.free[-2:]
    assert (phases["drive"] - start) / rate == pytest.approx(lab.drive_s, abs=clock_s)


@pytest.mark.slow
def test_one_command_with_three_options(lab: Lab, folder: Path, tmp_path: Path) -> None:
    """A semicolon, a decimal comma, Latin-1, a clock that began 12.5 s earlier and steps that vary
    by 10 %, 12 bits in 16: every result is within its uncertainty of the truth.
    """
    code, out = slipscope(
        "import",
        folder / "images",
        "-o",
        tmp_path / "lab.h5",
        *("--forces", folder / "kraft.csv"),
        *("--settings", folder / "lab.toml"),
        *("--frame-rate", RATE),
    )
    assert code == 0
    for words in (
        "';', decimal comma, cp1252",
        "p_n from 'Normalkraft [N]'",
        "-12.500 s are added to its times, with which both began together",
        "the background is frame",
        f"the reference is frame {lab.rest}, the last before it",
    ):
        assert words in out
    with SessionReader(tmp_path / "lab.h5") as session:
        s = session.outcome.summary
    assert s is not None

    def off(value: float, truth: float, name: str, sd: float) -> float:
        by_inputs = s.systematic(name) if name in s.budget_quantities else 0.0
        return (value - truth) / np.hypot(sd, abs(truth) * (by_inputs if by_inputs > 0 else 0.0))

    assert abs(off(s.young_modulus_pa, lab.E, "young_modulus", s.young_modulus_sd_pa)) < 1.5
    assert abs(off(s.mu_d, lab.mu, "mu_d", s.mu_d_sd)) < 1.5
    assert abs(off(s.onset_time_s, lab.t_s, "onset_time", s.onset_time_sd_s)) < 1.5
    assert abs(off(s.apparent_radius_m, lab.radius, "", s.apparent_radius_sd_m)) < 1.5
    assert s.sliding_velocity_m_s == pytest.approx(lab.v, rel=0.005)
    assert any("samples of the" in note for note in s.notes)  # 500 rows a second


STYLES = {
    "comma and point": replace(PLAIN, ahead=12.5),
    "with a byte order mark": replace(PLAIN, encoding="utf-8-sig"),
    "UTF-16, tabs": Style(
        names=("Time (s)", "Normal force (N)", "Shear force (N)", "Comment"),
        separator="\t",
        decimal=".",
        encoding="utf-16",
    ),
    "ms, mN, another order": Style(
        names=("t/ms", "Fn/mN", "Ft/mN", "x"), time=1e3, force=1e3, order=(2, 3, 0, 1), digits=4
    ),
    "thousands": Style(
        names=("Zeit (ms)", "Fn (mN)", "Ft (mN)", "x"), time=1e3, force=1e3, thousands=".", digits=3
    ),
}


@pytest.mark.parametrize("style", STYLES.values(), ids=STYLES)
def test_a_table_is_read_as_it_is_written(lab: Lab, tmp_path: Path, style: Style) -> None:
    path = foreign.write_forces(lab, tmp_path / "f.txt", style)
    table = read_table(path, FORCES)
    assert table.has("time", "p", "q")
    np.testing.assert_allclose(table.numbers["time"], lab.times + style.ahead, atol=1e-5)
    np.testing.assert_allclose(table.numbers["p"], lab.forces[:, 0], atol=2e-6)
    np.testing.assert_allclose(table.numbers["q"], lab.forces[:, 1], atol=2e-6)


def sources(folder: Path, **given: Any) -> Sources:
    usual = {"images": [folder / "images"], "forces": folder / "kraft.csv", "frame_rate": RATE}
    return Sources(**{**usual, "settings": folder / "lab.toml", **given})


def test_columns_of_any_language_and_order_are_named(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    style = Style(names=("ura", "obremenitev", "striženje, x", "opomba"), encoding="cp1250")
    style = replace(style, note="š", force=1e3, order=(3, 1, 0, 2))
    path = foreign.write_forces(lab, tmp_path / "sile.csv", style)
    form = TableForm.given(["time_s=ura, P_mN=Obremenitev", "Q_mN=4"], encoding="cp1250")
    check_phases(understood(sources(folder, forces=path, form=form)), lab)
    form = TableForm.given(["time_s=ura, P_mN=load, Q_mN=4"], encoding="cp1250")
    with pytest.raises(UserError, match=r"'P_mN=load' fits no table; .* 'opomba', 'obremenitev'"):
        understood(sources(folder, forces=path, form=form))


def test_forces_slower_than_images(lab: Lab, folder: Path, tmp_path: Path) -> None:
    """Six rows a second for eight images: the clock is a multiple of theirs."""
    slow = foreign.with_forces(lab, 83)
    path = foreign.write_forces(slow, tmp_path / "slow.csv", replace(PLAIN, digits=6))
    read = understood(sources(folder, forces=path))
    assert read.config.forces.sample_rate >= 480
    check_phases(read, lab, clock_s=0.1)


def test_images_begin_before_the_forces_which_end_early(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    rows = slice(400, 4600)
    path = foreign.write_forces(lab, tmp_path / "part.csv", replace(Style(), ahead=-3.0), rows)
    read = understood(sources(folder, forces=path, offset_s=3.0))
    check_phases(read, lab)
    assert any("for 25 of 92 images there are no forces" in remark for remark in read.remarks)
    outside_s = read.outside / read.config.forces.sample_rate
    assert outside_s == pytest.approx(0.8 + (11.5 - 9.2), abs=0.15)
    # the start of the motion says the same, if nobody else does
    found = understood(sources(folder, forces=path))
    check_phases(found, lab, clock_s=0.15)
    assert any("ahead of that of the images" in remark for remark in found.remarks)


def test_a_clock_that_was_found_leaves_its_uncertainty_to_the_results(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    """The onset counts from the start of the drive, which the clock of the forces tells, and each
    frame has the forces of that clock.
    """
    rows = slice(400, 4600)
    path = foreign.write_forces(lab, tmp_path / "part.csv", replace(Style(), ahead=-3.0), rows)
    known = understood(sources(folder, forces=path, offset_s=3.0)).config.uncertainty
    read = understood(sources(folder, forces=path))
    sd = next(float(one[1]) for r in read.remarks if (one := re.search(r"± (\S+) s ahead", r)))
    found = read.config.uncertainty
    assert sd > 2 * known.start > known.delay == 0
    assert found.start == pytest.approx(math.hypot(known.start, sd), abs=1e-3)
    assert found.delay == pytest.approx(sd, abs=1e-3)
    rate = read.config.forces.sample_rate
    start_s = (began(read)["drive"] - read.frames[0].sample) / rate
    assert abs(start_s - lab.drive_s) < 3 * found.start
    own = ("uncertainty.start=2", "uncertainty.delay=3")
    given = understood(sources(folder, forces=path, overrides=own)).config.uncertainty
    assert (given.start, given.delay) == pytest.approx((2e-3, 3e-3))


def test_forces_that_begin_within_the_drive_are_not_matched(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    """The rest before the drive is missing: where the motion began cannot be told."""
    path = foreign.write_forces(lab, tmp_path / "late.csv", Style(), slice(2000, None))
    with pytest.raises(UserError, match="do not overlap"):
        understood(sources(folder, forces=path))


def test_clocks_that_agree_are_left_alone(lab: Lab, folder: Path, tmp_path: Path) -> None:
    path = foreign.write_forces(lab, tmp_path / "same.csv", PLAIN)
    read = understood(sources(folder, forces=path))
    check_phases(read, lab)
    assert not any("clock of the forces" in remark for remark in read.remarks)


def test_forces_of_another_hour_are_told_with_what_would_move_them(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    """Where the images show no motion nothing can be matched; nothing is shifted silently."""
    few = tmp_path / "few"
    few.mkdir()
    for n in range(12):
        shutil.copy(folder / "images" / f"bild_{n:04d}.tif", few)
    path = foreign.write_forces(lab, tmp_path / "f.csv", replace(Style(), ahead=5000.0))
    with pytest.raises(UserError, match=r"5000 to 5011.* do not overlap; .*--time-offset .* -5000"):
        understood(sources(folder, images=[few], forces=path))


def test_an_image_is_missing_and_a_table_has_the_times(
    lab: Lab, folder: Path, tmp_path: Path
) -> None:
    """The images' own times, of the same clock as the forces'; one image was lost."""
    images = foreign.write_images(lab, tmp_path / "images", leave=(40,))
    lines = ["Bild;Datei;Zeit (s)"]
    for n, t in enumerate(lab.at + 12.5):
        if n != 40:
            lines.append(
                f"{n};bild_{n:04d}.tif;{t:.4f}".replace(f"{t:.4f}", f"{t:.4f}".replace(".", ","))
            )
    (tmp_path / "bilder.csv").write_text("\n".join(lines), encoding="latin-1")
    read = understood(
        sources(folder, images=[images], metadata=tmp_path / "bilder.csv", frame_rate=None)
    )
    check_phases(read, lab)
    assert [frame.index for frame in read.frames if frame.path is None] == [40]


def test_all_images_in_one_file_of_many_pages(lab: Lab, folder: Path, tmp_path: Path) -> None:
    stack = foreign.write_stack(lab, tmp_path / "stack.tif")
    read = understood(sources(folder, images=[stack]))
    check_phases(read, lab)
    assert read.frames[7].path is not None
    assert read.frames[7].path.name == "stack.tif, page 7"


def test_one_image_without_a_number(folder: Path, tmp_path: Path) -> None:
    shutil.copy(folder / "images" / "bild_0003.tif", tmp_path / "stack.tif")
    found = import_files(
        Sources(images=[tmp_path / "stack.tif"], pixel_um=10, frame_rate=8), tmp_path / "one.h5"
    )
    assert found.outcome.counts.frames_received == 1


def test_everything_that_is_missing_is_told_at_once(lab: Lab, folder: Path, tmp_path: Path) -> None:
    names = ("ura", "obremenitev", "strizenje", "opomba")
    path = foreign.write_forces(lab, tmp_path / "sile.csv", Style(names=names))
    code, said = slipscope("import", folder / "images", "-o", tmp_path / "no.h5", "--forces", path)
    assert code == 2
    for words in (
        "--pixel",
        "--frame-rate",
        "--columns",
        "neither P_N",
        "neither sample nor time_s",
    ):
        assert words in said
    for read in (
        "92 images of 360 x 360 uint16",
        "';', decimal comma, cp1252",
        "not used: 'ura', 'obremenitev', 'strizenje', 'opomba'",
    ):
        assert read in said
    assert os.listdir(tmp_path) == ["sile.csv"]


def test_an_import_that_measures_nothing_fails(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A reference before the contact, of a user who asks for it."""
    some = [folder / "images" / f"bild_{n:04d}.tif" for n in range(40)]
    given = {"reference": 3, "background": 2, "offset_s": -12.5, "overrides": ("dic.step=40",)}
    own = {"images": some, "forces": folder / "kraft.csv", "frame_rate": RATE, **given}
    own["settings"] = folder / "lab.toml"
    assert files.import_(session=tmp_path / "n.h5", **own) == 1
    told = capsys.readouterr()
    assert "nothing was measured" in told.err
    assert "--reference" in told.err
    with SessionReader(tmp_path / "n.h5") as session:
        assert session.outcome.counts.frames_received == 40


@pytest.mark.parametrize("name", ["P", "Q"])
def test_a_force_of_the_wrong_sign_is_told(
    lab: Lab, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """No result of a contact that is pulled; negative friction is a remark."""
    turned = replace(lab, forces=lab.forces * ([-1, 1] if name == "P" else [1, -1]))
    path = foreign.write_forces(turned, tmp_path / "turned.csv", PLAIN)
    own = {"images": [folder / "images"], "forces": path, "frame_rate": RATE}
    own |= {"settings": folder / "lab.toml"}
    assert files.import_(session=tmp_path / "t.h5", **own) == (name == "P")
    told = capsys.readouterr()
    said = " ".join((told.out + told.err).split())
    assert f'turn its sign with a minus: --columns "{name}_N=-NAME"' in said
    assert ("P is -0.03 N under load" in said) == (name == "P")


def test_phases_begin_on_the_frame_that_is_named(lab: Lab, folder: Path, tmp_path: Path) -> None:
    """Also where its sample is not the first of a block of readings."""
    path = foreign.write_forces(lab, tmp_path / "f.csv", PLAIN)
    some = [folder / "images" / f"bild_{n:04d}.tif" for n in range(9, 40)]
    import_files(
        sources(
            folder,
            images=some,
            forces=path,
            offset_s=-9 / RATE,
            overrides=("stress.method=none",),
        ),
        tmp_path / "p.h5",
    )
    with SessionReader(tmp_path / "p.h5") as session:
        phases = {event.text: event.sample for event in session.events() if event.kind == "phase"}
        assert phases["reference"] % 50
        of = {s.sample: s.conditions.phase for s in session.snapshots()}
    assert of[phases["reference"]] is Phase.REFERENCE


def test_pages_of_a_stack_are_the_images_that_were_written(tmp_path: Path) -> None:
    from app.files.grey_images import pictures_of, read_image

    images = [
        np.random.default_rng(n).integers(0, 4096, (40, 50)).astype(np.uint16) for n in range(5)
    ]
    for way in (1, 5, 8):  # none, LZW, deflate
        path = tmp_path / f"{way}.tif"
        cv2.imwritemulti(str(path), images, [cv2.IMWRITE_TIFF_COMPRESSION, way])
        pages = pictures_of([path])
        assert len(pages) == 5
        for page, image in zip(pages, images, strict=True):
            np.testing.assert_array_equal(read_image(page), image)


def loading(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (px) and Q (N) of a drive that begins at 3 s and slides from 7 s on."""
    share = np.clip((t - 3.0) / 4.0, 0, 1)
    q = 1 - (1 - share) ** 1.4
    return 2.0 * share**1.2 + 0.8 * np.clip(t - 7.0, 0, None), 0.4 * q


@pytest.mark.parametrize("ahead", [-30.0, 0.0, 2.37, 5000.0])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_start_of_the_motion_tells_how_the_clocks_differ(ahead: float, sign: int) -> None:
    rng = np.random.default_rng(2)
    seen, at = np.arange(0, 12, 0.1), np.arange(0, 12, 0.002)
    motion = StartOfMotion(seen, loading(seen + 0.005)[0] + 5e-4 * rng.normal(size=len(seen)))
    q = sign * loading(at)[1] + 1e-3 * rng.normal(size=len(at))
    (found,) = matches(motion, at + ahead, q, exposure_s=0.01)
    assert found.ahead_s == pytest.approx(ahead, abs=3 * found.sd_s)
    assert found.sd_s < 0.1


@pytest.mark.parametrize("case", ["begins in the drive", "noise", "nothing moves", "one value"])
def test_what_does_not_show_the_start_of_the_motion_matches_nothing(case: str) -> None:
    rng = np.random.default_rng(2)
    seen, at = np.arange(0, 12, 0.1), np.arange(0, 12, 0.002)
    u, q = loading(seen + 0.005)[0], loading(at)[1]
    if case == "begins in the drive":
        at, q = at[2000:], q[2000:]
    elif case == "noise":
        q = rng.normal(size=len(at))
    elif case == "nothing moves":
        u = np.zeros(len(seen))
    else:
        q = np.full(len(at), 0.3)
    u = u + 5e-4 * rng.normal(size=len(seen))
    assert len(matches(StartOfMotion(seen, u), at + 1.0, q, exposure_s=0.01)) != 1


@pytest.mark.parametrize("rest_s", [0.2, 0.5, 3.0])
def test_the_start_of_the_drive_is_found_however_short_the_rest_before_it(rest_s: float) -> None:
    at = np.arange(3.0 - rest_s, 12, 0.002)
    q = loading(at)[1] + 1e-3 * np.random.default_rng(1).normal(size=len(at)) + 0.02
    start, sd = _rise(q, 500.0)
    assert start / 500 == pytest.approx(rest_s, abs=max(4 * sd / 500, 0.004))
    assert sd / 500 < 0.005


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rise", "noise"),
    [
        (lambda share: share, 1e-3),
        (lambda share: 1 - (1 - share) ** 1.5, 5e-3),  # Cattaneo and Mindlin
        (lambda share: (1 - np.exp(-3 * share)) / (1 - np.exp(-3)), 1e-3),
    ],
    ids=["straight", "partial slip", "exponential"],
)
def test_the_start_of_the_drive_lies_within_its_uncertainty(rise: Any, noise: float) -> None:
    off, rng = [], np.random.default_rng(3)
    for _ in range(60):
        at = rng.uniform(0, 0.002) + np.arange(0, 9, 0.002)
        q = 0.4 * rise(np.clip((at - 3.0) / 4.0, 0, 1)) + noise * rng.normal(size=len(at))
        start, sd = _rise(q, 500.0)
        off.append(((at[0] + start / 500 - 3.0) / (sd / 500), sd / 500))
    z, sd = np.array(off).T
    assert abs(z.mean()) < 0.5
    assert np.mean(np.abs(z) < 1) > 0.52
    assert np.mean(np.abs(z) < 2) > 0.9
    assert np.median(sd) < 2.5 * noise  # s, of N
