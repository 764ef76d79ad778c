"""When the phases of an imported experiment began, by its metadata, the options, or its forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.engine.setup import sensor_chain
from app.errors import UserError
from app.exchange.frames import ImportedTrigger, Sources
from app.records import STEP, Event, Phase
from app.settings import Config

F64 = NDArray[np.float64]

FOOT = (0.05, 0.15)  # shares of the rise of Q; the line through them leads back to its start
SMOOTH_S = 0.05  # Q is averaged over this time to find its rise
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
            begun.append(Event(frame.step_sample, STEP, f"{frame.step} of an imported run"))
            before = frame.step
    return begun


def chosen_phases(
    config: Config,
    frames: list[ImportedTrigger],
    volts: F64,
    sources: Sources,
    remarks: list[str],
) -> list[tuple[int, Phase]]:
    """The phases by the frames that the options name; the drive begins where Q rises unless --drive
    says where.

    Raises
    ------
    UserError
        A frame has no image or is out of order, or Q does not rise.
    """
    exposure, rate = config.exposure_samples, config.forces.sample_rate
    images = {frame.index: frame.sample for frame in frames if frame.path is not None}
    background, reference = sources.background, sources.reference
    if reference is None:
        reference = min((i for i in images if i != background), default=min(images))
    for option, index in (("--background", background), ("--reference", reference)):
        if index is not None and index not in images:
            raise UserError(
                f"{option}: frame {index} has no image; there are images of frames {min(images)} to"
                f" {max(images)}"
            )
    rest = images[reference] + exposure
    phases = [(0, Phase.CONTACT), (images[reference], Phase.REFERENCE)]
    if background is not None:
        pressed = images[background] + exposure
        if pressed > images[reference]:
            raise UserError(
                f"--background: frame {background} does not come before the reference; choose"
                " another"
            )
        phases[:1] = [(0, Phase.BACKGROUND), (pressed, Phase.CONTACT)]
    if sources.drive is not None:
        drive = next((frame.sample for frame in frames if frame.index == sources.drive), -1)
        if drive < rest:
            raise UserError(
                f"--drive: frame {sources.drive} does not come after the reference (frame"
                f" {reference}); choose another"
            )
    elif np.isfinite(volts[rest:]).any():
        drive = rest + _rise(sensor_chain(config).forces(volts[rest:])[:, 1], rate)
        remarks.append(
            f"the drive begins at sample {drive} ({drive / rate:.3f} s), where Q begins to rise"
        )
    else:
        drive = next((frame.sample for frame in frames if frame.sample >= rest), rest)
        remarks.append(
            "the drive is taken to begin on the frame after the reference; --drive changes that"
        )
    remarks.append(f"the reference is frame {reference}")
    return [*phases, (drive, Phase.DRIVE)]


def _rise(shear: F64, rate: float) -> int:
    """Sample on which Q begins to rise: where a line through 5 and 15 % of its rise to the greatest
    value meets its mean at rest.

    Raises
    ------
    UserError
        Q does not rise.
    """
    width = max(1, round(SMOOTH_S * rate))
    blocks = shear[: len(shear) // width * width].reshape(-1, width)
    known = np.isfinite(blocks).all(axis=1)
    mean, middle = blocks[known].mean(axis=1), ((np.arange(len(blocks)) + 0.5) * width)[known]
    if len(mean) < 4:
        raise UserError(
            "import: too few forces after the reference to find where Q rises; say where the drive"
            " begins with --drive"
        )
    top = int(np.argmax(np.abs(mean)))
    half = int(np.argmax(np.abs(mean) > 0.5 * np.abs(mean[top])))
    rest = np.median(mean[: max(1, half)][:20])
    noise = float(np.nanstd(np.diff(shear)) / np.sqrt(2 * width))
    height = abs(mean[top] - rest)
    shares = np.abs(mean[: top + 1] - rest) / max(height, 1e-300)
    if top < 2 or height < RISE * noise or shares.min() >= FOOT[0]:
        raise UserError(
            f"import: Q does not rise after the reference (by {height:.3g} N at most); say where"
            " the drive begins with --drive"
        )
    places = []
    for share in FOOT:
        below = int(np.flatnonzero(shares < share)[-1])
        part = (share - shares[below]) / (shares[below + 1] - shares[below])
        places.append(middle[below] + part * (middle[below + 1] - middle[below]))
    start = places[0] - FOOT[0] * (places[1] - places[0]) / (FOOT[1] - FOOT[0])
    return max(0, round(float(start)))
