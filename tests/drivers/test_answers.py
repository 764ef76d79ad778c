"""A driver whose answers break the rules ends the run with a sentence and costs nothing that was
recorded before.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import slipscope
from drivers.answers import check_answer, check_moves, check_position, check_samples
from drivers.bench import ClockedForces
from drivers.clock import SampleClock
from drivers.errors import DeviceFault
from drivers.protocols import Frame, LostFrame, LostSamples, SampleBlock, TriggerTrain
from drivers.sim.devices import SimActuator, SimCamera

IMAGE = np.zeros((3, 4), np.uint8)
CAMERA: Any = SimpleNamespace(name="my camera", shape=(3, 4), dtype=np.dtype(np.uint8))
TRAIN, FRAME = TriggerTrain(0, 125), Frame(8, 1000, IMAGE)
BLOCK = SampleBlock(50, np.zeros((5, 2)), np.zeros(5, np.int64), np.zeros((5, 1)))


@pytest.mark.parametrize(
    "block",
    [
        BLOCK,
        replace(BLOCK, volts=np.full((7, 2), math.nan), exposures=None, auxiliary=None),
        LostSamples(50, 3, "overwritten"),
    ],
)
def test_samples_that_were_due_are_taken(block: Any) -> None:
    check_samples("board", block, 50)


@pytest.mark.parametrize(
    ("block", "told"),
    [
        (None, "NoneType, which is neither samples nor a gap"),
        (replace(BLOCK, first=-50), "samples from -50 on"),
        (replace(BLOCK, first=55), "samples from 55 on"),
        (replace(BLOCK, first=50.0), "samples from 50.0 on"),
        (replace(BLOCK, volts=np.zeros((2, 5))), "volts that are float64 of shape (2, 5)"),
        (replace(BLOCK, volts=np.zeros((0, 2))), "volts that are float64 of shape (0, 2)"),
        (replace(BLOCK, volts=np.zeros((5, 2), int)), "volts that are int64 of shape (5, 2)"),
        (replace(BLOCK, volts=[[0.0, 0.0]]), "volts that are list"),
        (replace(BLOCK, exposures=np.zeros(4, int)), "exposures that are int64 of shape (4,)"),
        (replace(BLOCK, auxiliary=np.zeros(5)), "auxiliary volts that are float64 of shape (5,)"),
        (replace(BLOCK, volts=np.array(5 * [[math.nan, -math.inf]])), "a reading of inf V"),
        (replace(BLOCK, volts=np.full((5, 2), -1e19)), "a reading of 1e+19 V"),
        (replace(BLOCK, auxiliary=np.full((5, 1), math.inf)), "a reading of inf V"),
        (
            replace(BLOCK, volts=np.ma.masked_invalid(np.zeros((5, 2)))),
            "volts that are float64 of shape (5, 2) (MaskedArray)",
        ),
        (LostSamples(50, -5, "odd"), "a gap of -5 samples, reason 'odd'"),
        (LostSamples(50, 10**9, "odd"), "a gap of 1000000000 samples, reason 'odd'"),
        (LostSamples(50, 5, None), "a gap of 5 samples, reason None"),  # type: ignore[arg-type]
    ],
)
def test_other_samples_are_refused(block: Any, told: str) -> None:
    with pytest.raises(DeviceFault) as refused:
        check_samples("board", block, 50)
    assert str(refused.value).startswith(f"board: sample 50 was due, its driver gave {told}; ")


@pytest.mark.parametrize(
    ("counts", "told"),
    [
        (None, "samples without the count of exposures that it promises (counts_exposures)"),
        (np.array([3, 4, 4, 3, 4]), "exposures from 3 to 4 after 3"),
        (np.array([2, 3, 3, 3, 3]), "exposures from 2 to 3 after 3"),
        (np.array([3, 3, 3, 3, 2**32 - 1], np.uint32), "exposures from 3 to 4294967295 after 3"),
        (np.array([3, 3, 3, 3, 2**64 - 1], np.uint64), "exposures from 3 to 18446744073709551615"),
    ],
)
def test_a_count_of_exposures_that_went_wrong_is_refused(counts: Any, told: str) -> None:
    """One of a 32-bit counter took 32 GB of memory."""
    with pytest.raises(DeviceFault) as refused:
        check_samples("board", replace(BLOCK, exposures=counts), 50, 3)
    assert f"its driver gave {told}" in str(refused.value)


@pytest.mark.parametrize("kind", [np.uint16, np.uint32, np.int64, np.uint64])
def test_the_bench_takes_counts_of_any_whole_kind_and_refuses_before_the_clock_advances(
    kind: type,
) -> None:
    blocks = [replace(BLOCK, first=0, exposures=np.array([0, 1, 1, 1, 2], kind)), None]
    board = SimpleNamespace(
        name="board",
        counts_exposures=True,
        start=lambda train: None,
        read=lambda timeout_s: blocks.pop(0),
    )
    clock = SampleClock(1000.0)
    forces = ClockedForces(board, clock)
    forces.start(TRAIN)
    forces.read(1.0)
    assert clock.exposures_from(0) == [1, 4]
    with pytest.raises(DeviceFault, match="board: sample 5 was due, its driver gave NoneType"):
        forces.read(1.0)
    assert clock.now == 5


def test_samples_stay_as_they_were_read_though_their_driver_uses_its_buffers_again() -> None:
    """As the readers of a board's library do; recorded readings were later ones."""
    volts: Any = np.zeros((5, 2), np.float32)
    further = np.zeros((5, 1))
    board = SimpleNamespace(
        name="board",
        counts_exposures=False,
        start=lambda train: None,
        read=lambda timeout_s: SampleBlock(0, volts, None, further),
    )
    forces = ClockedForces(board, SampleClock(1000.0))
    forces.start(TRAIN)
    block = forces.read(1.0)
    volts[:] = further[:] = 7.0
    assert isinstance(block, SampleBlock)
    assert block.auxiliary is not None
    assert not block.volts.any()
    assert not block.auxiliary.any()
    assert block.volts.dtype == np.float64


