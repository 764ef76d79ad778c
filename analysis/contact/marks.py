"""Marks that stay in the picture while the block moves, as dust on the glass or on the camera's
window does: how much of the light passes them, from the free block and from the block moved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from analysis.arrays import F32, F64, I64, Array, Bool
from analysis.contact.registration import shifted
from analysis.kernels import compiled
from analysis.robust import robust_sd

CLEAR_PX = 2.5  # least motion of the block that tells it from marks
LEAST_SIDE = 160  # least side of a picture, px
FINE_PX, COARSE_PX = 0.5, 1.2  # smoothing in which marks are measured, and further: found
# standard deviations of the noise at which a mark may begin, which ends it, that it must reach
ENTER, STAY, CERTAIN = 4.0, 1.5, 6.0
LONGEST_PX = 64  # along the motion of the block
STREAK = 5.0  # times longer than wide along that motion: micro-contacts in a row, not a mark
FEWEST_PIXELS = 4
EXCESS = 4.0  # standard deviations of the noise, from which what is bright counts little
EDGE_PX = 6  # around what was found, where a mark is too faint to be found
SWEEPS = 20
LIGHT_PX = 61  # side of the box whose mean is the slow change of the light
THIN = 4  # of so many pixels along both axes one tells it
RIM_PX = 12
LEAST_T = np.float32(math.log(0.2))  # less light than this tells nothing
LEFT = 0.002  # share of the light, below which a pixel is left as it is
SEEN = 0.05  # share of the light, from which a mark is told
# of what is counted: pieces of one mark are no further apart, smaller ones are none
GAP_PX, SPECK_PX = 5, 3
# of the background where it is darker by 1: of its own texture or of micro-contacts it is not
LEAST_DARK, MOST_DARK = 0.6, 1.4


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks that stay.

    Attributes
    ----------
    count : int
        Those that take (or add) 5 % of the light or more.
    covered : float
        Share of the picture in which they do.
    darkest : float
        Share of the light that passes where the least does.
    where : ndarray of int, shape (n,)
        Pixels that they change, counted along the rows.
    passed : ndarray, shape (n,)
        Share of the light that passes there; above 1 where a mark scatters light into the picture.
    """

    count: int
    covered: float
    darkest: float
    where: I64
    passed: F32

    def __str__(self) -> str:
        return (
            f"{self.count} marks (dust) stay while the block moves, in {100 * self.covered:.2g} %"
            f" of the picture; the darkest lets {self.darkest:.0%} of the light pass"
        )

    def taken_off(self, image: Array) -> Array:
        """A picture, shape (rows, columns), as it would be without them; of the same type."""
        out = image.copy()
        grey = out.reshape(-1)[self.where] / self.passed
        if np.issubdtype(out.dtype, np.integer):
            grey = np.clip(np.rint(grey), 0, np.iinfo(out.dtype).max)
        out.reshape(-1)[self.where] = grey.astype(out.dtype)
        return out


