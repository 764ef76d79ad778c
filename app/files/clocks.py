"""Whether the clock of the forces is that of the images: by the start of the motion, which images
and the shear force both show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.registration import NotRegistered, rigid_shift
from analysis.robust import robust_sd
from app.system.errors import UserError

F64 = NDArray[np.float64]
Image = NDArray[Any]

EVERYWHERE, AROUND = 24, 36  # images looked at over the whole, and around the start of the motion
LEAST_PX, SHARE = 0.1, 0.05  # of the motion: what must be exceeded for a start, px and of the whole
SMOOTH_S = 0.05  # forces are averaged over this time
FEWEST_MOVED = 7  # images that show the motion
NOISE_PX = 0.0005  # least noise of a displacement: none is taken to be better known
SIGNIFICANT = 6.0  # times the noise that the displacement of an image that moved exceeds
ORDER = 3  # order of the displacement as a polynomial in Q
AT_REST = 0.05  # share of the greatest Q by which Q changes at most while the block rests
RISING = 0.7  # of the greatest Q: beyond, a small change of Q is a large one of the displacement
WORST = 0.02  # a fit with a larger residual, as share of the motion, matches nothing
UNLIKE = 2.0  # times the residual of the best match that any other must have
MOST_TRIED = 20_000  # shifts of the clock
TOLERANCE = 0.5  # clocks closer than this share of the image period are the same


@dataclass(frozen=True, slots=True)
class StartOfMotion:
    """Displacement of the block in images around the start of its motion: times, s, and pixels."""

    times_s: F64
    u_px: F64


@dataclass(frozen=True, slots=True)
class Match:
    """How far the clock of the forces is ahead of that of the images, s, and its uncertainty."""

    ahead_s: float
    sd_s: float


def motion_of(
    times_s: Sequence[float], image: Callable[[int], Image | None]
) -> StartOfMotion | None:
    """How the block begins to move in a series of images; None if it does not, or nothing can be
    recognised.

    Parameters
    ----------
    image : callable
        The image of a number from 0 on, None where there is none.
    """
    seen: dict[int, tuple[float, float]] = {}
    count = len(times_s)
    start = next((n for n in range(min(count, EVERYWHERE)) if image(n) is not None), None)
    if start is None:
        return None
    first = image(start)
    assert first is not None
    lost: set[int] = set()

    def look(numbers: Sequence[int]) -> None:
        for n in numbers:
            if n in seen or n in lost:
                continue
            other = image(n)
            try:
                if other is None or other.shape != first.shape:
                    raise NotRegistered
                seen[n] = rigid_shift(first, other)
            except (NotRegistered, ValueError, UserError):
                lost.add(n)

    coarse = np.unique(np.linspace(start, count - 1, EVERYWHERE).round().astype(int)).tolist()
    look(coarse)
    known = sorted(seen)
    if len(known) < 4:
        return None
    shifts = np.array([seen[n] for n in known])
    whole = float(np.hypot(*(shifts - shifts[0]).T).max())
    far = np.hypot(*(shifts - shifts[0]).T) > max(LEAST_PX, SHARE * whole)
    if not far.any():
        return None
    k = int(np.argmax(far))
    low, high = known[max(0, k - 3)], known[min(len(known) - 1, k + 1)]
    look(np.unique(np.linspace(low, high, AROUND).round().astype(int)).tolist())
    near = [n for n in sorted(seen) if n <= high]
    shifts = np.array([seen[n] for n in near])
    along = shifts[-1] - shifts[0]
    u = (shifts - shifts[0]) @ (along / max(float(np.hypot(*along)), 1e-12))
    return StartOfMotion(np.array([times_s[n] for n in near]), u)


def matched(motion: StartOfMotion, times_s: F64, shear: F64, exposure_s: float) -> Match | None:
    """The shift of the forces' clock with which the displacement of the block is a smooth function
    of the shear force; None if there is none, or several.

    Before sliding the block's displacement follows Q, whatever the law of friction; so the start of
    both must coincide, and the way they grow.
    """
    known = np.isfinite(times_s) & np.isfinite(shear)
    at, q = times_s[known], shear[known]
    if len(at) < 8:
        return None
    step = max(float(np.median(np.diff(at))), 1e-6)
    width = max(1, round(SMOOTH_S / step))
    sums = np.cumsum(np.concatenate([[0.0], q]))
    mean = (sums[width:] - sums[:-width]) / width
    at = np.convolve(at, np.ones(width) / width, "valid")
    rise = mean - np.median(mean[: max(1, len(mean) // 50)])
    greatest = float(np.abs(rise).max())
    ends = at[int(np.argmax(np.abs(rise) > RISING * greatest))]
    middle, u = motion.times_s + exposure_s / 2, motion.u_px
    resting = u < 0.1 * u.max()
    noise = max(NOISE_PX, robust_sd(np.diff(u[resting])) / np.sqrt(2) if resting.sum() > 3 else 0)
    moved = u > SIGNIFICANT * noise
    if greatest <= 0 or moved.sum() < FEWEST_MOVED or (~moved).sum() < 2:
        return None

    def residual(ahead: float) -> tuple[float, int]:
        """Mean square in the noise, and how many images it is of."""
        places = middle + ahead
        used = (places >= at[0]) & (places <= ends)
        if (used & moved).sum() < FEWEST_MOVED or (used & ~moved).sum() < 2:
            return np.inf, 0
        x = np.interp(places[used], at, rise) / greatest
        rising = max(0.0, float(np.ptp(x[~moved[used]])) / AT_REST - 1)
        if rising > 2:
            return np.inf, 0
        design = np.stack([x**n for n in range(ORDER + 1)], axis=1)
        factors, *_ = np.linalg.lstsq(design, u[used], rcond=None)
        left = (u[used] - design @ factors) / noise
        mean = float(np.sum(left**2)) / max(1, len(left) - ORDER - 2)
        return (1 + mean) * (1 + rising) ** 4 - 1, len(left)

    apart = max(float(np.median(np.diff(motion.times_s))), step)
    low, high = at[0] - middle[-1], at[-1] - middle[0]
    fine = max(apart / 8, (high - low) / MOST_TRIED)
    grid = low + fine * np.arange(int((high - low) / fine) + 1)
    found = [residual(float(shift)) for shift in grid]
    chi2 = np.array([one for one, _ in found])
    if not np.isfinite(chi2).any():
        return None
    best = int(np.argmin(chi2))
    other = np.abs(grid - grid[best]) > max(8 * apart, 1.0)
    worst = max(2.0, WORST * float(np.ptp(u)) / noise) ** 2
    if chi2[best] > worst or (other.any() and chi2[other].min() < UNLIKE**2 * chi2[best]):
        return None
    # where the sum of squares exceeds its least value by that of one image
    more = max(1.0, chi2[best]) / max(1, found[best][1] - ORDER - 2)
    near = np.flatnonzero(chi2 <= chi2[best] + more)
    near = near[np.abs(near - best) < 2 + 4 * apart / fine]
    beside = chi2[max(0, near[0] - 2) : near[-1] + 3]
    if not np.isfinite(beside).all():  # too few images beside it to tell
        return None
    middle_of = float(grid[near[0]] + grid[near[-1]]) / 2
    return Match(middle_of, max(apart / 4, float(np.ptp(grid[near])) / 2))