@pytest.mark.parametrize(
    "answer",
    [FRAME, replace(FRAME, sample=1999, first=6, last=9, stamp_s=-3.0), LostFrame(8, 1000, "no")],
)
def test_the_answer_to_the_trigger_that_was_due_is_taken(answer: Any) -> None:
    check_answer(CAMERA, answer, 8, TRAIN, 1000.0)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (IMAGE, "ndarray, which is neither a frame nor a loss"),
        (Frame(-1, 1000, IMAGE), "that of -1"),
        (replace(FRAME, index=7, first=7, last=7), "that of 7"),
        (replace(FRAME, sample=-5), "one of sample -5, its trigger is on 1000"),
        (replace(FRAME, sample=999), "one of sample 999, its trigger is on 1000"),
        (replace(FRAME, sample=2001), "one of sample 2001, its trigger is on 1000"),
        (replace(FRAME, first=9, last=7), "one of the triggers 9 to 7"),
        (replace(FRAME, image=IMAGE.T), "an image that is uint8 of shape (4, 3), not uint8 of (3,"),
        (replace(FRAME, image=IMAGE.astype(float)), "an image that is float64 of shape (3, 4)"),
        (replace(FRAME, image=None), "an image that is NoneType"),  # type: ignore[arg-type]
        (replace(FRAME, stamp_s=math.inf), "one with the time inf"),
        (replace(FRAME, stamp_s=-1e19), "one with the time -1e+19 s"),
        (replace(FRAME, stamp_s=np.longdouble(3)), "one with the time np.longdouble"),
        (replace(FRAME, last=1 << 62), "one of the triggers 8 to 46116860184273879"),
        (replace(FRAME, first=True), "that of 8"),
        (replace(FRAME, doubt=None), "one with the doubt None"),  # type: ignore[arg-type]
        (LostFrame(8, 1000, None), "a loss for the reason None"),  # type: ignore[arg-type]
    ],
)
def test_other_answers_of_a_camera_are_refused(answer: Any, told: str) -> None:
    with pytest.raises(DeviceFault) as refused:
        check_answer(CAMERA, answer, 8, TRAIN, 1000.0)
    expected = f"my camera: the frame of trigger 8 was due, its driver gave {told}"
    assert str(refused.value).startswith(expected)