def marks(background: Array, image: Array, shift: tuple[float, float]) -> Marks | None:
    """The marks that two pictures of a block have in common that has moved by `shift`; None where
    there are none, or where it has moved too little to tell.

    Parameters
    ----------
    background, image : ndarray, shape (rows, columns)
        Grey levels of the free block, and of the block moved, which may touch the glass.
    shift : (float, float)
        px along x and y.

    Notes
    -----
    With t the logarithm of the share of the light that passes, that of the image over the moved
    background is ``t(x) - t(x - shift)``, in which the texture is gone: a dark mark is there once
    dark, and once bright where the background's mark has been moved to. So t is a sum of these
    differences along the motion, from where there is no mark. It must come out the same from both
    sides: micro-contacts, which the background does not have, are bright only, and do not.
    """
    length = math.hypot(*shift)
    if length < CLEAR_PX or min(image.shape) < LEAST_SIDE:
        return None
    ratio, known = _logarithm(background, image, shift)
    noise = robust_sd(ratio[known][::7])
    if not noise > 0:
        return None
    # along x of the turned picture the block has moved by `step` whole pixels
    step = math.ceil(length)
    turn, size = _turned(shift, step / length, image.shape)
    fine = cv2.warpAffine(ratio, turn, size, flags=cv2.INTER_CUBIC)
    coarse = cv2.GaussianBlur(fine, (0, 0), COARSE_PX)
    inside = cv2.warpAffine(known.view(np.uint8), turn, size, flags=cv2.INTER_NEAREST) > 0
    coarse_noise = robust_sd(coarse[inside][::7])
    found = np.zeros_like(coarse)
    levels, most = (ENTER * coarse_noise, STAY * coarse_noise), LONGEST_PX // step
    if not _add_sums(coarse, step, levels, most, found):
        return None
    is_mark = _chosen(found, CERTAIN * coarse_noise, step)
    if not is_mark.any():
        return None
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * EDGE_PX + 1, 2 * EDGE_PX + 1))
    near = cv2.dilate(is_mark.view(np.uint8), reach) > 0
    found[~is_mark] = 0
    _settle(fine, step, near, EXCESS * noise, found)
    rows, columns = image.shape
    back = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    t = np.maximum(cv2.warpAffine(found, turn, (columns, rows), flags=back), LEAST_T)
    if not LEAST_DARK < _darkness(background, t) < MOST_DARK:
        return None
    where = np.flatnonzero(t)
    passed = np.exp(t.reshape(-1)[where])
    change = np.abs(passed - 1)
    seen = np.zeros(t.shape, np.uint8)
    seen.reshape(-1)[where] = change > SEEN
    whole = cv2.morphologyEx(seen, cv2.MORPH_OPEN, np.ones((SPECK_PX, SPECK_PX), np.uint8))
    whole = cv2.morphologyEx(whole, cv2.MORPH_CLOSE, np.ones((GAP_PX, GAP_PX), np.uint8))
    count = cv2.connectedComponents(whole)[0] - 1
    darkest, left = float(passed.min(initial=1.0)), change > LEFT
    return Marks(count, float(seen.mean()), darkest, where[left], passed[left])


def _darkness(background: Array, t: F32) -> float:
    """By how much the logarithm of the background changes with t: by 1 where the marks are real, as
    they are in it; 0 without marks.
    """
    grey = np.log(np.maximum(np.asarray(background, dtype=np.float32), 1))
    grey -= cv2.blur(grey, (LIGHT_PX, LIGHT_PX))
    square = float((t * t).sum(dtype=np.float64))
    return float((t * grey).sum(dtype=np.float64)) / square if square > 0 else 0.0


def _logarithm(background: Array, image: Array, shift: tuple[float, float]) -> tuple[F32, Bool]:
    """Logarithm of an image over the moved background, without the slow change of the light, and
    which pixels are known; 0 at the others.
    """
    moved = shifted(background, *shift)
    of_both, of_one = (
        np.maximum(cv2.GaussianBlur(moved * other, (0, 0), FINE_PX), np.float32(1))
        for other in (np.asarray(image, dtype=np.float32), moved)
    )
    ratio = np.log(of_both / of_one)
    rim = RIM_PX + math.ceil(max(map(abs, shift)))
    known = np.zeros(ratio.shape, np.bool_)
    known[rim:-rim, rim:-rim] = True
    inner = ratio[rim:-rim, rim:-rim]
    ratio -= np.float32(np.median(inner[::3, ::3]))
    some = np.ascontiguousarray(inner[::THIN, ::THIN])
    most, side, slow = 2 * robust_sd(some), LIGHT_PX // THIN, np.zeros_like(some)
    for _ in range(2):  # the second time without what the first has shown to stand out
        usual = (np.abs(some - slow) < most).astype(np.float32)
        weight = np.maximum(cv2.blur(usual, (side, side)), 0.05)
        slow = cv2.blur(some * usual, (side, side)) / weight
    inner -= cv2.resize(slow, inner.shape[::-1])
    ratio[~known] = 0
    return ratio, known


