"""A window that is blocked for ten seconds in the middle of a live run delays nothing else."""

import numpy as np
import pytest
from processes.launched import wait_until
from short_run import SMALL
from window_hands import wait_for_end

from app.gui.window import MainWindow
from app.records.record_types import Phase
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config

BLOCKED_S = 10.0  # of the bench, which is faster here than a real one
DIVISOR = 125


@pytest.mark.slow
def test_a_window_blocked_for_ten_seconds_costs_neither_a_frame_nor_a_sample(qtbot, tmp_path):
    settings = config.load(None, [*SMALL, "run.travel=130", "limits.age=10"])
    run = live.make_run(settings, tmp_path / "x.h5", pace=4.0)
    read, blocks = run._bench.forces.read, []
    run._bench.forces.read = lambda timeout: blocks.append(read(timeout)) or blocks[-1]
    window = MainWindow(run)
    show, seen = window.interface.show_view, []

    def goes_on():
        before, after = seen[0], run.health()
        seen[1:] = [after]
        received, recorded = (
            getattr(after.counts, name) - getattr(before.counts, name)
            for name in ("frames_received", "frames_recorded")
        )
        frames = 0.85 * 1000 * BLOCKED_S / DIVISOR
        return after.sample - before.sample >= 1000 * BLOCKED_S and min(received, recorded) > frames

    def block(view):  # as a graphics driver may
        if view.phase == Phase.DRIVE and not seen:
            seen.append(run.health())
            wait_until(goes_on, "what the bench measures in ten seconds")
        show(view)

    window.interface.show_view = block
    window.show()
    window.begin()
    wait_for_end(qtbot, window)
    outcome = run.wait(400)
    view = window._view
    window.close()
    window.deleteLater()

    before, after = seen
    assert (before.state, after.state) == ("running", "running")
    assert (outcome.state, outcome.reason) == ("done", "the drive of 130 um is complete")
    counts = outcome.counts
    assert (
        counts.triggers
        == counts.frames_received
        == counts.frames_recorded
        > 1000 * BLOCKED_S / DIVISOR
    )
    assert (counts.frames_lost, counts.samples_lost, counts.samples) == (0, 0, blocks[-1].end)
    with SessionReader(tmp_path / "x.h5") as session:
        assert np.array_equal(
            session.forces().volts, np.concatenate([block.volts for block in blocks])
        )
        assert [index for index, _, _ in session.frames()] == list(range(counts.triggers))
    assert view.curves.seen == counts.frames_analysed  # the window has caught up
