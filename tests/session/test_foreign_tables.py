"""Tables and pictures as other programs write them: times of day, weights, empty cells, signs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.files import text_tables
from app.files.forms import TableForm, clock_s
from app.files.frames import Sources
from app.files.grey_images import pictures_of, read_image
from app.files.imported_forces import rate_of
from app.files.importing import Understood, understood
from app.files.text_tables import FORCES, TextTable, read_table
from app.system.errors import UserError


def table(folder: Path, text: str, *columns: str) -> TextTable:
    path = folder / "forces.csv"
    path.write_text(text, encoding="utf-8")
    return read_table(path, FORCES, TableForm.given(columns))


def test_images_whose_order_cannot_be_known_need_a_table(tmp_path: Path) -> None:
    """Not those of a table that names them."""
    for name in ("at 0.5", "at 0.10"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.zeros((64, 64), np.uint8))
    given = {"pixel_um": 5.0, "frame_rate": 8.0, "rate_hz": 1000}
    with pytest.raises(UserError, match=r"at 0\.5\.png to at 0\.10\.png: the numbers behind"):
        understood(Sources(images=[tmp_path], **given))
    (tmp_path / "metadata.csv").write_text("file\nat 0.10.png\nat 0.5.png\n", encoding="utf-8")
    found = understood(Sources(images=[tmp_path], overrides=["dic.box=20"], **given)).frames
    assert [one.path.path.name for one in found] == ["at 0.10.png", "at 0.5.png"]


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [
        ("14:03:07,250", 50587.25),
        ("0:00:01", 1.0),
        ("1970-01-02 00:00:01.5", 86401.5),
        ("2026-11-12T14:03:07.250+01:00", 1794488587.25),
        ("2026-11-12T07:33:07.250-05:30", 1794488587.25),
        ("2026-11-12T13:03:07.25Z", 1794488587.25),
        ("12.11.2026 13:03:07,25", 1794488587.25),
        ("2026/11/12 13:03:07.25", 1794488587.25),
        ("12/11/2026 1:03:07.25 PM", 1794488587.25),
        ("12-11-2026, 13:03:07.25", 1794488587.25),
        ("12:00:01 am", 1.0),
        ("12:00:01 p.m.", 43201.0),
    ],
)
def test_a_time_of_day_is_seconds(cell: str, seconds: float) -> None:
    assert clock_s(cell) == seconds


@pytest.mark.parametrize(
    "cell",
    [
        *("24:00:00", "1:60:00", "1:00:60", "1:00", "13:00:00 PM", "0:00:00 AM"),
        *("31.02.2026 1:00:00", "12/31/2026 1:00:00"),
    ],
)
def test_a_text_that_is_no_time_of_day_is_none(cell: str) -> None:
    assert clock_s(cell) == np.inf


@pytest.mark.parametrize(
    ("dates", "first_s"),
    [
        (("31/01/2026", "01/02/2026"), 1769903999.0),  # 31 January
        (("01/31/2026", "02/01/2026"), 1769903999.0),
        (("11/11/2026", "11/11/2026"), 1794441599.0),
    ],
)
def test_a_date_that_has_one_meaning_says_what_comes_first(
    dates: tuple[str, str], first_s: float, tmp_path: Path
) -> None:
    rows = f"{dates[0]} 11:59:59 PM,0.5,0.1\n{dates[1]} 12:00:00 AM,0.5,0.2\n"
    read = table(tmp_path, f"time,P_N,Q_N\n{rows}")
    apart_s = 1.0 if dates[0] != dates[1] else -86399.0
    assert read.numbers["time"].tolist() == [first_s, first_s + apart_s]


def test_a_date_of_two_meanings_needs_an_option(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    path.write_text("time,P_N,Q_N\n12/11/2026 13:03:07,0.5,0.1\n", encoding="utf-8")
    with pytest.raises(UserError, match=r"'12/11/2026 .* give --day-first or --month-first"):
        read_table(path, FORCES)
    for is_day_first, seconds in ((True, 1794488587.0), (False, 1796994187.0)):
        read = read_table(path, FORCES, TableForm.given(is_day_first=is_day_first))
        assert read.numbers["time"].tolist() == [seconds]


@pytest.mark.parametrize(
    "above",
    ["NA,0.5,0.1\n", ",0.5,0.1\n", "11/11/2026 10:00:00,0.5,0.1\n", "9:59:59,0.5,0.1\n"],
)
def test_a_date_of_one_meaning_counts_wherever_it_stands(above: str, tmp_path: Path) -> None:
    rows = "".join(f"11/{day}/2026 10:00:00,0.5,0.1\n" for day in (12, 13))
    read = table(tmp_path, f"time_s,P_N,Q_N\n{above}{rows}")
    assert np.diff(read.numbers["time"])[-1] == 86400.0


@pytest.mark.parametrize("above", ["", "NA,0.5,0.1\n", "11/11/2026 10:00:00,0.5,0.1\n"])
def test_the_date_of_two_meanings_is_the_one_that_is_quoted(above: str, tmp_path: Path) -> None:
    text = f"time_s,P_N,Q_N\n{above}12/11/2026 10:00:00,0.5,0.1\n"
    with pytest.raises(UserError, match="'12/11/2026 10:00:00' in column time_s may begin with"):
        table(tmp_path, text)


def test_a_table_whose_dates_have_one_order_is_not_read_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Large tables are read once."""
    monkeypatch.setattr(text_tables, "has_day_first", None)
    for first, second in (
        ("2026-11-12T23:59:59Z", "2026-11-13T00:00:00Z"),
        ("12.11.2026 23:59:59", "13.11.2026 0:00:00"),
        ("23:59:59", "0:00:00"),
    ):
        read = table(tmp_path, f"time,P_N,Q_N\n{first},0.5,0.1\n{second},0.5,0.1\n")
        assert np.diff(read.numbers["time"]).tolist() == [1.0]