def _turned(
    shift: tuple[float, float], scale: float, shape: tuple[int, ...]
) -> tuple[F64, tuple[int, int]]:
    """The affine map, shape (2, 3), that turns the shift onto x and stretches the picture, and
    columns and rows of what it makes of it.
    """
    angle = math.atan2(shift[1], shift[0])
    c, s = scale * math.cos(angle), scale * math.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0]])
    rows, columns = shape
    corners = turn[:, :2] @ np.array([[0, columns, 0, columns], [0, 0, rows, rows]])
    turn[:, 2] = -corners.min(axis=1)
    width, height = np.ceil(np.ptp(corners, axis=1)).astype(int) + 1
    return turn, (int(width), int(height))


def _chosen(found: F32, certain: float, step: int) -> Bool:
    """Which pixels belong to a connected piece that is a mark."""
    n, piece, stats, _ = cv2.connectedComponentsWithStats(
        (found != 0).astype(np.uint8), connectivity=4
    )
    where = np.flatnonzero(found)
    of = piece.reshape(-1)[where]
    is_mark = np.zeros(n, np.bool_)
    is_mark[of[np.abs(found.reshape(-1)[where]) > certain]] = True
    long, wide, pixels = (
        stats[:, k] for k in (cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT, cv2.CC_STAT_AREA)
    )
    is_mark &= (long <= STREAK * wide + step) & (pixels >= FEWEST_PIXELS)
    chosen = np.zeros(found.shape, np.bool_)
    chosen.reshape(-1)[where] = is_mark[of]
    return chosen


@compiled
def _add_sums(ratio: F32, step: int, levels: tuple[float, float], most: int, out: F32) -> int:
    """Write marks of either sign, sums of `ratio` along the motion, and say how many there are.

    All begin where `ratio` is below minus the first of the levels: dark ones go on from there with
    the motion, bright ones against it, until the sum is below the second level; within `most`
    steps, else there is no mark. Where both are possible it is a dark one.
    """
    rows, columns = ratio.shape
    count = 0
    for i in range(rows):
        for sign in (-1, 1):
            for k in range(columns):
                begin = k if sign < 0 else columns - 1 - k
                if ratio[i, begin] > -levels[0] or out[i, begin] != 0:
                    continue
                total, greatest, steepest, n, j = 0.0, 0.0, 0.0, 0, begin
                while n <= most and 0 <= j < columns:
                    total -= ratio[i, j]
                    steepest = max(steepest, ratio[i, j])
                    if total < levels[1]:
                        break
                    greatest = max(greatest, total)
                    n, j = n + 1, j - sign * step
                is_closed = 0 < n <= most and 0 <= j < columns and steepest > levels[0]
                if not is_closed or total < -max(levels[0], greatest / 2):
                    continue
                total, j, count = 0.0, begin, count + 1
                for _ in range(n):
                    total -= ratio[i, j]
                    to = j if sign < 0 else j - step
                    if to >= 0:
                        out[i, to] = sign * total
                    j -= sign * step
    return count


@compiled
def _settle(ratio: F32, step: int, near: Bool, most: float, t: F32) -> None:
    """Improve t by least squares of ``ratio = t(x) - t(x - step)`` in the pixels `near` marks, and
    0 elsewhere; what `ratio` has in excess by more than `most` counts little, as a micro-contact.
    """
    rows, columns = ratio.shape
    at = np.empty(columns, np.int64)
    for i in range(rows):
        n = 0
        for j in range(step, columns - step):
            if near[i, j]:
                at[n] = j
                n += 1
        for sweep in range(SWEEPS):
            for k in range(n):
                j = at[k] if sweep % 2 == 0 else at[n - 1 - k]
                left, right = t[i, j - step] + ratio[i, j], t[i, j + step] - ratio[i, j + step]
                excess, next_excess = left - t[i, j], t[i, j] - right
                a = 1.0 if excess < most else (most / excess) ** 2
                b = 1.0 if next_excess < most else (most / next_excess) ** 2
                t[i, j] = (a * left + b * right) / (a + b)


def compile_marks() -> None:
    """Compile what the search needs, or load it from the cache."""
    nothing: Any = np.zeros((1, 8), np.float32)
    _add_sums(nothing, 2, (1.0, 1.0), 4, nothing.copy())
    _settle(nothing, 2, nothing > 0, 1.0, nothing.copy())
