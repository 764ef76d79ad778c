"""The time line of a recorded run, from tables whose contact is Cattaneo and Mindlin's."""

import numpy as np
import pytest

from app.evaluation.timeline import ContactState, timeline_of
from app.records.record_types import Event
from app.records.snapshot_numbers import ROW
from app.records.summary import Summary

RATE, PERIOD, DRIVE, END = 1000.0, 125, 2000, 22000
A, P, MU, ONSET_S = 1e-3, 0.1, 0.9, 8.0
NAN = np.nan
EVENTS = [
    Event(0, "phase", "background"),
    Event(500, "phase", "contact"),
    Event(1500, "phase", "reference"),
    Event(DRIVE, "phase", "drive"),
    Event(DRIVE, "step", "4 of 5: drive", 4),
    Event(15000, "step", "5 of 5: back", 5),
    Event(9000, "restart", "frame 72 could not be analysed (no memory)"),
    Event(END, "complete", "the drive of 50 um is complete"),
]


def summary(onset_s=ONSET_S):
    return Summary(P, A, 0.0, A, onset_s, 0.1, MU * P, MU, 0.01, MU, (MU, MU), 5e-6)


def tables(turns=False):
    """Triggers 5 to 180, of which 90 is lost and 100 was not analysed; the stage stands for a while
    and then turns back, if it does.
    """
    n = np.arange(5, 181)
    triggers = np.empty(
        len(n), [("index", "i8"), ("sample", "i8"), ("received", "?"), ("reason", object)]
    )
    triggers["index"], triggers["sample"] = n, (n - 5) * PERIOD
    triggers["received"], triggers["reason"] = n != 90, ""
    triggers["reason"][n == 90] = "no image came"
    kept = triggers[(n != 90) & (n != 100)]
    results = np.zeros(len(kept), ROW)
    for name in ROW.names:
        if ROW[name].kind == "f":
            results[name] = NAN
    t = (kept["sample"] - DRIVE) / RATE
    phases = np.select(
        [t >= 0, kept["sample"] >= 1500, kept["sample"] >= 500],
        ["drive", "reference", "contact"],
        "background",
    )
    results["frame"], results["sample"], results["phase"] = kept["index"], kept["sample"], phases
    results["normal_force_n"] = P
    forth = np.clip(t, 0, None)
    shear = MU * P * np.clip(forth / ONSET_S, 0, 1)
    travel = 5e-6 * forth
    if turns:  # at 13 s: 3 s of rest, then back; it slides again after twice the travel
        back = np.clip(t - 16, 0, None)
        travel = np.where(t > 13, 65e-6 - 5e-6 * back, travel)
        shear = np.where(t > 16, MU * P * np.clip(1 - 2 * back / 2.0, -1, 1), shear)
    results["travel_m"], results["shear_force_n"] = travel, shear
    results["time_s"] = np.where(t >= 0, t, NAN)
    c = A * np.cbrt(np.clip(1 - forth / ONSET_S, 0, 1))
    results["stick_radius_m"] = np.where(t > 0.3, c, NAN)
    results["stick_radius_sd_m"] = 0.05 * A
    return triggers, results


def line(turns=False, onset_s=ONSET_S, gaps=()):
    triggers, results = tables(turns)
    return timeline_of(
        triggers, results, EVENTS, gaps, summary(onset_s), sample_rate_hz=RATE, exposure=10, end=END
    )


def test_the_states_of_a_drive_follow_the_closed_form():
    states = {one.state: one for one in line().stretches}
    assert [*states] == [
        ContactState.BACKGROUND,
        ContactState.CONTACT,
        ContactState.REFERENCE,
        ContactState.STICK,
        ContactState.PARTIAL,
        ContactState.SLIDE,
    ]
    assert states[ContactState.STICK].begin == DRIVE
    # c is less than a by two standard uncertainties of 0.05 a once Q/(mu P) = 1 - 0.9^3
    expected = DRIVE + RATE * ONSET_S * (1 - 0.9**3)
    assert expected <= states[ContactState.PARTIAL].begin <= expected + 2 * PERIOD
    assert (states[ContactState.SLIDE].begin, states[ContactState.SLIDE].end) == (DRIVE + 8000, END)


def test_a_contact_that_never_slid_has_no_slide():
    states = [one.state for one in line(onset_s=NAN).stretches]
    assert states[-2:] == [ContactState.STICK, ContactState.PARTIAL]


def test_after_the_stage_has_turned_back_the_contact_sticks_before_it_slides_again():
    last = line(turns=True).stretches[-3:]
    assert [one.state for one in last] == [
        ContactState.SLIDE,
        ContactState.PARTIAL,
        ContactState.SLIDE,
    ]
    turned, again = DRIVE + 16 * 1000, DRIVE + 18 * 1000
    assert turned <= last[1].begin <= turned + 4 * PERIOD
    assert again - 2 * PERIOD <= last[2].begin <= again + 2 * PERIOD


def test_steps_restarts_and_losses_are_marked_and_the_runs_own_end_is_not():
    marks = line(gaps=[(4000, 30)]).marks
    assert [(mark.kind, mark.sample) for mark in marks] == [
        ("step", DRIVE),
        ("loss", 4000),
        ("restart", 9000),
        ("loss", (90 - 5) * PERIOD),
        ("step", 15000),
    ]
    assert marks[3].text == "frame 90: no image came"
    assert marks[1].text == "30 force samples lost"


def test_frames_are_found_by_number_and_by_sample():
    here = line()
    assert int(here.frames[here.row_of(57)]) == 57
    assert int(here.frames[here.row_of(90)]) in (89, 91)  # which was lost
    assert (int(here.frames[here.row_of(0)]), int(here.frames[here.row_of(999)])) == (5, 180)
    assert here.middle_of(57) == 52 * PERIOD + 5
    assert here.nearest(52 * PERIOD + 10) == 57
    assert here.nearest(53 * PERIOD - 10) == 58
    assert [here.has_results(frame) for frame in (99, 100, 90)] == [True, False, False]
    assert here.time_s(DRIVE + 1500) == pytest.approx(1.5)
    assert (here.step_at(3000), here.step_at(16000)) == ("4 of 5: drive", "5 of 5: back")
    assert here.state_at(700) is ContactState.CONTACT
