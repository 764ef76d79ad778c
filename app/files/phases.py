"""When the phases of an imported experiment began, by its metadata, the options, or its forces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64
from analysis.robust import serial_inflation, white_noise
from app.evaluation.setup import sensor_chain
from app.files.frames import ImportedTrigger, Sources
from app.records.record_types import STEP, Event, Phase
from app.settings.sections import Config
from app.system.errors import UserError

FOOT = (0.05, 0.15)  # shares of the rise of Q; the line through them leads near to its start
BEND = 0.35  # share of the rise up to which a cubic through the start follows Q
TRIALS, ROUNDS = 41, 3  # starts that are tried at a time, each time closer to the best
LONGEST_SD_S = 60.0
SMOOTH_S = 0.05  # Q is averaged over this time to find its rise
FIRST_LEG = 0.9  # of the greatest change of Q: a first leg that goes further is the one looked at
NEAR_0 = 0.2  # of the load: P of a block that is free
UNZEROED = 0.02  # a free block whose P is larger than this share of the load is noted
SETTLED = 0.9  # share of the load from which the block counts as pressed
RISE = 6.0  # a change of Q by fewer standard deviations of its noise is no rise


def listed_phases(frames: list[ImportedTrigger]) -> list[tuple[int, Phase]]:
    """The phases that the metadata name, with the samples on which they began; none if they name
    none.

    Raises
    ------
    UserError
        A phase is not known, or none is the reference.
    """
    phases: list[tuple[int, Phase]] = []
    for frame in frames:
        if frame.phase and (not phases or frame.phase != phases[-1][1]):
            if frame.phase not in tuple(Phase):
                raise UserError(
                    f"metadata: phase '{frame.phase}' of frame {frame.index} is not known; there"
                    f" are {', '.join(Phase)}"
                )
            began = frame.phase_sample if 0 <= frame.phase_sample <= frame.sample else frame.sample
            phases.append((began if phases else 0, Phase(frame.phase)))
    if phases and Phase.REFERENCE not in [phase for _, phase in phases]:
        raise UserError("metadata: no frame is of phase reference; name one, or give --reference")
    return phases


def listed_steps(frames: list[ImportedTrigger]) -> list[Event]:
    """The beginnings of the steps of a protocol that the metadata name."""
    begun: list[Event] = []
    before = 0
    for frame in frames:
        if frame.step > before and frame.step < 1000 and 0 <= frame.step_sample <= frame.sample:
            begun.append(
                Event(frame.step_sample, STEP, f"{frame.step} of an imported run", frame.step)
            )
            before = frame.step
    return begun


def chosen_phases(
    config: Config,
    frames: list[ImportedTrigger],
    volts: F64,
    sources: Sources,
    remarks: list[str],
) -> tuple[list[tuple[int, Phase]], float]:
    """The phases by the frames that the options name, else by the forces: the background is the
    last image with P near 0, the drive begins where Q rises, the reference is the last image at
    rest before it. With the standard uncertainty of that beginning, s; 0 where it was not looked
    for in Q.

    Raises
    ------
    UserError
        A frame has no image or is out of order, Q does not rise, or no image shows the block at
        rest.
    """
    exposure, rate = config.exposure_samples, config.forces.sample_rate
    images = {frame.index: frame.sample for frame in frames if frame.path is not None}
    for option, index in (("--background", sources.background), ("--reference", sources.reference)):
        if index is not None and index not in images:
            raise UserError(
                f"{option}: frame {index} has no image; there are images of frames {min(images)} to"
                f" {max(images)}"
            )
    forces = sensor_chain(config).forces(volts)
    loads = {i for i, at in images.items() if np.isfinite(forces[at : at + exposure]).all()}
    if sources.reference is not None and _known(forces) and sources.reference not in loads:
        raise UserError(
            f"--reference: frame {sources.reference} has no forces, from which all others count;"
            " choose another, or give a table that covers it"
        )
    pressing = _pressing(forces[:, 0], rate, sources.reference and images[sources.reference])
    margin = round(SMOOTH_S * rate)
    background, reference = sources.background, sources.reference
    if background is None and pressing is not None:
        free = [i for i, sample in images.items() if sample + exposure + margin <= pressing.begins]
        background = max((i for i in free if reference is None or i < reference), default=None)
        if background is None:
            remarks.append(
                "no background: no image was taken before P rose, so that a cannot be measured;"
                " --background names one"
            )
        else:
            remarks.append(
                f"the background is frame {background}, the last with P near 0 (P rises at"
                f" {pressing.begins / rate:.3f} s)"
            )
            if abs(pressing.zero) > UNZEROED * abs(pressing.load):
                remarks.append(
                    f"P is {pressing.zero:.3g} N while the block is free,"
                    f" {abs(pressing.zero / pressing.load):.0%} of the load: take the zero of the"
                    " sensors off the table, or give it in forces.zero"
                )
    drive, start_sd_s = _named_drive(sources, frames, images, exposure), 0.0
    if drive is None and reference is not None and not _known(forces[images[reference] :]):
        drive = _after(images[reference] + exposure, frames, remarks)
    elif drive is None and _known(forces):
        begin = pressing.ends if pressing is not None else 0
        if background is not None:
            begin = max(begin, images[background] + exposure)
        rise, sd = _rise(forces[begin:, 1], rate)
        drive, start_sd_s = begin + rise, sd / rate
        remarks.append(
            f"the drive begins at sample {drive} ({drive / rate:.3f} ± {start_sd_s:.3f} s), where"
            " Q begins to rise"
        )
        if reference is None:
            at_rest = [
                i for i in loads if begin <= images[i] and images[i] + exposure + margin <= drive
            ]
            if not at_rest:
                raise UserError(
                    f"import: no image shows the loaded block at rest, between"
                    f" {begin / rate:.3f} s, when it is pressed, and {drive / rate:.3f} s, when Q"
                    " rises; name one with --reference, or move the forces with --time-offset"
                )
            reference = max(at_rest)
    if reference is None:
        usable = loads if _known(forces) else set(images)
        before = [i for i in usable if drive is None or images[i] + exposure <= drive]
        if not before:
            which = "no image that has forces" if usable != set(images) else "no image"
            raise UserError(f"import: {which} comes before the drive; choose another --drive")
        after = [i for i in before if background is None or i > background] or before
        reference = min(after) if drive is None else max(after)
    rest = images[reference] + exposure
    if drive is None:
        drive = _after(rest, frames, remarks)
    if drive < rest:
        who, what = f"--drive: frame {sources.drive}", "choose another"
        if sources.drive is None:
            who, what = "the drive", "choose another --reference, or say where it begins: --drive"
        raise UserError(f"{who} does not come after the reference (frame {reference}); {what}")
    phases = [(0, Phase.CONTACT), (images[reference], Phase.REFERENCE)]
    if background is not None:
        pressed = images[background] + exposure
        if pressed > images[reference]:
            raise UserError(
                f"--background: frame {background} does not come before the reference; choose"
                " another"
            )
        phases[:1] = [(0, Phase.BACKGROUND), (pressed, Phase.CONTACT)]
    how = "" if sources.reference is not None or not _known(forces) else ", the last before it"
    remarks.append(f"the reference is frame {reference}{how}")
    return [*phases, (drive, Phase.DRIVE)], min(start_sd_s, LONGEST_SD_S)


def _after(rest: int, frames: list[ImportedTrigger], remarks: list[str]) -> int:
    """The sample of the first frame from `rest` on, where the reference has been exposed."""
    remarks.append(
        "the drive is taken to begin on the frame after the reference; --drive changes that"
    )
    return next((frame.sample for frame in frames if frame.sample >= rest), rest)


def _known(forces: F64) -> bool:
    return bool(np.isfinite(forces).any())


def _named_drive(
    sources: Sources, frames: list[ImportedTrigger], images: dict[int, int], exposure: int
) -> int | None:
    if sources.drive is None:
        return None
    drive = next((frame.sample for frame in frames if frame.index == sources.drive), -1)
    if drive < min(images.values()) + exposure:
        raise UserError(
            f"--drive: frame {sources.drive} does not come after the reference (frame"
            f" {min(images) if sources.reference is None else sources.reference}); choose another"
        )
    return drive


@dataclass(frozen=True, slots=True)
class _Pressing:
    """When P rises from its value at the start, and when it has reached the load: samples, N."""

    begins: int
    ends: int
    zero: float
    load: float


def _means(force: F64, rate: float) -> tuple[F64, int]:
    """Means of a force over short blocks, NaN where one has a gap; and their length in samples."""
    width = max(1, round(SMOOTH_S * rate))
    return force[: len(force) // width * width].reshape(-1, width).mean(axis=1), width


def _pressing(normal: F64, rate: float, until: int | None) -> _Pressing | None:
    """How the block was pressed, before sample `until`; None if P does not rise from near 0."""
    mean, width = _means(normal if until is None else normal[:until], rate)
    known = np.flatnonzero(np.isfinite(mean))
    if len(known) < 4:
        return None
    values = mean[known]
    zero = float(np.median(values[: max(1, min(5, len(values) // 20))]))
    size = np.abs(values - zero)
    load = float(np.median(values[size >= 0.5 * size.max()]))
    noise = white_noise(values)
    reach = abs(load - zero)
    if reach < RISE * noise or abs(zero) > NEAR_0 * abs(load):
        return None
    loaded = int(np.argmax(size > 0.5 * reach))
    near = np.flatnonzero(size[:loaded] < max(NEAR_0 * reach / 4, 3 * noise))
    if not len(near):
        return None
    # P may creep while it settles, and be set again: it is there once it stays within a tenth
    ends = loaded + int(np.argmax(size[loaded:] > SETTLED * reach))
    return _Pressing(int(known[near[-1]]) * width, int(known[ends] + 1) * width, zero, load)


def _rise(shear: F64, rate: float) -> tuple[int, float]:
    """Sample on which Q begins to rise, and its standard uncertainty in samples. A line through 5
    and 15 % of the rise to the greatest value leads back to the mean at rest, and from there a
    fit decides: the mean at rest, then a cubic from the start on.

    Raises
    ------
    UserError
        Q does not rise.
    """
    blocks, width = _means(shear, rate)
    known = np.isfinite(blocks)
    mean, middle = blocks[known], ((np.arange(len(blocks)) + 0.5) * width)[known]
    if len(mean) < 4:
        raise UserError(
            "import: too few forces after the reference to find where Q rises; say where the drive"
            " begins with --drive"
        )
    top = int(np.argmax(np.abs(mean)))
    half = int(np.argmax(np.abs(mean) > 0.5 * np.abs(mean[top])))
    rest = float(np.median(mean[: max(1, half)][:20]))
    noise = float(np.nanstd(np.diff(shear)) / np.sqrt(2 * width))
    for _ in range(3):  # the rest is what comes just before the rise
        height = abs(mean[top] - rest)
        shares = np.abs(mean[: top + 1] - rest) / max(height, 1e-300)
        if top < 2 or height < RISE * noise or shares.min() >= FOOT[0]:
            raise UserError(
                f"import: Q does not rise after the reference (by {height:.3g} N at most); say"
                " where the drive begins with --drive"
            )
        shares = shares[: int(np.argmax(shares > FIRST_LEG)) + 1]
        places = []
        for share in FOOT:
            below = int(np.flatnonzero(shares < share)[-1])
            part = (share - shares[below]) / (shares[below + 1] - shares[below])
            places.append(middle[below] + part * (middle[below + 1] - middle[below]))
        start = places[0] - FOOT[0] * (places[1] - places[0]) / (FOOT[1] - FOOT[0])
        before = mean[middle + width / 2 <= start][-20:]
        if not len(before):
            break
        rest = float(np.median(before))
    after = np.flatnonzero(shares < BEND)[-1] + 1
    start, sd = _bent(shear, float(start), float(middle[after]))
    return max(0, round(start)), sd


def _bent(shear: F64, start: float, end: float) -> tuple[float, float]:
    """Where Q, at rest before, begins to follow a cubic up to sample `end`, and the standard
    uncertainty of that, samples: by least squares, from about `start`.
    """
    width = max(end - start, 4.0)
    at = np.arange(max(0, math.floor(start - width)), math.ceil(end), dtype=np.float64)
    q = shear[at.astype(int)]
    at, q = at[np.isfinite(q)], q[np.isfinite(q)]

    def misfit(place: float) -> F64:
        since = np.clip((at - place) / width, 0.0, None)
        columns = np.column_stack([np.ones(len(at)), since, since**2, since**3])
        return np.asarray(q - columns @ np.linalg.lstsq(columns, q, rcond=None)[0])

    def power(place: float) -> float:
        left = misfit(place)
        return float(left @ left)

    low, high = max(start - 0.6 * width, at[0] + 2), start + 0.5 * width
    for _ in range(ROUNDS):
        tried = np.linspace(low, high, TRIALS)
        best, step = float(min(tried, key=power)), 2 * (tried[1] - tried[0])
        low, high = best - step, best + step
    left = misfit(best)
    least = float(left @ left)
    noise2 = serial_inflation(left) * least / max(len(at) - 5, 1)
    # the sum of squares grows by that of one reading at one standard deviation
    reach = [width / 1000 * 1.2**n for n in range(40)]
    distances = [
        next((d for d in reach if power(best + sign * d) > least + noise2), width)
        for sign in (-1, 1)
    ]
    return best, float(np.mean(distances))