def test_a_row_without_a_time_is_told_before_dates_are_asked_for(tmp_path: Path) -> None:
    text = "P_N,Q_N,time_s\n0.5,0.1\n0.5,0.1,12/11/2026 10:00:00\n"
    with pytest.raises(UserError, match="row 1 has 2 cells, the header 3"):
        table(tmp_path, text)


def test_a_date_that_does_not_fit_its_option_names_the_other(tmp_path: Path) -> None:
    path = tmp_path / "forces.csv"
    for date, given, other in (("13/11/2026", False, "day"), ("11/13/2026", True, "month")):
        path.write_text(f"time,P_N,Q_N\n{date} 10:00:00,0.5,0.1\n", encoding="utf-8")
        with pytest.raises(UserError, match=f"row 1, is no date that .* give --{other}-first"):
            read_table(path, FORCES, TableForm.given(is_day_first=given))
    path.write_text("time_s,P_N,Q_N\n0,13/11/2026 10:00:00,0.1\n", encoding="utf-8")
    with pytest.raises(UserError, match="column P_N, row 1, is no number"):
        read_table(path, FORCES, TableForm.given(is_day_first=False))


def test_times_of_day_pass_midnight(tmp_path: Path) -> None:
    rows = "".join(f"{clock},0.5,0.1\n" for clock in ("23:59:59.5", "0:00:00", "0:00:00.5"))
    read = table(tmp_path, f"time,P_N,Q_N\n{rows}")
    assert read.numbers["time"].tolist() == [86399.5, 86400.0, 86400.5]


@pytest.mark.parametrize("name", ["time_s", "Uhrzeit", "timestamp", "Zeit [hh:mm:ss]"])
def test_a_column_of_times_of_day_needs_no_unit(name: str, tmp_path: Path) -> None:
    read = table(tmp_path, f"{name};Fn [N];Ft [N]\n9:59:59,5;0,5;0,1\n10:00:00,25;0,5;0,2\n")
    assert read.numbers["time"].tolist() == [35999.5, 36000.25]
    assert read.units["time"] == "s"


def test_a_number_of_an_unknown_unit_is_no_time(tmp_path: Path) -> None:
    assert not table(tmp_path, "Zeit;Fn [N];Ft [N]\n9,5;0,5;0,1\n10,25;0,5;0,2\n").has("time")


def test_weights_are_forces(tmp_path: Path) -> None:
    read = table(tmp_path, "t [s],load [g],Ft [kgf]\n0,100,0.01\n1,200,0.02\n")
    np.testing.assert_allclose(read.numbers["p"], [0.980665, 1.96133], rtol=1e-12)
    np.testing.assert_allclose(read.numbers["q"], [0.0980665, 0.196133], rtol=1e-12)


def test_words_for_nothing_are_empty_cells_and_others_are_refused(tmp_path: Path) -> None:
    cells = ("0.5", "", "NaN", "NA", "n/a", "#N/A", "-", "null", ".")
    rows = "".join(f"{n},{cell},0.1\n" for n, cell in enumerate(cells))
    read = table(tmp_path, f"time_s,P_N,Q_N\n{rows}")
    np.testing.assert_array_equal(read.numbers["p"], [0.5, *[np.nan] * 8])
    for cell in ("open", "-.", ".d1"):
        with pytest.raises(UserError, match=f"'{cell}' in column P_N, row 2, is no number"):
            table(tmp_path, f"time_s,P_N,Q_N\n0,0.5,0.1\n1,{cell},0.1\n")