def test_an_image_that_is_written_over_the_one_before_is_refused() -> None:
    """A driver that reuses its one buffer changed what was on its way to the disk."""
    buffer = np.zeros((4, 4), np.uint8)
    view = buffer[:3]
    view.flags.writeable = False
    with pytest.raises(DeviceFault, match="an image in the memory of that of the frame before"):
        check_answer(CAMERA, replace(FRAME, image=view), 8, TRAIN, 1000.0, [view])
    check_answer(CAMERA, replace(FRAME, image=view), 8, TRAIN, 1000.0, [view.copy()])
    still = view.copy()
    still.flags.writeable = False
    check_answer(CAMERA, replace(FRAME, image=still), 8, TRAIN, 1000.0, [still])


@pytest.mark.parametrize("answer", ["0", None, 1, math.nan, np.array([True])])
def test_a_stage_moves_or_does_not(answer: Any) -> None:
    """The text "0" was taken for a stage that moves, None for one that stands."""
    assert check_moves("stage", np.bool_(True)) is True
    assert check_moves("stage", False) is False
    with pytest.raises(DeviceFault, match=r"stage: its driver gave .* for whether it moves; corr"):
        check_moves("stage", answer)


def test_a_position_is_a_number() -> None:
    assert check_position("stage", np.float32(0.5)) == 0.5
    assert math.isnan(check_position("stage", math.nan))
    with pytest.raises(DeviceFault, match=r"stage: its driver gave '12.5' for its position; corr"):
        check_position("stage", "12.5")
    with pytest.raises(DeviceFault, match="stage: its driver gave -inf for its position"):
        check_position("stage", -math.inf)


@contextmanager
def failed_run(folder: Path) -> Iterator[slipscope.Session]:
    """The session of a small run of the simulated bench, which has failed."""
    small = ["camera.width=64", "camera.height=64", "dic.step=20", "stress.method=none"]
    with slipscope.run(folder / "run.h5", settings=small, timeout_s=60) as session:
        assert session.state == "failed"
        yield session


def test_a_stage_that_is_infinitely_far_costs_no_recording(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One such position made the session unreadable."""
    position_m, asked = SimActuator.position_m, []

    def broken(actuator: SimActuator) -> float:
        asked.append(position_m(actuator))
        return asked[-1] if len(asked) < 40 else math.inf

    monkeypatch.setattr(SimActuator, "position_m", broken)
    with failed_run(tmp_path) as session:
        assert "simulated actuator: its driver gave inf for its position" in session.reason
        assert len(session.forces.time_s) > 1000


def test_a_frame_that_breaks_the_rules_costs_no_recording(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One with the number -1 made the journal of the run unreadable."""
    read = SimCamera.read

    def broken(camera: SimCamera, timeout_s: float) -> Frame | LostFrame:
        answer = read(camera, timeout_s)
        return answer if answer.index < 9 else replace(answer, index=-1, first=-1, last=-1)

    monkeypatch.setattr(SimCamera, "read", broken)
    with failed_run(tmp_path) as session:
        assert "trigger 9 was due, its driver gave that of -1" in session.reason
        assert session.frames.received.tolist() == list(range(9))
        assert len(session.forces.time_s) > 1000


def test_a_camera_that_reuses_its_buffer_fails_the_run_at_its_second_frame(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    read, buffer = SimCamera.read, np.zeros((64, 64), np.uint8)

    def reused(camera: SimCamera, timeout_s: float) -> Frame | LostFrame:
        answer = read(camera, timeout_s)
        assert isinstance(answer, Frame)
        buffer[:] = answer.image
        return replace(answer, image=buffer[:])

    monkeypatch.setattr(SimCamera, "read", reused)
    with failed_run(tmp_path) as session:
        assert "trigger 1 was due, its driver gave an image in the memory of" in session.reason
        assert session.frames.received.tolist() == [0]


def test_what_no_driver_may_raise_is_told_as_that_of_the_camera(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It was "camera: KeyboardInterrupt: ", of no device and with nothing to do."""
    read = SimCamera.read

    def broken(camera: SimCamera, timeout_s: float) -> Frame | LostFrame:
        answer = read(camera, timeout_s)
        if answer.index == 3:
            raise KeyboardInterrupt
        return answer

    monkeypatch.setattr(SimCamera, "read", broken)
    with failed_run(tmp_path) as session:
        told = "simulated camera: KeyboardInterrupt; check the device and its driver"
        assert session.reason.startswith(told)
        assert session.frames.received.tolist() == [0, 1, 2]
