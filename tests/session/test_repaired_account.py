"""A repaired session gives the account of what is in it, and says what is not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from changed_files import removed
from session_material import (
    COUNTS,
    OUTCOME,
    Session,
    alter,
    assert_same,
    copy_recording,
    record,
)

from app.records.record_types import End
from app.session.files import images_of, results_of
from app.session.journal import journal_of
from app.session.reader import SessionReader
from app.session.repair import repair
from app.system.errors import UserError


@pytest.mark.parametrize(
    ("damage", "lost", "changed"),
    [
        ("nothing", "", {}),
        ("image", "; repaired, 1 images were lost", {"image": 1}),
        ("samples", "; repaired, 0 images, 247 samples were lost", {"samples": 247}),
        ("a result", "; repaired, 0 images, 1 results were lost", {"results": 1}),
        ("results", "; repaired, 0 images, 6 results were lost", {"results": 6}),
    ],
)
def test_the_account_of_a_finished_run_is_of_what_was_brought_back(
    tmp_path: Path, damage: str, lost: str, changed: dict[str, int]
) -> None:
    """A recording that was whole, damaged after its last record: what its session says of itself
    is what is in it, and how the run ended says what is not.
    """
    writer, written = record(tmp_path / "open.h5")
    writer.append(OUTCOME)
    copy_recording(written.path, path := tmp_path / "ended.h5")
    writer.discard()
    files = {
        "image": (images_of(path), written.images[4].tobytes()),
        "samples": (journal_of(path), written.volts[503:750].tobytes()),
        "a result": (results_of(path), written.snapshots[3].field.ux_px.tobytes()),
    }
    if damage in files:
        file, part = files[damage]
        content = file.read_bytes()
        assert content.count(part) == 1
        file.write_bytes(content.replace(part, bytes(len(part))))
    elif damage == "results":
        results_of(path).unlink()
    repair(path, tmp_path / "repaired.h5")
    image, samples = changed.get("image", 0), changed.get("samples", 0)
    analysed = 6 - changed.get("results", image)
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert (read.outcome.end, read.outcome.reason) == (
            End.COMPLETE,
            f"the travel is done{lost}",
        )
        assert read.outcome.counts == replace(
            COUNTS,
            frames_recorded=7 - image,
            frames_lost=1 + image,
            frames_analysed=analysed,
            frames_skipped=7 - image - analysed,
            samples=1000 - samples,
            samples_lost=3 + samples,
        )
        triggers, counts = read.triggers(), read.outcome.counts
        assert len(triggers) == counts.triggers
        assert sum(triggers["received"]) == counts.frames_recorded
        assert len(read.analysed_frames()) == counts.frames_analysed
        assert sum(count for _, count in read.gaps()) == counts.samples_lost


@pytest.mark.parametrize(
    ("lost", "results"), [("fields/zncc", 2), ("results/took", 0), ("contact/radius", 6)]
)
def test_one_dataset_that_can_not_be_read_costs_what_needs_it_and_nothing_else(
    session: Session, tmp_path: Path, lost: str, results: int
) -> None:
    """Those before the reference have no field, and need none."""
    removed(f"/entry/{lost}")(session.path)
    with (
        pytest.raises(UserError, match=f"damaged at /entry/{lost}"),
        SessionReader(session.path) as reader,
    ):
        reader.contact()
    repaired = repair(session.path, tmp_path / "repaired.h5")
    assert (repaired.source, repaired.found.results) == ("file", results)
    assert_same(tmp_path / "repaired.h5", session)
    assert not repaired.found.is_whole
    results_too = f", {6 - results} results" if results < 6 else ", contact"
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.outcome.state == "done"
        assert (
            read.outcome.reason == f"the travel is done; repaired, 0 images{results_too} were lost"
        )
        assert (read.contact() is None) == (lost == "contact/radius")


@pytest.mark.parametrize(
    ("table", "part", "kept"),
    [
        ("instrument/actuator/position", "places of the stage", 7),
        ("events/sample", "events", 7),
        ("triggers/index", "triggers and images", 0),
    ],
)
def test_a_table_that_can_not_be_read_costs_nothing_but_what_is_in_it(
    session: Session, tmp_path: Path, table: str, part: str, kept: int
) -> None:
    alter(session.path, f"/entry/{table}", 0)
    repaired = repair(session.path, tmp_path / "repaired.h5")
    assert (repaired.receipt.frames, repaired.found.is_whole) == (kept, False)
    assert f"what cannot be read at all: {part}" in str(repaired)
    with SessionReader(tmp_path / "repaired.h5") as read:
        np.testing.assert_array_equal(read.forces().volts, session.volts)
        assert f", {part}" in read.outcome.reason


def test_a_field_that_can_not_be_read_costs_the_results_of_its_frame(
    session: Session, tmp_path: Path
) -> None:
    alter(session.path, "/entry/fields/zncc", 1)  # of frame 4
    repaired = repair(session.path, tmp_path / "repaired.h5")
    assert (repaired.found.results, repaired.found.lost_results) == (5, 1)
    assert not repaired.found.is_whole
    assert "nor could the results of 1 frame" in str(repaired)
    with SessionReader(tmp_path / "repaired.h5") as read:
        assert read.analysed_frames() == [0, 1, 2, 6, 7]