@pytest.mark.parametrize(
    ("cell", "number"),
    [
        *(("1.5D-03", 0.0015), ("-2.5d+01", -25.0), (".5D0", 0.5)),  # Fortran
        *(("\u22120.25", -0.25), ("1e\u22122", 0.01)),  # a minus sign of typography
        *(("1\u2019234.5", 1234.5), ("\u2013", np.nan)),  # Windows in Switzerland; a dash
    ],
)
@pytest.mark.parametrize("sign", [".", ","])
def test_numbers_of_other_programs_are_numbers(
    cell: str, number: float, sign: str, tmp_path: Path
) -> None:
    rows = "".join(f"{n};{cell};{n}.5\n" for n in range(4)).replace(".", sign)
    read = table(tmp_path, f"time_s;P_N;Q_N\n{rows}")
    np.testing.assert_array_equal(read.numbers["p"], [number] * 4)


def test_a_file_of_fortran_has_its_columns(tmp_path: Path) -> None:
    rows = "".join(f"  0.{n}000D+00   0.5000D+00  0.1000D-0{n}\n" for n in range(1, 7))
    read = table(tmp_path, f"   time_s        P_N         Q_N\n{rows}")
    assert read.numbers["time"].tolist() == [n / 10 for n in range(1, 7)]


def test_a_point_in_a_table_of_decimal_commas_is_no_decimal_sign(tmp_path: Path) -> None:
    """1.002 was 1002 there, between 0.998 and 0.999."""
    rows = "".join(f"0,{n};0.99{n};0,1\n" for n in range(7, 10)) + "1,0;1.002;0,1\n"
    with pytest.raises(UserError, match=r"'0\.997' in column P_N, row 1, is no number"):
        table(tmp_path, f"time_s;P_N;Q_N\n{rows}")


def test_units_that_machines_write(tmp_path: Path) -> None:
    read = table(tmp_path, "Time;Load;Ft\n(sec);(kN);(N)\n0,5;0,002;1,5\n1,5;0,003;1,5\n")
    assert [read.numbers[name][0] for name in ("time", "p", "q")] == [0.5, 2.0, 1.5]
    assert table(tmp_path, "time_h,P_N,Q_N\n0.5,1,1\n").numbers["time"].tolist() == [1800.0]


@pytest.mark.parametrize(
    ("times", "said"),
    [
        ((0.0, 0.0, 0.1), "time_ms of row 2 is 0 s, not after 0 s of the row before; .* digits"),
        ((300, 200, 100), "time_ms of row 2 is 0.2 s, not after 0.3 s .* put the rows in order"),
        ((-20, 0, 20), "time_ms of row 1 is -0.02 s, before the start of the recording; count"),
    ],
)
def test_times_that_do_not_grow_are_told_with_what_they_are(
    times: tuple[float, ...], said: str, tmp_path: Path
) -> None:
    read = table(tmp_path, "time_ms,P_N,Q_N\n" + "".join(f"{t},0.5,0.1\n" for t in times))
    with pytest.raises(UserError, match=said):
        text_tables.clock_samples(read, 1000.0)


def test_separators_at_the_end_of_rows_are_no_cells(tmp_path: Path) -> None:
    read = table(tmp_path, "time_s;P_N;Q_N\n0;0,5;0,1;\n1;0,5;0,2;;\n")
    assert read.numbers["q"].tolist() == [0.1, 0.2]
    with pytest.raises(UserError, match="row 2 has 4 cells, the header 3"):
        table(tmp_path, "time_s;P_N;Q_N\n0;0,5;0,1;\n1;0,5;0,2;7\n")


def test_a_header_may_name_a_last_column_without_cells(tmp_path: Path) -> None:
    """As LabVIEW writes it."""
    head = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n"
    rows = "".join(f"0,0{n}\t0,5\t0,{n}\n" for n in range(8))
    text = head + "X_Value\tFn [N]\tFt [N]\tComment\n" + rows
    read = table(tmp_path, text, "time_s=X_Value")
    assert read.header == ("X_Value", "Fn [N]", "Ft [N]")
    assert read.numbers["time"].tolist() == [n / 100 for n in range(8)]


