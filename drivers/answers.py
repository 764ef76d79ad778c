"""What a driver answers while a bench runs, compared with `drivers.protocols` before anything is
recorded: one answer that breaks the rules would cost what is recorded after it, or all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.arrays import Array
from drivers.errors import DeviceFault
from drivers.protocols import Camera, Frame, LostFrame, LostSamples, SampleBlock, TriggerTrain

# after its trigger, or as long as from one trigger to the next; an exposure that begins later is no
# answer to it
LATEST_S = 1.0
LONGEST_GAP = 10**7  # samples; more has no room in memory, and is a counter that went wrong
NEVER = 1 << 62  # number of a trigger that no run has
LONGEST_BACKLOG = 10**8  # a quarter of an hour of the fastest board
MOST_EXPOSURES = 10**6  # in a block or a gap; more is a counter that went wrong as well
LARGEST = 1e18  # of what a session takes: of volts, metres and seconds
_WHOLE = int, np.integer
_REAL = float, np.float16, np.float32, np.float64, *_WHOLE
_REMEDY = "correct its driver, which `slipscope check-driver` tests"


def check_samples(name: str, block: Any, due: int, counted: int | None = None) -> None:
    """Refuse what `wrong_samples` finds; DeviceFault."""
    if found := wrong_samples(block, due, counted):
        raise DeviceFault(f"{name}: sample {due} was due, its driver gave {found}; {_REMEDY}")


def wrong_samples(block: Any, due: int, counted: int | None = None) -> str:
    """What came instead of the samples from `due` on, or of the gap in their place; empty if they
    came. `counted` are the exposures so far, None where the source counts none.
    """
    if isinstance(block, SampleBlock):
        found = _wrong_block(block, counted)
    elif isinstance(block, LostSamples):
        is_counted = _is_whole(block.count) and 0 < block.count <= LONGEST_GAP
        is_gap = is_counted and isinstance(block.reason, str)
        gap = f"a gap of {block.count!r} samples, reason {block.reason!r}"
        found = "" if is_gap else gap
    else:
        found = f"{type(block).__name__}, which is neither samples nor a gap"
    if not found and not (_is_whole(block.first) and block.first == due):
        found = f"samples from {block.first!r} on"
    return found


def is_backlog(waiting: Any) -> bool:
    """Whether what a source gives is how many samples wait."""
    return _is_whole(waiting) and bool(0 <= waiting <= LONGEST_BACKLOG)


def check_backlog(name: str, waiting: Any) -> int:
    """How many samples wait, as a source says; DeviceFault if that is no number of samples."""
    if not is_backlog(waiting):
        raise DeviceFault(f"{name}: its driver gave {waiting!r} for its backlog; {_REMEDY}")
    return int(waiting)


def _wrong_block(block: SampleBlock, counted: int | None) -> str:
    volts, counts, auxiliary = block.volts, block.exposures, block.auxiliary
    if not _is_table(volts, "f", 2) or volts.shape[1] != 2 or not len(volts):
        return f"volts that are {_kind(volts)}"
    if counts is not None and (not _is_table(counts, "iu", 1) or len(counts) != len(volts)):
        return f"exposures that are {_kind(counts)}"
    if auxiliary is not None and (not _is_table(auxiliary, "f", 2) or len(auxiliary) != len(volts)):
        return f"auxiliary volts that are {_kind(auxiliary)}"
    for values in (volts, auxiliary):  # what is no number has its place in a session
        if values is not None and (np.abs(values) > LARGEST).any():
            return f"a reading of {np.nanmax(np.abs(values)):g} V"
    if counted is None:
        return ""
    if counts is None:
        return "samples without the count of exposures that it promises (counts_exposures)"
    steps = np.diff(counts.astype(np.int64), prepend=counted)
    is_count = steps.min() >= 0 and steps.sum() <= MOST_EXPOSURES
    return "" if is_count else f"exposures from {counts[0]} to {counts[-1]} after {counted}"


def check_answer(
    camera: Camera,
    answer: Any,
    due: int,
    train: TriggerTrain,
    sample_rate_hz: float,
    before: Sequence[Array] = (),
) -> None:
    """Refuse what is not the frame of the trigger `due`, or its loss, or whose image is written
    over one of those `before` that are still in use, the newest last; DeviceFault.
    """
    if not isinstance(answer, Frame | LostFrame):
        found = f"{type(answer).__name__}, which is neither a frame nor a loss"
    else:
        found = _wrong_answer(camera, answer, due, train, sample_rate_hz, before)
    if found:
        raise DeviceFault(
            f"{camera.name}: the frame of trigger {due} was due, its driver gave {found}; {_REMEDY}"
        )


def _wrong_answer(
    camera: Camera,
    answer: Frame | LostFrame,
    due: int,
    train: TriggerTrain,
    sample_rate_hz: float,
    before: Sequence[Array],
) -> str:
    numbers = answer.index, answer.sample, answer.first, answer.last
    if not all(map(_is_whole, numbers)) or answer.index != due:
        return f"that of {answer.index!r}"
    latest = train.sample(due) + max(LATEST_S * sample_rate_hz, train.divisor)
    if not train.sample(due) <= answer.sample <= latest:
        return f"one of sample {answer.sample}, its trigger is on {train.sample(due)}"
    if not answer.first <= due <= answer.last < NEVER:
        return f"one of the triggers {answer.first} to {answer.last}"
    if isinstance(answer, LostFrame):
        return "" if isinstance(answer.reason, str) else f"a loss for the reason {answer.reason!r}"
    image = answer.image
    kind = getattr(image, "shape", None), getattr(image, "dtype", None)
    if not isinstance(image, np.ndarray) or kind != (camera.shape, camera.dtype):
        return f"an image that is {_kind(image)}, not {camera.dtype} of {camera.shape}"
    # an image that is its own memory, and can not be written to, may come again as it is
    is_free = image.flags.writeable or image.base is not None
    if is_free and (shared := [np.may_share_memory(image, one) for one in before]) and any(shared):
        which = "the frame before" if shared[-1] else "an earlier frame, which is still in use"
        return f"an image in the memory of that of {which}"
    if not isinstance(answer.stamp_s, _REAL) or abs(answer.stamp_s) > LARGEST:
        return f"one with the time {answer.stamp_s!r} s"
    return "" if isinstance(answer.doubt, str) else f"one with the doubt {answer.doubt!r}"


def check_position(name: str, position: Any) -> float:
    """The position that a stage gives, NaN too; DeviceFault if it is no number, or no place."""
    value = np.asarray(position)
    if value.ndim or value.dtype.kind not in "fiu" or abs(value) > LARGEST:
        raise DeviceFault(f"{name}: its driver gave {position!r} for its position; {_REMEDY}")
    return float(value)


def check_moves(name: str, answer: Any) -> bool:
    """Whether a stage says that it moves; DeviceFault if it says neither that nor the contrary."""
    if not isinstance(answer, bool | np.bool_):
        raise DeviceFault(f"{name}: its driver gave {answer!r} for whether it moves; {_REMEDY}")
    return bool(answer)


def _is_whole(number: Any) -> bool:
    return isinstance(number, _WHOLE) and not isinstance(number, bool)


def _is_table(values: Any, kinds: str, ndim: int) -> bool:
    is_array = isinstance(values, np.ndarray) and not isinstance(
        values, np.ma.MaskedArray | np.matrix
    )
    return is_array and values.ndim == ndim and values.dtype.kind in kinds


def _kind(values: Any) -> str:
    if isinstance(values, np.ndarray):
        kind = f" ({type(values).__name__})" * (type(values) is not np.ndarray)
        return f"{values.dtype} of shape {values.shape}{kind}"
    return type(values).__name__
