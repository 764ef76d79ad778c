"""The result card: every number with both parts of its uncertainty, and how the run ended."""

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest
from PySide6.QtGui import QGuiApplication
from scripted_run import ScriptedRun
from window_hands import click, look

from app.evaluation.timeline import Mark, Timeline
from app.gui.cells import typeset
from app.gui.result_panel import ResultPanel
from app.gui.source import setup_of
from app.gui.view_state import read, resolve
from app.records.record_types import NOTE, Counts, End, Outcome
from app.records.summary import Summary
from app.report.card import card_of
from app.runs.run_source import Kind

COUNTS = Counts(120, 118, 118, 2, 100, 18, 14000, 60)
SUMMARY = Summary(
    *(0.5, 2.2046e-3, 0.0413e-3, 2.19412e-3, 20.234, 0.0996, 0.46311, 0.92622, 0.0042, 0.93011),
    (0.9214, 0.9388),
    4.8312e-6,
    ("law: too few frames",),
    young_modulus_pa=3.421e6,
    young_modulus_sd_pa=0.0321e6,
    calibration_sd=0.0077,
    budget_inputs=("pixel size", "shear force"),
    budget_quantities=("apparent_radius", "young_modulus"),
    budget=(0.003, 0.004, 0.0, 0.003),
)
DONE = Outcome(End.COMPLETE, "the drive of 190 um is complete", COUNTS, SUMMARY)


@pytest.fixture
def panel(qtbot):
    panel = ResultPanel()
    qtbot.addWidget(panel)
    panel.resize(700, 500)
    panel.show()
    return panel


def cells(panel):
    table = panel.table
    return {
        table.item(k, 0).text(): [table.item(k, j).text() for j in range(2, 5)]
        for k in range(table.rowCount())
    }


def tooltip(panel, name):
    table = panel.table
    rows = [k for k in range(table.rowCount()) if table.item(k, 0).text() == name]
    return table.item(rows[0], 2).toolTip()


@pytest.mark.parametrize("width", [300, 420, 700])
def test_the_name_of_no_quantity_is_cut_short(qtbot, panel, width):
    panel.show_card(card_of("a run", DONE, 3, is_live=True))
    panel.resize(width, 500)
    table = panel.table
    rows = range(table.rowCount())
    qtbot.waitUntil(lambda: all(table.rowHeight(k) >= table.sizeHintForRow(k) for k in rows))


def test_every_quantity_has_its_total_uncertainty_and_both_parts_under_the_pointer(panel):
    panel.show_card(card_of("a run", DONE, 3, is_live=True))
    shown = cells(panel)
    assert len(shown) == 11
    # 0.5 % of 3.421 MPa by two inputs, 0.4 and 0.3 %
    assert shown["Young's modulus from the stress"] == ["3.42", "0.04", "MPa"]
    parts = tooltip(panel, "Young's modulus from the stress").splitlines()
    assert parts[1:3] == ["by noise 0.032 MPa", "by the inputs 0.017 MPa"]
    assert [part.split() for part in parts[3:]] == [
        ["pixel", "size:", "1", "σ", "more", "changes", "it", "by", "+0.4", "%"],
        ["shear", "force:", "1", "σ", "more", "changes", "it", "by", "+0.3", "%"],
    ]
    assert shown["apparent radius"] == ["2.20", "0.04", "mm"]
    assert tooltip(panel, "apparent radius").splitlines()[:3] == [
        "a (seen): radius of the contact's edge in the images",
        "by noise 0.041 mm",
        "by the inputs 0.0066 mm",
    ]
    # mu_s has no budget here: its part by the inputs is that of the sensors, 0.77 % of 0.926
    assert shown["static friction"] == ["0.926", "0.008", ""]
    static = tooltip(panel, "static friction").splitlines()
    assert static[1:] == ["by noise 0.0042", "by the inputs 0.0071"]
    assert shown["dynamic friction"][1] == "0.9214–0.9388"
    assert shown["length of the local law"] == ["–", "–", "µm"]


def test_a_large_share_of_an_input_has_no_exponent(panel):
    dear = replace(DONE.summary, budget=(0.003, 1.25, 0.0, -1.4))
    panel.show_card(card_of("a run", replace(DONE, summary=dear), is_live=True))
    parts = tooltip(panel, "Young's modulus from the stress").splitlines()
    assert [part.split()[-2] for part in parts if "σ more" in part] == ["−140", "+120"]


def test_a_length_that_is_not_resolved_is_told_so(panel):
    unresolved = replace(DONE.summary, law_length_m=0.03e-6, law_length_sd_m=0.05e-6)
    panel.show_card(card_of("a run", replace(DONE, summary=unresolved), is_live=True))
    shown = cells(panel)["length of the local law"]
    assert shown == ["not resolved, below 0.2", "–", "µm"]


NO_LAW = (
    "local law: traction against slip does not follow mu p (1 - exp(-s/(mu L))): the points lie 2.4"
    " times their uncertainty off it"
)