def test_a_header_with_another_name_too_many_is_not_used(tmp_path: Path) -> None:
    """Its names do not stand above their columns, and the first may be the odd one."""
    rows = "".join(f"0.{n};0.5;0.0{n};0.2\n" for n in range(8))
    head = "run;time_s;P_N;Q_N;travel_um\n"
    with pytest.raises(UserError, match="row 1 has 4 cells, the header 5"):
        table(tmp_path, head + rows)
    assert table(tmp_path, "Bench 3\n" + head + rows).header == ("1", "2", "3", "4")


def test_seconds_since_1970_have_their_rate(tmp_path: Path) -> None:
    times = (f"2026-11-27T10:00:00.{20 * n:06d},0.5,0.1\n" for n in range(2000))
    forces = table(tmp_path, "time_s,P_N,Q_N\n" + "".join(times))
    assert rate_of(Sources(images=[]), set(), forces) == 50_000


@pytest.mark.parametrize(
    ("frame_rate", "rate_hz"), [(8.0, 1000), (5.0, 500), (12.3, 500), (None, 500)]
)
def test_the_period_of_the_images_is_a_whole_number_of_samples(
    frame_rate: float | None, rate_hz: int, tmp_path: Path
) -> None:
    forces = table(tmp_path, "time_s,P_N,Q_N\n" + "".join(f"{n / 500},0,0\n" for n in range(99)))
    assert rate_of(Sources(images=[], frame_rate=frame_rate), set(), forces) == rate_hz


def test_a_multiple_of_a_fast_rate_is_not_taken(tmp_path: Path) -> None:
    """Settings allow 100 kHz, and all samples are stored."""
    for rate_hz, taken in ((50_000, 50_000), (5000, 5000), (2000, 6000)):
        rows = "".join(f"{n / rate_hz:.6f},0,0\n" for n in range(99))
        forces = table(tmp_path, f"time_s,P_N,Q_N\n{rows}")
        assert rate_of(Sources(images=[], frame_rate=30.0), set(), forces) == taken


def test_a_minus_turns_the_sign_of_a_column(tmp_path: Path) -> None:
    text = "time_s,P_N,Ft,-x\n0,-0.5,100,1\n1,-0.5,200,2\n"
    read = table(tmp_path, text, "P_N=-P_N, Q_mN=- Ft")
    assert read.numbers["p"].tolist() == [0.5, 0.5]
    np.testing.assert_allclose(read.numbers["q"], [-0.1, -0.2])
    assert table(tmp_path, text, "Q_N=-x").numbers["q"].tolist() == [1.0, 2.0]  # its own name


def images(folder: Path, names: list[str]) -> Path:
    rng = np.random.default_rng(1)
    folder.mkdir()
    for name in names:
        cv2.imwrite(str(folder / name), rng.integers(0, 255, (64, 80)).astype(np.uint8))
    return folder


def read(folder: Path, **given: object) -> Understood:
    names = [f"{n}.png" for n in range(12)]
    where = images(folder / "images", names)
    few = ("camera.exposure=1", "stress.method=none", "dic.box=16")
    return understood(Sources(images=[where], pixel_um=10, overrides=few, **given))  # type: ignore[arg-type]


def forces(folder: Path, header: str, rows: list[str]) -> Path:
    path = folder / "forces.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    return path


def test_rows_without_times_are_those_of_a_given_rate(tmp_path: Path) -> None:
    values = [f"{0.5 * (n > 100):g},{max(0.0, n - 300) / 1000:g}" for n in range(600)]
    path = forces(tmp_path, "P_N,Q_N", values)
    found = read(tmp_path, frame_rate=5.0, rate_hz=200, forces=path)
    assert found.config.forces.sample_rate == 200
    assert len(found.measured.volts) == 600
    assert f"{path}: its rows have no times; they are taken at 200 Hz" in found.remarks
    (tmp_path / "again").mkdir()
    with pytest.raises(UserError, match="or --rate HZ if the rows are evenly spaced"):
        read(tmp_path / "again", frame_rate=5.0, forces=path)


def test_images_and_forces_with_times_of_day_are_on_one_clock(tmp_path: Path) -> None:
    rows = [
        f"14:03:{7 + n / 100:05.2f},{0.5 * (n > 50):g},{max(0, n - 150) / 1e3:g}"
        for n in range(300)
    ]
    path = forces(tmp_path, "Uhrzeit,P_N,Q_N", rows)
    times = tmp_path / "times.csv"
    lines = [f"{n}.png,14:03:{7.5 + n / 5:05.2f}" for n in range(12)]
    times.write_text("\n".join(["file,time", *lines]), encoding="utf-8")
    found = read(tmp_path, metadata=times, forces=path)
    rate = found.config.forces.sample_rate
    assert [frame.sample for frame in found.frames] == [
        round((0.5 + n / 5) * rate) for n in range(12)
    ]
    assert any("sample 0 is at 50587 s of the images' clock" in one for one in found.remarks)


