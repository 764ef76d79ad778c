"""Whether the clock of the forces is that of the images: by the start of the motion, which images
and the shear force both show, and by what the block does all the time that both cover.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64, Array, Bool
from analysis.contact.registration import NotRegistered, rigid_shift
from analysis.robust import robust_sd, serial_inflation, white_noise
from app.system.errors import UserError

EVERYWHERE, AROUND = 72, 36  # images looked at over the whole, and around each start of a motion
LEAST_PX, SHARE = 0.1, 0.05  # of a motion: what must be exceeded for a start, px and of the whole
LEAST_REST = 3  # images of a block at rest
SHORTEST = 0.5  # share of the time in which a motion is seen that the rest before it lasts
STILL = 8.0  # times the noise within which the images of a rest lie
FASTER = 3.0  # times the drift of a rest that a motion after it is
SMOOTH_S = 0.05  # forces are averaged over this time
FEWEST_MOVED = 7  # images that show the motion
NOISE_PX = 0.0005  # least noise of a displacement: none is taken to be better known
SIGNIFICANT = 6.0  # times the noise that the displacement of an image that moved exceeds
ORDER = 3  # order of the displacement as a polynomial in Q
AT_REST = 0.05  # share of the greatest Q by which Q changes at most while the block rests
CLEARLY = 3 * AT_REST  # a larger change of Q contradicts images of a block at rest
LEAST_MOVED = 0.25  # share of the displacement that a change of Q makes in a match
CROSS_TALK = 0.1  # of P, that may be read as Q
FOOT = 0.1  # of the time in which P rises, which may pass until it is seen to
SETTLED = 0.9  # of the load: P of a block that has been pressed
FREE = 0.2  # of the load: P of a block that nothing holds
RISING = 0.7  # of the greatest Q: beyond, a small change of Q is a large one of the displacement
WORST = 0.02  # a fit with a larger residual, as share of the motion, matches nothing
UNLIKE = 2.0  # times the residual of the best match that any other must have
STIFFER = 0.7  # share of the compliance in the middle that the one at the end has at least
DOUBT = 4.0  # rise of the sum of squares, of one image, up to which a shift may be the best
PACES = 16  # the pace of the motion is taken over this part of what is matched
NOISY = 6.0  # times its noise that a change of a force exceeds
MOST_TRIED = 20_000  # shifts of the clock
TOLERANCE = 0.5  # clocks closer than this share of the image period are the same

NOTHING: F64 = np.empty(0)


@dataclass(frozen=True, slots=True)
class StartOfMotion:
    """Displacement of the block in images around the start of a motion: times, s, and pixels."""

    times_s: F64
    u_px: F64


@dataclass(frozen=True, slots=True)
class Match:
    """How far the clock of the forces is ahead of that of the images, s, and its uncertainty; with
    how far a change of Q moves the block, 0 if that is not known.
    """

    ahead_s: float
    sd_s: float
    px_per_n: float = 0.0

    def agrees(self, other: Match) -> bool:
        """Whether both are the same clock, within three standard uncertainties."""
        return abs(self.ahead_s - other.ahead_s) <= 3 * (self.sd_s + other.sd_s)


@dataclass(frozen=True, slots=True)
class _Start:
    """A motion after a rest: numbers of the first and the last image at rest, of the image that
    has clearly moved, and of the last before the next rest.
    """

    rests: int
    begins: int
    moved: int
    ends: int


@dataclass(frozen=True, slots=True)
class MotionInImages:
    """Displacement of the block in a series of images: times, s, and (dx, dy) of each, px."""

    times_s: F64
    shift_px: F64

    @property
    def noise_px(self) -> float:
        """Noise of one displacement, from how far each image lies beside its neighbours."""
        t, u = self.times_s, self.shift_px
        share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
        beside = u[1:-1] - (1 - share) * u[:-2] - share * u[2:]
        beside /= np.sqrt(1 + share**2 + (1 - share) ** 2)
        return max(NOISE_PX, robust_sd(beside.ravel()))

    def rests(self) -> list[tuple[int, int]]:
        """The first and the last image of each time at rest."""
        found: list[tuple[int, int]] = []
        begin, still = 0, STILL * self.noise_px
        while begin < len(self.shift_px):
            on = self.shift_px[begin:]
            spans = np.maximum.accumulate(on) - np.minimum.accumulate(on)
            count = int((np.hypot(*spans.T) <= still).sum())
            if count >= LEAST_REST:
                found.append((begin, begin + count - 1))
            begin += count if count >= LEAST_REST else 1
        return found

    def starts(self) -> list[_Start]:
        """The motions that begin from a rest."""
        rests, found, t = self.rests(), dict[int, _Start](), self.times_s
        for n, (first, last) in enumerate(rests):
            away = self._away(first, last)
            ends = rests[n + 1][0] if n + 1 < len(rests) else len(t) - 1
            least = max(LEAST_PX, 2 * STILL * self.noise_px)
            beyond = away > max(least, SHARE * float(away[last : ends + 1].max()))
            beyond[: last + 1] = False
            if not beyond.any():
                continue
            moved = int(np.argmax(beyond))
            rested, took = t[last] - t[first], t[moved] - t[last]
            drift = self._away(first, first)[last] / rested
            if away[moved] / took > FASTER * drift and rested > SHORTEST * took:
                # a motion begins after the last rest before it is seen
                found[moved] = _Start(first, last, moved, max(ends, moved))
        return list(found.values())

    def around(self, start: _Start) -> StartOfMotion:
        """The images of the rest and of the motion that follows, along that motion."""
        last = min(max(self.until(start), start.begins + 2 * FEWEST_MOVED), len(self.times_s) - 1)
        shifts = self.shift_px[start.rests : last + 1]
        along = self.shift_px[start.moved] - self.shift_px[start.begins]
        u = (shifts - shifts[0]) @ (along / np.hypot(*along))
        return StartOfMotion(self.times_s[start.rests : last + 1], u)

    def until(self, start: _Start) -> int:
        """The image up to which a start is looked at: as long again as it takes to be seen."""
        t = self.times_s
        return int(np.searchsorted(t, 2 * t[start.moved] - t[start.begins]))

    def _away(self, first: int, last: int) -> F64:
        """Distance of each image from the place where images `first` to `last` are."""
        place = self.shift_px[first : last + 1].mean(axis=0)
        return np.asarray(np.hypot(*(self.shift_px - place).T))


def motion_of(
    times_s: Sequence[float], image: Callable[[int], Array | None]
) -> MotionInImages | None:
    """How the block moves in a series of images, looked at more closely where motions begin; None
    if it does not move, or nothing can be recognised.

    Parameters
    ----------
    image : callable
        The image of a number from 0 on, None where there is none.
    """
    count = len(times_s)
    reference = next((n for n in range(min(count, EVERYWHERE)) if image(n) is not None), None)
    if reference is None:
        return None
    first = image(reference)
    assert first is not None
    seen: dict[int, tuple[float, float]] = {}

    def look(begin: float, end: float, at_most: int) -> MotionInImages:
        numbers = np.unique(np.linspace(begin, end, at_most).round().astype(int))
        for n in numbers[~np.isin(numbers, list(seen))].tolist():
            other = image(n)
            try:
                if other is None or other.shape != first.shape:
                    raise NotRegistered
                seen[n] = rigid_shift(first, other)
            except (NotRegistered, ValueError, UserError):
                seen[n] = (np.nan, np.nan)
        found = [n for n in seen if np.isfinite(seen[n]).all()]
        at, order = np.unique([times_s[n] for n in found], return_index=True)
        return MotionInImages(at, np.array([seen[n] for n in found]).reshape(-1, 2)[order])

    motion = look(reference, count - 1, EVERYWHERE)
    if len(motion.times_s) < 2 * LEAST_REST:
        return None
    for start in motion.starts():
        coarse = motion.times_s
        before, after = max(start.begins - 3, 0), min(motion.until(start) + 1, len(coarse) - 1)
        begin, end = np.searchsorted(times_s, coarse[[before, after]]).tolist()
        fine = look(begin, end, AROUND)
    return fine if motion.starts() else None


def matches(
    motion: StartOfMotion,
    times_s: F64,
    shear: F64,
    exposure_s: float,
    from_s: float = -math.inf,
) -> list[Match]:
    """The shifts of the forces' clock with which the displacement of the block is a smooth function
    of the shear force: all that fit nearly as well as the best, which is the first. Forces before
    `from_s` are left out.

    Before sliding the block's displacement follows Q, whatever the law of friction; so the start of
    both must coincide, and the way they grow.
    """
    q = _Averaged.of(times_s, shear)
    if q is None:
        return []
    at, greatest, begins = q.at_s, q.greatest, max(from_s, float(q.at_s[0]))
    step = float(np.median(np.diff(at)))
    ends = at[int(np.argmax(np.abs(q.rise) > RISING * greatest))]
    middle, u = motion.times_s + exposure_s / 2, motion.u_px
    resting = u < 0.1 * u.max()
    noise = max(NOISE_PX, robust_sd(np.diff(u[resting])) / np.sqrt(2) if resting.sum() > 3 else 0)
    moved = u > SIGNIFICANT * noise
    if greatest <= 0 or moved.sum() < FEWEST_MOVED or (~moved).sum() < 2:
        return []

    def used_with(ahead: float) -> Bool:
        """Images during which Q is known and still rises."""
        places = middle + ahead
        return np.asarray((places >= begins) & (places <= ends))

    def risen(times: F64) -> F64:
        """Q in its greatest rise."""
        return np.interp(times, at, q.rise) / greatest

    def residual(ahead: float) -> tuple[float, F64]:
        """Mean square in the noise, and what is left of each image."""
        used = used_with(ahead)
        if (used & moved).sum() < FEWEST_MOVED or (used & ~moved).sum() < 2:
            return np.inf, NOTHING
        x = risen(middle[used] + ahead)
        # an image that does not seem to move may have moved by as much as the noise hides
        hidden = SIGNIFICANT * noise * float(np.ptp(x)) / float(np.ptp(u[used]))
        rising = max(0.0, float(np.ptp(x[~moved[used]])) / (AT_REST + hidden) - 1)
        if rising > 2:
            return np.inf, NOTHING
        left = _beside(x, u[used]) / noise
        return (1 + _mean_square(left)) * (1 + rising) ** 4 - 1, left

    def scatter(ahead: float, left: F64) -> tuple[float, float]:
        """Standard deviation of a shift: what it moves and no polynomial makes up for, against
        what is left of each image; and the time in which Q rises by its noise. Infinite if the
        contact stiffens, which none does.
        """
        used = used_with(ahead)
        places = middle[used] + ahead
        x = risen(places)
        fit = np.polynomial.Polynomial.fit(x, u[used], ORDER)
        half, end = fit.deriv()(x.min() + np.array([0.5, 0.95]) * np.ptp(x))
        if end < STIFFER * half:
            return np.inf, 0.0
        late = max(apart, float(np.ptp(places)) / PACES)
        pace = _beside(x, (fit(risen(places + late)) - fit(risen(places - late))) / (2 * late))
        square = max(1.0, _mean_square(left))
        size = max(float(np.sqrt(pace @ pace)), 1e-12)
        hidden = 2 * q.noise / greatest * float(np.ptp(places[moved[used]]) / np.ptp(x))
        sd = math.hypot(noise * math.sqrt(square * serial_inflation(left)) / size, hidden)
        return sd, float(np.ptp(u[used]) / np.ptp(x)) / greatest

    apart = max(float(np.median(np.diff(motion.times_s))), step)
    low, high = at[0] - middle[-1], at[-1] - middle[0]
    fine = max(apart / 8, (high - low) / MOST_TRIED)
    grid = low + fine * np.arange(int((high - low) / fine) + 1)
    found = [residual(float(shift)) for shift in grid]
    chi2 = np.array([one for one, _ in found])
    left, matches = chi2.copy(), list[Match]()
    if not chi2.min(initial=np.inf) <= max(2.0, WORST * float(np.ptp(u)) / noise) ** 2:
        return []
    while left.min() <= UNLIKE**2 * chi2.min():
        best = int(np.argmin(left))
        left[np.abs(grid - grid[best]) <= max(8 * apart, 1.0)] = np.inf
        rest = found[best][1]
        sd, compliance = scatter(float(grid[best]), rest)
        free = max(1, len(rest) - ORDER - 2)
        # where the sum of squares exceeds its least value by that of some independent images, and
        # by as much as another draw of the noise of Q changes it
        more = DOUBT * max(1.0, chi2[best]) * serial_inflation(rest) / free
        more += math.sqrt(2 * DOUBT / free) * (compliance * q.noise / noise) ** 2
        near = np.flatnonzero(chi2 <= chi2[best] + more)
        near = near[np.abs(near - best) < 2 + 4 * apart / fine]
        beside = chi2[max(0, near[0] - 2) : near[-1] + 3]
        if not np.isfinite(beside).all():  # too few images beside it to tell
            return []
        middle_of = float(grid[near[0]] + grid[near[-1]]) / 2
        if np.isfinite(sd):
            sd = max(apart / 4, float(np.ptp(grid[near])) / 2, sd)
            matches.append(Match(middle_of, sd, compliance))
    return matches


def _beside(x: F64, u: F64) -> F64:
    """What a polynomial in x leaves of u."""
    design = np.stack([x**n for n in range(ORDER + 1)], axis=1)
    return u - design @ np.linalg.lstsq(design, u, rcond=None)[0]


def _mean_square(left: F64) -> float:
    """Of what a fit leaves."""
    return float(np.sum(left**2)) / max(1, len(left) - ORDER - 2)


def clocks_of(
    motion: MotionInImages, times_s: F64, normal: F64, shear: F64, exposure_s: float
) -> list[Match]:
    """The shifts of the forces' clock that images and forces allow: none, the one, or several
    between which nothing decides.

    Every motion of the block is compared with Q, as in `matches`: pressing may move it too. A shift
    is refused if Q changes clearly and the block does not move, or if a loaded block begins to move
    and no force changes; of those left the one that explains most motions is the clock. If it
    explains one only, that may be the motion of pressing: then the clock by the start of the rise
    of P is possible as well.
    """
    known = np.isfinite(shear)
    q = _Averaged.of(times_s[known] - exposure_s / 2, shear[known])
    p = _Averaged.of(times_s[known] - exposure_s / 2, np.nan_to_num(normal[known]))
    if p is None or q is None:
        return []
    forces = _ForceRises(p, q)
    found: list[tuple[int, Match]] = []
    for start in motion.starts():
        for match in matches(motion.around(start), times_s, shear, exposure_s, forces.settled_s):
            explained = forces.explained(motion, match)
            if explained:
                found.append((explained, match))
                if explained == 1 and (other := forces.pressing(motion, start)) is not None:
                    found.append((1, other))
    most = max((explained for explained, _ in found), default=0)
    possible: list[Match] = []
    for match in sorted((one for n, one in found if n == most), key=lambda one: one.sd_s):
        if not any(match.agrees(other) for other in possible):
            possible.append(match)
    return possible


def only_clock(clocks: Sequence[Match]) -> Match | None:
    """The clock that images and forces allow; None if there is none.

    Raises
    ------
    UserError
        Several are possible.
    """
    if len(clocks) > 1:
        ahead = " or ".join(f"{one.ahead_s:.3f} ± {one.sd_s:.3f}" for one in clocks)
        raise UserError(
            f"import: by the motion in the images the clock of the forces is {ahead} s ahead of"
            " that of the images, and it is unknown which of them is right; give --time-offset"
            f" {' or '.join(f'{-one.ahead_s:.3f}' for one in clocks)}, or 0 if both clocks agree"
        )
    return clocks[0] if clocks else None


@dataclass(frozen=True, slots=True)
class _Averaged:
    """Rise of a force from where it begins, averaged over a short time around each of `at_s`."""

    at_s: F64
    rise: F64
    noise: float

    @classmethod
    def of(cls, times_s: F64, force: F64) -> _Averaged | None:
        """None if there are too few values."""
        known = np.isfinite(times_s) & np.isfinite(force)
        at, values = times_s[known], force[known]
        if len(at) < 8:
            return None
        width = max(1, round(SMOOTH_S / max(float(np.median(np.diff(at))), 1e-6)))
        if len(at) < width + 2:
            return None
        sums = np.cumsum(np.concatenate([[0.0], values]))
        mean = (sums[width:] - sums[:-width]) / width
        at = np.convolve(at, np.ones(width) / width, "valid")
        rise = mean - np.median(mean[: max(1, len(mean) // 50)])
        return cls(at, rise, white_noise(values) / math.sqrt(width))

    @property
    def greatest(self) -> float:
        """Of the size of the rise."""
        return float(np.abs(self.rise).max())

    def between(self, begin: float, end: float) -> F64:
        """The rise from one time to another."""
        low, high = np.searchsorted(self.at_s, [begin, end])
        return self.rise[low:high]

    def span(self, begin: float, end: float) -> float:
        """By how much the force changes from one time to another."""
        values = self.between(begin, end)
        return float(np.ptp(values)) if len(values) else 0.0

    def clear(self, share: float) -> float:
        """A change that exceeds the noise and a share of the greatest."""
        return max(share * self.greatest, NOISY * self.noise)

    def risen(self, share: float) -> float:
        """When a share of the greatest is reached."""
        return float(self.at_s[int(np.argmax(np.abs(self.rise) > share * self.greatest))])


@dataclass(frozen=True, slots=True)
class _ForceRises:
    """P and Q, in the middle of whose times images were exposed."""

    p: _Averaged
    q: _Averaged

    @property
    def are_pressing(self) -> bool:
        """Whether P rises."""
        return self.p.greatest > self.p.clear(0)

    @property
    def settled_s(self) -> float:
        """When P has reached the load; P that is read as Q changes no more from then on."""
        size = np.abs(self.p.rise)
        load = float(np.median(size[size >= 0.5 * self.p.greatest]))
        return (
            float(self.p.at_s[int(np.argmax(size > SETTLED * load))])
            if self.are_pressing
            else -math.inf
        )

    def _contradicts(self, motion: MotionInImages, match: Match) -> bool:
        """Whether Q changes clearly and the block does not move as the match wants it."""
        t, u = motion.times_s + match.ahead_s, motion.shift_px
        inside = np.flatnonzero((t >= self.q.at_s[0]) & (t <= self.q.at_s[-1]))
        p, q = (np.interp(t, force.at_s, force.rise) for force in (self.p, self.q))
        for n in inside.tolist():
            change = np.abs(q - q[n]) - CROSS_TALK * np.abs(p - p[n])
            beyond = inside[(inside > n) & (change[inside] > self.q.clear(CLEARLY))]
            if len(beyond):
                there = u[max(n - 1, 0) : beyond[0] + 2]
                moved = float(np.hypot(*np.ptp(there, axis=0)))
                least = LEAST_MOVED * match.px_per_n * float(change[beyond[0]])
                if moved < max(STILL * motion.noise_px, least):
                    return True
        return False

    def explained(self, motion: MotionInImages, match: Match) -> int:
        """How many motions begin where a force changes, if the clock is so far ahead; 0 if what
        images and forces show contradict each other.
        """
        t, p, q = motion.times_s + match.ahead_s, self.p, self.q
        if self._contradicts(motion, match):
            return 0
        count = 0
        for start in motion.starts():
            span = t[max(start.begins - 1, 0)], t[start.moved]
            if span[0] < q.at_s[0] or span[1] > q.at_s[-1]:
                continue
            slides = np.abs(q.between(*span)).max(initial=0) > RISING * q.greatest
            free = self.are_pressing and np.abs(p.between(*span)).max(initial=0) < FREE * p.greatest
            if q.span(*span) > q.clear(AT_REST) or p.span(*span) > p.clear(AT_REST):
                count += 1
            elif not slides and not free:
                return 0
        return count

    def pressing(self, motion: MotionInImages, start: _Start) -> Match | None:
        """The clock if a motion is that of pressing; None if it cannot be."""
        if not self.are_pressing:
            return None
        begin, end = self.p.risen(AT_REST), self.p.risen(1 - AT_REST)
        apart = float(np.median(np.diff(motion.times_s)))
        # both begin smoothly, and are seen a part of their time later
        sd = max(apart, FOOT * (end - begin))
        match = Match(begin - float(motion.times_s[start.begins]), sd)
        t = motion.times_s + match.ahead_s
        gone = motion.shift_px - motion.shift_px[start.begins]
        size = np.hypot(*gone.T)
        until = min(float(t[start.ends]), self.q.risen(CLEARLY))
        then, whole = np.interp([end + apart, until], t, size)
        if whole > 2 * then:
            return None
        return match if self.explained(motion, match) else None