def test_a_law_that_does_not_hold_is_told_above_the_numbers(panel):
    doubted = replace(DONE.summary, notes=("law: too few frames", NO_LAW))
    card = card_of("a run", replace(DONE, summary=doubted), is_live=True)
    panel.show_card(card)
    assert panel.doubt.isVisible()
    assert "does not follow" in panel.doubt.text()
    assert "does not follow" not in panel.notes.text()
    assert "Note: law: too few frames" in panel.notes.text()
    assert (
        f"WARNING: {NO_LAW}\n"
        in card_of("a run", replace(DONE, summary=doubted), is_live=True).text()
    )
    panel.show_card(card_of("a run", DONE, 3, is_live=True))
    assert not panel.doubt.isVisible()


def test_the_account_and_the_notes_stand_beside_them(panel):
    panel.show_card(card_of("a run", DONE, 3, is_live=True))
    notes = panel.notes.text()
    for told in (
        "118 received, 118 recorded, 2 lost",
        "115 certain, 3 uncertain",
        "14000 recorded, 60 lost",
        "Note: law: too few frames",
    ):
        assert told in notes


@pytest.mark.parametrize(
    ("end", "reason", "word"),
    [
        (End.COMPLETE, "the drive of 190 um is complete", "COMPLETE"),
        (End.STOPPED, "STOP MOTION was pressed", "STOPPED"),
        (End.FAILED, "camera: no image for 3 s", "FAILED"),
    ],
)
def test_the_verdict_tells_complete_stopped_and_failed_apart(panel, end, reason, word):
    outcome = replace(DONE, end=end, reason=reason)
    panel.show_card(card_of("a run", outcome, is_live=True))
    assert panel.verdict.text() == word
    assert typeset(reason)[1:] in panel.notes.text()


def test_the_card_is_copied_as_text_and_as_a_table(qtbot, panel):
    panel.show_card(card_of("a run", DONE, is_live=True))
    click(qtbot, panel.copy_text)
    text = QGuiApplication.clipboard().text()
    assert text.startswith("a run: complete (the drive of 190 um is complete)\n")
    assert "static friction\tmu_s\t0.926\t0.0042\t0.0071" in text
    click(qtbot, panel.copy_csv)
    rows = list(csv.DictReader(io.StringIO(QGuiApplication.clipboard().text())))
    modulus = next(row for row in rows if row["symbol"] == "E")
    assert float(modulus["value"]) == 3.421
    assert float(modulus["sd_inputs"]) == pytest.approx(3.421 * 0.005, rel=1e-6)
    assert next(row for row in rows if row["symbol"] == "L")["value"] == ""
    assert len(rows) == 11


def test_what_the_operator_noted_is_in_the_result_and_the_forces_of_a_recorded_run(panel):
    run = ScriptedRun(320, 240, frames=60)
    run.start()
    start = 3000  # REFERENCE frames of PERIOD samples, at 1 kHz
    marks = (Mark(start + 1250, NOTE, "the door"), Mark(start + 2000, "stop", "the end"))
    one = np.array([0])
    line = Timeline(one, one, one == 0, 1000.0, 10, start, 7500, (), marks)
    setup = replace(setup_of(run), timeline=line, kind=Kind.REPLAY)
    view = resolve(setup, read(run.at(60), 0), None)
    panel.show_setup(setup)
    panel.show_card(card_of("run", DONE, is_live=False))
    assert "At t = 1.25 s: the door" in panel.notes.text()
    assert "the end" not in panel.notes.text()
    (guide,) = (one for one in view.charts["forces"].guides if one.text == "the door")
    assert guide.is_upright
    assert guide.value == pytest.approx(1.25, abs=0.02)
    panel.show_setup(setup_of(run))  # the next run has none
    panel.show_card(card_of("run", DONE, is_live=True))
    assert "the door" not in panel.notes.text()


def test_until_the_end_the_settings_are_shown(panel):
    run = ScriptedRun(320, 240, frames=60).at(30)
    view = look(run)
    panel.show_view(view)
    assert panel.heading.text() == "Settings of the run"
    assert cells(panel)["velocity"][0] == "5"
    assert not panel.copy_text.isEnabled()
    run.at(60)
    view = look(run, view)
    panel.show_view(view)
    assert panel.heading.text() == "Result"
    assert panel.copy_text.isEnabled()
    assert view.card.verdict == "complete"
    assert math.isnan(view.outcome.summary.young_modulus_pa)


@pytest.mark.parametrize(
    ("plain", "proper"),
    [
        ("u_x of 5 um, mu_s = -0.5 by 12 uJ", "uₓ of 5 µm, μₛ = −0.5 by 12 µJ"),
        ("the number of columns, sigma(r) from 2-3", "the number of columns, σ(r) from 2-3"),
        ("run-2.h5 of 2026-11-23, t_s", "run-2.h5 of 2026-11-23, tₛ"),
    ],
)
def test_sentences_have_proper_symbols_and_keep_their_words(plain, proper):
    assert typeset(plain) == proper