def test_times_of_day_of_images_alone_are_counted_from_the_first(tmp_path: Path) -> None:
    times = tmp_path / "times.csv"
    lines = [f"{n}.png,2026-11-12 14:03:{7 + n / 5:04.1f}" for n in range(12)]
    times.write_text("\n".join(["file,time", *lines]), encoding="utf-8")
    found = read(tmp_path, metadata=times)
    rate = found.config.forces.sample_rate
    assert [frame.sample for frame in found.frames] == [round(n / 5 * rate) for n in range(12)]
    assert any("sample 0 is at 1794492187 s of the clock of" in one for one in found.remarks)


def test_a_row_of_forces_without_a_time_is_named(tmp_path: Path) -> None:
    path = forces(tmp_path, "time_s,P_N,Q_N", ["0,0.1,0", "NaN,0.1,0", "0.2,0.1,0"])
    with pytest.raises(UserError, match=r"forces.csv, row 2: time_s is empty .* give each row"):
        read(tmp_path, frame_rate=5.0, forces=path)


def test_a_picture_of_windows_is_read(tmp_path: Path) -> None:
    (page,) = pictures_of([images(tmp_path / "a", ["1.bmp"])])
    (same,) = pictures_of([images(tmp_path / "b", ["1.png"])])
    np.testing.assert_array_equal(read_image(page), read_image(same))
    content = bytearray(page.path.read_bytes())
    content[18:26] = b"\xff\xff\x00\x00\xff\xff\x00\x00"
    page.path.write_bytes(content)
    with pytest.raises(UserError, match="65535 x 65535 px, which takes"):
        read_image(page)


def test_films_and_lossy_pictures_are_told_what_to_become(tmp_path: Path) -> None:
    folder = images(tmp_path / "a", ["1.jpg", "2.jpg"])
    with pytest.raises(
        UserError, match=r"it has 2 files \*\.jpg; convert pictures to PNG.* ffmpeg -i FOLDER"
    ):
        pictures_of([folder])
    with pytest.raises(UserError, match=r"not an image that can be read;.* ffmpeg"):
        read_image(folder / "1.jpg")


def test_an_image_that_is_named_twice_is_that_of_the_first_frame(tmp_path: Path) -> None:
    """Wherever the table lies: it was told not to be there, or taken for both."""
    names = [f"{n}.png" for n in range(12)]
    for place in (tmp_path / "times.csv", tmp_path / "images" / "times.csv"):
        folder = place.parent
        if not (tmp_path / "images").exists():
            images(tmp_path / "images", names)
        rows = [f"{names[max(0, n - 1)]},{n / 5}" for n in range(12)]
        place.write_text("\n".join(["file,time_s", *rows]), encoding="utf-8")
        found = understood(Sources(images=[tmp_path / "images"], metadata=place, pixel_um=10))
        assert found.frames[0].path, folder
        assert (found.frames[1].path, found.frames[1].reason) == (
            None,
            "'0.png' is the image of frame 0",
        )
        assert any("1 image that" in one and "the first: 11.png" in one for one in found.remarks)


def test_a_grey_picture_with_an_opaque_fourth_channel_is_grey(tmp_path: Path) -> None:
    grey = np.random.default_rng(1).integers(0, 60000, (20, 30)).astype(np.uint16)
    path = tmp_path / "a.png"
    for alpha, colour in ((65535, 0), (65534, 0), (65535, 1)):
        channels = [grey, grey, grey + np.uint16(colour), np.full_like(grey, alpha)]
        cv2.imwrite(str(path), np.dstack(channels))
        if (alpha, colour) == (65535, 0):
            np.testing.assert_array_equal(read_image(path), grey)
        else:
            with pytest.raises(UserError, match="a colour image"):
                read_image(path)


def test_options_that_mean_nothing_are_told_as_such(tmp_path: Path) -> None:
    path = forces(tmp_path, "time_s,P_N,Q_N", [f"{n / 100},0.1,0" for n in range(240)])
    for given, said in (
        ({"offset_s": float("nan"), "forces": path}, "--time-offset: nan is no number of seconds"),
        ({"pixel_um": -1}, "^options: camera.pixel must be .* found -1"),
    ):
        where = Sources(**({"images": [images(tmp_path / said[:9], ["0.png", "1.png"])],
                            "pixel_um": 10, "frame_rate": 5.0,
                            "overrides": ("camera.exposure=1", "dic.box=16")} | given))  # fmt: skip
        with pytest.raises(UserError, match=said):
            understood(where)
