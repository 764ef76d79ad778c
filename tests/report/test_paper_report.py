"""`slipscope figures`: the folder that it makes, the report, the same bytes, and bad input."""

from __future__ import annotations

import html
import json
import math
import re
import shutil
import subprocess
from dataclasses import fields, replace
from itertools import chain
from pathlib import Path
from typing import Any

import closed_form as exact
import pytest
from command_line import call
from made_once import made_once
from results_files import write_results

from app.files.text_tables import FORCE, LENGTH, read_table
from app.records.summary import Summary
from app.report.document import WIDE, DocumentTable, Heading, as_html
from app.report.typeset import in_html, in_unicode


def run(*arguments: object) -> tuple[int, str]:
    result = call("figures", *arguments)
    return result.exit_code, " ".join(result.output.split())


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("results") / "results.h5"
    write_results(path, exact.campaign())
    return path


@pytest.fixture(scope="module")
def folder(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    def make(path: Path) -> Path:
        code, told = run(file, "-o", path, "--format", "png")
        assert code == 0, told
        assert "22 figures, summary.json, report.html, report.md" in told
        return path

    return made_once(tmp_path_factory, "paper", make)


@pytest.fixture(scope="module")
def data(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.slow
def test_a_newcomer_finds_every_figure_with_its_data(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    figures = {f"fig{n:02d}" for n in (1, 2, 3, 5, 7, 8, 9, 10, 11, 12, 13, 14, 15)}
    figures |= {"fig04", "fig04d", "fig06a", "fig06b"}
    figures |= {"pressure", "stiffness", "law", "dissipation", "budget"}
    for name in figures:
        assert f"{name}.png" in names
        assert any(re.fullmatch(rf"{name}(_inset|[a-d])?\.csv", one) for one in names)
    others = {n for n in names if not any(n.startswith(name) for name in figures)}
    assert others == {"summary.json", "report.html", "report.md"}
    assert (folder / "fig05.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_every_figure_is_drawn_in_every_format(file: Path, folder: Path, tmp_path: Path) -> None:
    code, told = run(file, "-o", tmp_path / "all", "--format", "pdf", "svg", "eps")
    assert code == 0, told
    names = {path.stem for path in folder.glob("*.png")}
    for kind in ("pdf", "svg", "eps"):
        assert {path.stem for path in (tmp_path / "all").glob(f"*.{kind}")} == names


def test_tables_are_read_by_the_names_that_the_program_knows(folder: Path) -> None:
    table = read_table(folder / "fig05.csv", {"p": FORCE, "q": FORCE, "delta": LENGTH})
    assert table.units == {"p": "n", "q": "n", "delta": "um"}
    assert table.numbers["q"].max() == pytest.approx(exact.MU * 0.7)


@pytest.mark.parametrize(
    ("plain", "shown"),
    [
        ("mu_s and <mu_d>", "μ<sub>s</sub> and ⟨μ<sub>d</sub>⟩"),
        ("sigma_xz/(mu p) < 1", "σ<sub>xz</sub>/(μ p) &lt; 1"),
        ("chi2, sqrt(R h) in um", "χ², √(R h) in µm"),
        ("(1 - Q)^(1/3), P^-n, -0.5", "(1 - Q)<sup>1/3</sup>, P<sup>−n</sup>, −0.5"),
        ("sim.mu of run_1.h5, 2026-11-26", "sim.mu of run_1.h5, 2026-11-26"),
    ],
)
def test_symbols_are_printed_as_symbols_and_names_as_they_are(plain: str, shown: str) -> None:
    assert in_html(plain) == shown


@pytest.mark.slow
def test_the_same_results_are_the_same_bytes(file: Path, folder: Path, tmp_path: Path) -> None:
    """Also where they replace others, and whichever other figures there are."""
    out = tmp_path / "paper"
    vectors = ("--only", "2", "6a", "budget", "--format", "svg", "pdf")
    assert run(file, "-o", out, *vectors)[0] == 0
    first = {path.name: path.read_bytes() for path in out.iterdir()}
    assert {"fig02.svg", "fig02.pdf", "fig06a.svg", "budget.svg", "report.html"} <= set(first)
    for path in out.iterdir():
        path.write_bytes(b"of others")
    out = out.rename(tmp_path / "renamed")
    assert run(file, "-o", out, *vectors, "--overwrite")[0] == 0
    assert {path.name: path.read_bytes() for path in out.iterdir()} == first
    assert run(file, "-o", out, "--only", "2", "6a", "--format", "png", "--overwrite")[0] == 0
    again = [path for path in folder.iterdir() if re.match("fig0(2|6a)", path.name)]
    assert len(again) >= 4
    for path in again:
        assert (out / path.name).read_bytes() == path.read_bytes()


UNITS = {"MPa": 1e6, "um": 1e-6, "mm": 1e-3, "kPa": 1e3, "kPa/um": 1e9, "uJ": 1e-6, "um/N": 1e-6,
         "um/s": 1e-6}  # fmt: skip
SHOWN = {  # the units in which the report shows what JSON holds in SI units
    "_pa": "MPa", "apparent_radius_m": "mm", "hertz_radius_m": "mm", "lens_radius_m": "mm",
    "thickness_m": "mm", "pressure_pa": "kPa", "_pa_m": "kPa/um", "_m": "um", "_j": "uJ",
    "_m_n": "um/N", "_m_s": "um/s", "_n_m": "N/m",
}  # fmt: skip


def shown(key: str, value: float) -> float:
    ending = max((e for e in SHOWN if key.endswith(e)), key=len, default="")
    return value / UNITS.get(SHOWN.get(ending, ""), 1.0)


def texts_of(key: str, number: dict[str, Any], line: str) -> None:
    """The line of a report has this number and its uncertainties, rounded to what they tell."""
    numbers = [float(x) for x in re.findall(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?", line)]
    for part in ("value", "sd", "sd_noise", "sd_inputs"):
        if (value := number[part]) is None or (part != "value" and not value):
            continue
        wanted = shown(key, value)
        near = min(numbers, key=lambda one: abs(one - wanted))
        scale = abs(wanted) if part == "value" else max(abs(wanted), 0.1 * abs(near))
        assert near == pytest.approx(wanted, abs=0.06 * scale + 1e-12), (key, part, line)
    if (paper := number.get("paper")) is not None:
        assert any(math.isclose(x, shown(key, paper["value"]), rel_tol=1e-3) for x in numbers), key


@pytest.mark.parametrize("kind", ["md", "html"])
def test_the_report_holds_every_number_of_the_summary(
    folder: Path, data: dict[str, Any], kind: str
) -> None:
    text = (folder / f"report.{kind}").read_text(encoding="utf-8").replace("\N{MINUS SIGN}", "-")
    lines = re.sub(r"\\(.)", r"\1", text).splitlines()
    if kind == "html":
        lines = [re.sub(r"<sup>([^<]*/[^<]*)</sup>", r"^(\1)", line) for line in lines]
        lines = [line.replace("<sup>", "^").replace("<sub>", "_") for line in lines]
        lines = [re.sub("</su[bp]>", "", line) for line in lines]
        lines = [html.unescape(re.sub("<[^>]+>", " | ", line)) for line in lines]
    groups = [data["inputs"], data["joint"]["numbers"], *(r["numbers"] for r in data["runs"])]
    assert sum(map(len, groups)) > 90
    for group in groups:
        for key, number in group.items():
            if number["value"] is None:
                continue
            name = in_unicode(number["name"])
            own = [line for line in lines if name in line and "|" in line]
            assert own, key
            if (bound := number.get("not_resolved_upper_bound")) is not None:
                assert number["value"] <= 2 * number["sd"]
                told = f"within ± {shown(key, bound):g}"
                assert any(f"not resolved, {told}" in line for line in own), (key, told)
                continue
            texts_of(key, number, " ".join(own))
    for one in data["runs"]:
        for number in one["numbers"].values():
            for share in number.get("budget", {}).values():
                assert f"{100 * share:+.3f}" in text or share == 0
    for item, value in data["correlation"].items():
        assert any(item in line and in_unicode(value) in line for line in lines), item
    for one in data["figures"].values():
        assert any(in_unicode(one["caption"]) in line for line in lines), one["caption"]


def test_uncertainties_are_those_of_their_names(data: dict[str, Any]) -> None:
    """Those of all runs together are of noise and inputs at once; they were called noise, and the
    inputs of E/E_w too.
    """
    common, joint = exact.campaign().joint, data["joint"]["numbers"]
    for key, sd in (("law_mu", common.mu_sd), ("law_length_m", common.length_sd_m)):
        assert (joint[key]["sd_noise"], joint[key]["sd_inputs"]) == (None, None)
        assert joint[key]["sd"] == pytest.approx(sd)
    spent = [number for run in data["runs"] for number in run["numbers"].values()
             if "budget" in number and number["value"]]  # fmt: skip
    assert {"E over that from the width", "static friction"} <= {one["name"] for one in spent}
    for one in spent:
        by_inputs = abs(one["value"]) * math.hypot(*one["budget"].values())
        assert one["sd_inputs"] == pytest.approx(by_inputs), one["name"]
        both = math.hypot(one["sd_noise"] or 0.0, by_inputs)
        assert one["sd"] == pytest.approx(both), one["name"]


def test_the_printed_report_leaves_nothing_out(folder: Path) -> None:
    """In print a table has no scroll bar: it is as wide as the page, which lies across for wide
    ones, together with their headings.
    """
    text = (folder / "report.html").read_text(encoding="utf-8")
    printed = text[text.index("@media print") : text.index("</style>")]
    assert "table { display: table; overflow: visible;" in printed
    assert "figure { break-inside: avoid; }" in printed
    assert "h3 { break-after: avoid; }" in printed
    assert ".wide { page: wide; }" in printed
    assert "@page wide { size: A4 landscape; }" in text
    assert ".as-printed { width: calc(var(--mm) * 1mm); }" in printed
    assert set(re.findall(r"--mm: (\d+)", text)) == {"88", "180"}
    tables = re.findall(r"(<h\d[^>]*>[^\n]*)?\n?<table([^>]*)>\n<thead><tr>(.*?)</tr>", text)
    assert len(tables) > 5
    for heading, kind, header in tables:
        is_wide = header.count("<th>") >= WIDE
        assert ('class="wide"' in kind) == is_wide
        assert not heading or ('class="wide"' in heading) == is_wide
    assert re.search(r"\d\N{NO-BREAK SPACE}±\N{NO-BREAK SPACE}\d", text)


def test_what_leads_to_a_wide_table_is_printed_beside_it() -> None:
    """Else the heading is left alone at the end of the page before."""
    wide, narrow = (DocumentTable(tuple("abcdefgh"[:n]), (tuple("12345678"[:n]),)) for n in (8, 3))
    text = as_html(
        [Heading(2, "A"), narrow, "of A", Heading(2, "B"), "to B", Heading(3, "b"), wide, "of b"]
    )
    marks = re.findall(r'<(?:h\d|p|table)[^>]*?( class="wide")?>', text)
    assert [bool(mark) for mark in marks] == [False] * 3 + [True] * 4 + [False]


@pytest.mark.skipif(
    not (shutil.which("chromium") and shutil.which("pdftotext")), reason="needs a browser"
)
def test_a_browser_prints_every_column_of_a_wide_table(tmp_path: Path) -> None:
    """As many inputs as a run has: no column is cut, and no word of a header is broken."""
    page, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    inputs = ["roughness", "distortion", "averaging", "sensitivity", "Poisson's ratio"] * 3
    rows = [tuple(f"{row}.{n:02d}5" for n in range(16)) for row in range(10, 30)]
    table = DocumentTable(("", *inputs), tuple(rows))
    page.write_text(as_html([Heading(3, "What each input costs"), table]), encoding="utf-8")
    browser = ["chromium", "--headless", "--no-sandbox", "--disable-gpu"]
    subprocess.run(
        [*browser, f"--print-to-pdf={pdf}", page.as_uri()], check=True, capture_output=True,
        timeout=300,
    )  # fmt: skip
    told = subprocess.run(
        ["pdftotext", "-layout", str(pdf), "-"], check=True, capture_output=True, timeout=100
    )
    printed = told.stdout.decode()
    for cell in (*chain(*rows), *inputs[:4]):
        assert cell in printed


def test_the_summary_is_what_the_results_say(data: dict[str, Any]) -> None:
    lightest = data["runs"][0]
    assert lightest["session"] == "load-0.1.h5"
    assert lightest["sample"] == "PDMS <7>"
    E = lightest["numbers"]["young_modulus_pa"]
    assert E["value"] == exact.STATED_E
    assert E["sd_inputs"] == pytest.approx(exact.STATED_E * math.hypot(0.0099, 0.004))
    assert E["budget"] == {"pixel size": -0.0099, "shear force": 0.004}
    assert E["paper"] == {"value": 3.43e6, "sd": 0.05e6, "where": "JKR test, section 2.2"}
    k = lightest["numbers"]["stiffness_at_25_kpa_pa_m"]["value"]
    assert k == pytest.approx(25e3 / exact.LENGTH)
    # the paper gives Hertz's radius at 0.3 N only
    assert "paper" not in lightest["numbers"]["hertz_radius_m"]
    assert data["runs"][1]["numbers"]["hertz_radius_m"]["paper"]["value"] == 1.857e-3
    work = lightest["numbers"]
    whole = work["work_of_traction_j"]["value"]
    assert whole == pytest.approx(work["work_of_forces_j"]["value"], rel=0.01)
    bureau = data["joint"]["numbers"]["bureau_length_m"]
    assert bureau["value"] == pytest.approx(1.5 * 0.595e-6)
    assert bureau["paper"]["value"] == 0.89e-6


def test_no_number_of_a_run_is_forgotten(data: dict[str, Any]) -> None:
    numbers = {f.name for f in fields(Summary) if f.type == "float"}
    values = {name for name in numbers if "_sd" not in name} | {"calibration_sd"}
    assert len(values) == 15
    for run in data["runs"]:
        assert values <= set(run["numbers"])
        own = exact.run_of(run["numbers"]["normal_force_n"]["value"]).summary
        for name in values:
            expected = getattr(own, name)  # null where nothing ages
            found = run["numbers"][name]["value"]
            assert found == (
                pytest.approx(expected, rel=1e-12) if math.isfinite(expected) else None
            )


def test_the_page_needs_nothing_else(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    sources = re.findall(r'src="([^"]{0,22})', page)
    assert len(sources) == 22
    assert set(sources) == {"data:image/png;base64,"}
    places = re.findall(r' id="([^"]+)"', page)
    assert len(set(places)) == len(places)
    links = re.findall(r'href="([^"]*)"', page)
    assert {link[1:] for link in links if link[0] == "#"} <= set(places)
    assert all((folder / link).is_file() for link in links if link[0] != "#")
    assert "fig05.csv" in links
    chapters = re.findall(r'<h2 id="([^"]+)"', page)
    assert chapters[0] == "all-loads-together"
    assert chapters[-1] == "made-with"
    assert {f"#{place}" for place in chapters} <= set(links)
    assert not re.search(r"<script|@import|url\(", page)
    assert "PDMS &lt;7&gt;" in page
    assert "PDMS <7>" not in page
    markdown = (folder / "report.md").read_text(encoding="utf-8")
    assert r"note: a \| b" in markdown
    headings = re.findall(r"^#+ (.*)$", markdown, re.MULTILINE)
    # as GitHub names them
    places = [re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings]
    for link in re.findall(r"\]\((.+?)\)", markdown):
        assert link[1:] in places if link[0] == "#" else (folder / link).exists()


def test_the_guide_is_answered(data: dict[str, Any]) -> None:
    table = data["correlation"]
    assert table["image size"] == "320 x 240 px, 8 bit"
    assert table["field of view"] == "2.25 mm x 1.69 mm"
    assert table["frame rate"].startswith("8 images/s")
    assert table["exposure"].startswith("10 ms")
    assert table["subset (box) size"] == "20 px (141 µm)"
    assert table["step"] == "10 px (70 µm)"
    assert table["displacement noise floor"].startswith("0.0060 px (42 nm)")
    assert table["lens, focal length, aperture"] == "not recorded"
    assert "maker and model not recorded" in table["camera"]


def test_a_figure_that_can_not_be_drawn_is_left_out_in_words(tmp_path: Path) -> None:
    path = tmp_path / "short.h5"
    write_results(path, replace(exact.campaign(), runs=(exact.run_of(0.3, slides=False),)))
    only = ("--only", "7", "8", "law", "budget", "--format", "png")
    code, told = run(path, "-o", tmp_path / "paper", *only)
    assert code == 0
    assert "left out: figure 8, no run reached steady sliding" in told
    assert " 1 figure, " in told
    names = {p.name for p in (tmp_path / "paper").iterdir()}
    assert "fig07.png" in names
    assert not any(name.startswith(("fig08", "law", "budget")) for name in names)
    page = (tmp_path / "paper" / "report.html").read_text(encoding="utf-8")
    assert "Left out: no run reached steady sliding" in page


def refused(*arguments: object) -> str:
    code, told = run(*arguments)
    assert code == 2, told
    assert told.count("slipscope: ") == 1
    assert "Traceback" not in told
    return told


def test_bad_input_is_one_sentence(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper"
    assert "there is no such file" in refused(tmp_path / "none.h5", "-o", out)
    assert "figure 99: there is no such figure; use 1, 2, 3, 4, 4d" in refused(
        file, "-o", out, "--only", "5", "99"
    )
    assert "--format gif: not known; use png, pdf, svg" in refused(
        file, "-o", out, "--format", "gif"
    )
    text = tmp_path / "notes.h5"
    text.write_text("no results")
    assert str(text) in refused(text, "-o", out)
    assert "does not exist" in refused(file, "-o", tmp_path / "no" / "paper")
    assert not out.exists()


@pytest.mark.slow
def test_a_folder_with_other_things_is_left_alone(file: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    only = ("-o", tmp_path, "--only", "15", "--format", "svg")
    assert "the folder is not empty" in refused(file, *only)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    assert run(file, *only, "--overwrite")[0] == 0
    assert (tmp_path / "thesis.tex").read_text() == "mine"
    assert (tmp_path / "fig15.svg").exists()
    assert run(file, "-o", tmp_path, "--only", "5", "--overwrite")[0] == 0
    names = {p.name for p in tmp_path.iterdir()}
    assert {"fig05.png", "fig05.pdf", "fig15.svg", "thesis.tex"} <= names  # other figures stay
    assert (tmp_path / "fig05.pdf").read_bytes().startswith(b"%PDF")
    assert run(file, "-o", tmp_path, "--only", "5", "--format", "svg", "--overwrite")[0] == 0
    assert not (tmp_path / "fig05.png").exists()


def test_results_without_the_load_are_refused(tmp_path: Path) -> None:
    one = exact.run_of(0.3)
    path = tmp_path / "unloaded.h5"
    unloaded = replace(one, summary=replace(one.summary, normal_force_n=math.nan))
    write_results(path, replace(exact.campaign(), runs=(unloaded,)))
    told = refused(path, "-o", tmp_path / "paper")
    assert "none of its 1 runs has a normal force" in told
    write_results(path, replace(exact.campaign(), runs=()), overwrite=True)
    assert "it holds no run" in refused(path, "-o", tmp_path / "paper")


def test_one_document_for_programs(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper"
    brief = ("--only", "2", "15", "budget", "--format", "png")
    result = call("figures", file, "-o", out, *brief, "--json")
    told = json.loads(result.stdout)
    assert told == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert list(told["figures"]) == ["2", "15", "budget"]
    again = call("figures", file, "-o", out, "--json")
    assert "not empty" in json.loads(again.stdout)["error"]
