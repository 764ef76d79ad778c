"""What a run itself tells of readings that the settings do not explain: the zeros of the force
sensors, what each reads of the other force, how late they read, and a drift of the picture at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64
from analysis.mechanics.relaxation import lag_weights
from analysis.options import options
from analysis.robust import robust_sd, serial_inflation
from analysis.settings import Sample
from app.evaluation.history import DriveForces
from app.evaluation.setup import hertz_radius_m
from app.records.record_types import Phase, RingProfile, Snapshot
from app.records.snapshot_numbers import all_series, known_series
from app.settings.sections import Config

CERTAIN = 4.0  # standard uncertainties from which something is there
FEWEST = 6  # frames of one phase from which they tell anything
FEWEST_SHEARED = 24  # frames of the drive that tell P against Q
UNLOADED = 0.1  # share of P under load: below it the faces are apart
LAGGING = 0.003  # share of Q from which a relaxation is said
# time constants that are tried: from so many frames up to so many drives
QUICKEST, SLOWEST, TIMES = 8.0, 4.0, 40
CHANGED = 0.01  # share from which a change of Q over traction is said
BACK = 0.25  # share of the block's way from which a drive turns back
SHAKEN_PX = 0.02  # jumps of the picture from frame to frame from which they matter
SLID_M = 5e-6  # way of the stage in sliding from which both are compared
OF_BOTH = 2.0  # standard uncertainties of the inputs by which picture and stage may differ
BEFORE_SLIDING = 0.95  # share of the greatest Q below which nothing slides yet
# samples that lie so close to the greatest or the least reading, in standard deviations of their
# noise, from which a sensor is at the end of its range: more than noise puts within one of those
CLOSE, AT_END = 0.2, 24

Measure = tuple[float, float]  # a value and its standard uncertainty
UNKNOWN = math.nan, math.nan


class Readings(NamedTuple):
    """What was seen beyond the uncertainties of the settings, 0 for nothing.

    Attributes
    ----------
    zero, zero_drift : (float, float)
        Of P and Q, newtons, and by how much it drifts, N/s.
    coupling : (float, float)
        Share of Q in the reading of P, and of P in that of Q.
    drift : float
        Of the contact in the picture at rest, m/s.
    delay : float
        Of Q behind the shear force that the pictures show, seconds; of a drive that turns back.
    rest_s : float
        From the reference to the start of the drive: so long anything may have drifted before.
    notes : tuple of str
        Each of them in a sentence.
    """

    zero: tuple[float, float] = (0.0, 0.0)
    coupling: tuple[float, float] = (0.0, 0.0)
    drift: float = 0.0
    delay: float = 0.0
    rest_s: float = 0.0
    notes: tuple[str, ...] = ()
    zero_drift: tuple[float, float] = (0.0, 0.0)


NOTHING_SEEN = Readings()


def readings(
    config: Config,
    snapshots: list[Snapshot],
    drive: list[Snapshot],
    whole: Sequence[Snapshot] = (),
    forces: DriveForces | None = None,
) -> Readings:
    """What the frames of a run show of its sensors and its picture, and the samples of the drive;
    `drive` are the frames of the first loading, `whole` those of all legs.
    """
    stated, notes = config.uncertainty, list[str]()
    background, rest = _of(Phase.BACKGROUND, snapshots), _of(Phase.REFERENCE, snapshots)
    loaded, free = _mean(_forces(rest)), _forces(background)
    most, after = UNLOADED * loaded[0][0], _of(Phase.END, snapshots)
    apart = [s for s in after if abs(s.conditions.normal_force_n) < most]
    before, since = _mean(free), _mean(_forces(apart))
    zero, zero_drift = [0.0, 0.0], [0.0, 0.0]
    for when, (means, errors) in (("before contact", before), ("after separation", since)):
        for i, name in enumerate("PQ"):
            mean, sd = float(means[i]), float(errors[i])
            if _is_seen(mean, sd, stated.zero):
                zero[i] = max(zero[i], abs(mean))
                notes.append(
                    f"forces: {when}, without a force, {name} reads {1e3 * mean:.2f} +-"
                    f" {1e3 * sd:.2g} mN (uncertainty.zero is {1e3 * stated.zero:g} mN); it is not"
                    f" taken off, and the uncertainties include it: zero the sensors"
                )
    between_s = _middle_s(config, apart) - _middle_s(config, background)
    for i, name in enumerate("PQ"):
        change, sd = float(since[0][i] - before[0][i]), math.hypot(before[1][i], since[1][i])
        if _is_seen(change, sd, stated.zero):
            zero_drift[i] = abs(change) / between_s
            notes.append(
                f"forces: from before contact until after separation, {between_s:.0f} s, the zero"
                f" of {name} drifted by {1e3 * change:.2f} +- {1e3 * sd:.2g} mN; it is not taken"
                " off, and the uncertainties include it"
            )
    pressed = [
        float(a - (b if math.isfinite(b) else 0.0))
        for a, b in zip(loaded[0], before[0], strict=True)
    ]
    coupling = [0.0, 0.0]
    if pressed[0] > 0:
        share = pressed[1] / pressed[0]
        known = [sd if math.isfinite(sd) else stated.zero for sd in before[1]]
        sd = math.hypot(loaded[1][1], known[1]) / pressed[0]
        if _is_seen(share, sd, stated.coupling):
            coupling[1] = abs(share)
            notes.append(
                f"forces: as the contact was pressed, Q came to read {100 * share:.2f} +-"
                f" {100 * sd:.2g} % of P (uncertainty.coupling is {100 * stated.coupling:g} %): a"
                " cross term that forces.coupling does not have, or a shear that the pressing left;"
                " the uncertainties include it"
            )
    both = (forces.normal_n, forces.shear_n) if forces else ()
    for name, y, before_contact in zip("PQ", both, free, strict=False):
        for end, which in ((1.0, "greatest"), (-1.0, "least")):
            count = _at_end(end * y)
            is_held = len(y) > 0 and before_contact.any() and np.ptp(y) == 0
            if end > 0 and is_held and np.ptp(before_contact) > 0:
                count = len(y)  # it was at the end before the drive began
            if count:
                notes.append(
                    f"forces: {count} of {len(y)} samples of the drive are the {which} reading of"
                    f" {name}, {end * np.nanmax(end * y):.4g} N, without its noise: the sensor or"
                    " its conditioner is at the end of its range, so that what rests on"
                    f" {name} is wrong beyond its uncertainty: make room in its gap or its range"
                )
    (share, sd), (crept, crept_sd) = _changes_of_load(drive)
    if _is_seen(crept, crept_sd, stated.zero):
        notes.append(
            f"forces: in the course of the loading P changed by {1e3 * crept:.1f} +-"
            f" {1e3 * crept_sd:.2g} mN, beside what follows Q: the block relaxes (viscoelastic),"
            " the load creeps, or the zero of P drifts; Q/P takes P as it is read"
        )
    if _is_seen(share, sd, stated.coupling):
        coupling[0] = abs(share)
        notes.append(
            f"forces: as the contact was sheared, P changed by {100 * share:.2f} +- {100 * sd:.2g}"
            f" % of Q (uncertainty.coupling is {100 * stated.coupling:g} %): a cross term that"
            " forces.coupling does not have, or a load that changes with the shear; the"
            " uncertainties include it"
        )
    drift, sd = _drift_at_rest(config, rest, float(loaded[0][0]))
    seen = _is_seen(drift, sd, stated.drift)
    if seen:
        notes.append(
            f"drift: at rest under load the contact creeps by {1e6 * drift:.4f} +- {1e6 * sd:.2g}"
            f" um/s in the picture (uncertainty.drift is {1e6 * stated.drift:g} um/s): let camera,"
            " lens and block come to rest; it is not taken off, and the uncertainties include it"
        )
    jumps, noise = _jumps(_of(Phase.DRIVE, snapshots))
    if jumps > max(CERTAIN * noise, SHAKEN_PX * config.camera.pixel):
        is_given = config.camera.angle_from == "angle"
        notes.append(
            "picture: before the contact slides its centre jumps from frame to frame by"
            f" {jumps / config.camera.pixel:.2g} px, {jumps / noise:.0f} times its noise: camera,"
            " lens or table shake. c and the traction of a frame are hardly touched; t_s, mu_s, L"
            " and the direction of the drive may be off beyond their uncertainties, or not be"
            " found: hold the camera still"
            + (", and give camera.angle with camera.angle_from = 'angle'" * (not is_given))
        )
    # in a drive one way, an error of the traction's shape looks like a delay
    delay, sd = _pictures_behind_forces(whole)[0] if _turns_back(whole) else UNKNOWN
    late = delay > max(CERTAIN * sd, stated.delay)
    if late:
        notes.append(
            f"forces: Q is read {1e3 * delay:.0f} +- {1e3 * sd:.2g} ms after the shear that the"
            f" pictures show (beyond forces.delay, {1e3 * config.forces.delay:g} ms): a delay or a"
            " filter of the sensors, if it is the same at another velocity; the uncertainties"
            f" include it: replay with --set forces.delay={1e3 * (delay + config.forces.delay):.3g}"
        )
    # forth and back, what depends on time is no line over the displacement
    _, (change, change_sd) = _pictures_behind_forces(drive)
    relaxes, given = relaxation_of(drive), config.sample.relaxation > 0
    # less than nothing is a fault of another kind, unless too much is given
    also = relaxes.is_seen and (given or relaxes.share > 0)
    if _is_seen(change, change_sd, CHANGED) or also:
        which = "other values of sample.relaxation and sample.relaxation_time"
        if also and not given and relaxes.can_be_set:
            which = (
                f"--set sample.relaxation={relaxes.share:.3g}"
                f" --set sample.relaxation_time={relaxes.time_s:.3g}, which would fit this run"
            )
        zero_drift[1] = max(zero_drift[1], _drift_of_shear(drive))
        notes.append(
            "forces: in the course of the loading Q over the shear that the pictures show changed"
            f" by {100 * change:.1f} +- {100 * change_sd:.2g} %: the lens distorts beyond"
            " camera.distortion, the zero of Q drifts, or the modulus of the block depends on time"
            " (viscoelastic). E is then a mean over the loading, and the uncertainties include what"
            " a drift of that zero would do; L and t_s may be off beyond theirs: drive more slowly,"
            f" or, if focus, light and zeros were steady, replay with {which}"
        )
    return Readings(
        (zero[0], zero[1]),
        (coupling[0], coupling[1]),
        abs(drift) if seen else 0.0,
        delay if late else 0.0,
        _rest_s(config, rest, drive),
        tuple(notes),
        (zero_drift[0], zero_drift[1]),
    )


def creep_in_sliding(config: Config, drive: list[Snapshot], steady_s: float) -> tuple[str, ...]:
    """A sentence, if the picture creeps while the contact slides steadily: in the frames of the
    first loading from that time of the drive on, NaN if there are none.
    """
    stated = config.uncertainty
    (more, sd), speed = _beyond_stage(config, drive, steady_s)
    alike = math.hypot(stated.pixel, stated.drift / speed if speed else math.inf)
    if not _is_seen(more, sd, max(OF_BOTH * alike, CHANGED)):
        return ()
    return (
        f"drift: in sliding the block moves {100 * abs(more):.1f} +- {100 * sd:.2g} %"
        f" {'further' if more > 0 else 'less far'} in the picture than by the stage: camera or"
        f" lens creep by {1e6 * more * speed:.3f} um/s along the drive, and t_s and L are off"
        " beyond their uncertainties; or camera.pixel, or what the stage reads, is off by that"
        " share",
    )


def _is_seen(value: float, sd: float, stated: float) -> bool:
    return abs(value) > max(CERTAIN * sd, stated)


def _of(phase: Phase, snapshots: list[Snapshot]) -> list[Snapshot]:
    """The frames of one phase."""
    return [s for s in snapshots if s.conditions.phase is phase]


def _forces(frames: list[Snapshot]) -> F64:
    """P and Q of those frames in which they are known, shape (2, n)."""
    return known_series(frames, "normal_force_n", "shear_force_n")


def _mean(forces: F64) -> tuple[F64, F64]:
    """Means of P and Q, and their standard uncertainties; NaN of few frames."""
    n = forces.shape[1]
    if n < FEWEST:
        return np.full(2, math.nan), np.full(2, math.nan)
    return forces.mean(axis=1), forces.std(axis=1, ddof=1) / math.sqrt(n)


def _middle_s(config: Config, frames: list[Snapshot]) -> float:
    """Mean time of frames on the clock of the samples, NaN of none."""
    samples = [s.sample for s in frames]
    return float(np.mean(samples)) / config.forces.sample_rate if samples else math.nan


def _at_end(y: F64) -> int:
    """How many samples are at their greatest, shape (n,), NaN where one is missing; 0 for those
    that noise, steps of a converter, or lines between the rows of a table put there.
    """
    y = y[np.isfinite(y)]
    if len(y) < 2 * AT_END:
        return 0
    # of those that are not at the end, if these are a tenth or more: 99 % are below 2.58
    noise = float(np.quantile(np.abs(np.diff(y, 2)), 0.99)) / (2.58 * math.sqrt(6))
    below = float(y.max()) - y
    count = int(np.count_nonzero(below < CLOSE * noise))
    free = np.abs(np.diff(y, 2))[below[1:-1] > noise]
    is_read = len(free) > 0 and float(np.median(free)) > CLOSE * noise
    steps = below[below > 1e-9 * noise]
    is_fine = len(steps) > 0 and float(steps.min()) < noise / 2
    near = int(np.count_nonzero(below < noise)) - count
    return count if is_read and is_fine and count > max(AT_END, near) else 0


def _changes_of_load(drive: list[Snapshot]) -> tuple[Measure, Measure]:
    """Share of Q in P as the contact is sheared, and the change of P in time beside it, newtons."""
    P, Q, t = known_series(drive, "normal_force_n", "shear_force_n", "time_s")
    if len(P) < FEWEST_SHEARED:
        return UNKNOWN, UNKNOWN
    # once the contact slides, Q follows each change of P: its mean is what P may follow
    sliding = np.maximum.accumulate(Q) > BEFORE_SLIDING * Q.max()
    if not sliding.any():  # Q is against the drive
        return UNKNOWN, UNKNOWN
    columns = np.column_stack(
        [np.ones(len(P)), np.where(sliding, Q[sliding].mean(), Q), t - t.mean()]
    )
    _, share, (rate, sd) = _fitted(columns, P)
    return share, (rate * float(np.ptp(t)), sd * float(np.ptp(t)))


def _beyond_stage(config: Config, drive: list[Snapshot], steady_s: float) -> tuple[Measure, float]:
    """By what share the centre moves further than stage and cantilever say from that time on, when
    it slides steadily; and by these the velocity of the block there, m/s, 0 where it is not known.
    """
    u, way, Q, t = known_series(drive, "centre_ux_m", "travel_m", "shear_force_n", "time_s")
    after = t >= steady_s
    u, t, at = u[after], t[after], (way - Q / config.forces.stiffness_shear)[after]
    if len(u) < FEWEST_SHEARED or not np.ptp(at) > SLID_M:
        return UNKNOWN, 0.0
    _, (rate, sd) = _fitted(np.column_stack([np.ones(len(u)), at]), u)
    return (rate - 1, sd), float(np.ptp(at) / np.ptp(t))


def _jumps(drive: list[Snapshot]) -> Measure:
    """By how much u_x at the centre lies off the line between the frames before and after, while it
    is held: standard deviation of one frame, and the part of it that is noise; metres.
    """
    u, sd, Q, t = all_series(drive, "centre_ux_m", "centre_ux_sd_m", "shear_force_n", "time_s")
    known = np.isfinite(u + sd + Q) & (np.diff(t, prepend=-math.inf) > 0)
    if int(known.sum()) < FEWEST_SHEARED:
        return UNKNOWN
    u, sd, Q, t = u[known], sd[known], Q[known], t[known]
    held = np.flatnonzero(np.maximum.accumulate(Q) < BEFORE_SLIDING * Q.max())
    held = held[(held > 0) & (held < len(u) - 1)]
    if len(held) < FEWEST:
        return UNKNOWN
    later = (t[held] - t[held - 1]) / (t[held + 1] - t[held - 1])
    off = u[held] - (1 - later) * u[held - 1] - later * u[held + 1]
    # of two images of equal noise one is the reference, which all share
    own = float(np.median(sd[held])) / math.sqrt(2)
    return robust_sd(off / np.sqrt(1 + later**2 + (1 - later) ** 2)), own


def _turns_back(drive: Sequence[Snapshot]) -> bool:
    """Whether the block goes back by a good part of its way."""
    (D,) = known_series(drive, "block_m")
    back = np.maximum.accumulate(D) - D
    return len(D) > 0 and float(back.max()) > BACK * float(np.ptp(D))


def _pictures_behind_forces(drive: Sequence[Snapshot]) -> tuple[Measure, Measure]:
    """How late Q is read after the integral of the traction, seconds; and the change of Q over that
    integral with the displacement of the block, as a share. Beside both a zero of Q, and a factor,
    of the modulus of the settings.
    """
    Q, seen, D, t = known_series(drive, "shear_force_n", "stress_force_n", "block_m", "time_s")
    if len(Q) < FEWEST_SHEARED or not (D.any() and Q.any()):
        return UNKNOWN, UNKNOWN
    rate, most = np.gradient(seen, t), float(np.abs(Q).max())
    columns = np.column_stack([np.ones(len(Q)), -rate, seen, most * D / np.abs(D).max()])
    _, (late, sd), (factor, _), change = _fitted(columns, Q)
    return (late / factor, sd / factor) if factor > 0 else UNKNOWN, change


def _drift_of_shear(drive: Sequence[Snapshot]) -> float:
    """How fast the zero of Q drifts, N/s, if that alone is why Q over the integral of the traction
    changes; 0 where it cannot be told.
    """
    Q, seen, t = known_series(drive, "shear_force_n", "stress_force_n", "time_s")
    _, _, (rate, _) = _fitted(np.column_stack([np.ones(len(Q)), seen, t]), Q)
    return abs(rate) if math.isfinite(rate) else 0.0


class Relaxes(NamedTuple):
    """The block by a drive whose tractions are those of an elastic one: the share of its modulus at
    once that relaxes, its time constant, and the largest part of Q that this adds.
    """

    share: float = 0.0
    share_sd: float = 0.0
    time_s: float = math.nan
    part: float = 0.0

    @property
    def can_be_set(self) -> bool:
        """Whether the settings of the block take it."""
        share, time_s = (options(Sample)[name] for name in ("relaxation", "relaxation_time"))
        return share.allows(self.share) and time_s.allows(self.time_s)

    @property
    def is_seen(self) -> bool:
        """Whether it is there beyond doubt."""
        return self.part > LAGGING and abs(self.share) > CERTAIN * self.share_sd


def relaxation_of(drive: Sequence[Snapshot]) -> Relaxes:
    """How the block relaxes, by the integral of the traction against Q: it is less by g times how
    much Q is ahead of Q behind a low-pass.
    """
    Q, seen, t = known_series(drive, "shear_force_n", "stress_force_n", "time_s")
    if len(Q) < FEWEST_SHEARED or not Q.any() or not (np.diff(t, prepend=0.0) > 0).all():
        return Relaxes()
    slow = np.geomspace(QUICKEST * float(np.median(np.diff(t))), SLOWEST * t[-1], TIMES)
    late = np.zeros((len(Q), TIMES))
    lagged, before = np.zeros(TIMES), 0.0
    for i, (step, now) in enumerate(zip(np.diff(t, prepend=0.0), Q, strict=True)):
        kept, old, new = lag_weights(step / slow)
        late[i] = lagged = kept * lagged + old * before + new * now
        before = now
    fits = []
    for i in range(TIMES):
        columns = np.column_stack([np.ones(len(Q)), Q, late[:, i] - Q])
        left = seen - columns @ np.linalg.lstsq(columns, seen, rcond=None)[0]
        fits.append((float(left @ left), i))
    best = min(fits)[1]
    if best in (0, TIMES - 1):  # quicker than frames tell, or as good as none
        return Relaxes()
    missing = Q - late[:, best]
    _, (scale, _), (size, sd) = _fitted(np.column_stack([np.ones(len(Q)), Q, -missing]), seen)
    if not scale > 0:
        return Relaxes()
    share, part = size / scale, float(np.abs(missing).max() / np.abs(Q).max())
    return Relaxes(share, sd / scale, float(slow[best]) * (1 - share), abs(share) * part)


def _fitted(columns: F64, values: F64) -> list[Measure]:
    """The coefficients of a linear fit, unknown where they cannot be told."""
    normal = columns.T @ columns
    if np.linalg.cond(normal) > 1e12:
        return [UNKNOWN] * columns.shape[1]
    found = np.linalg.solve(normal, columns.T @ values)
    residual = values - columns @ found
    freedom = len(values) - columns.shape[1]
    variance = serial_inflation(residual) * float(residual @ residual) / freedom
    spread = np.diag(np.linalg.inv(normal)).tolist()
    return [(one, math.sqrt(variance * of)) for one, of in zip(found.tolist(), spread, strict=True)]


def _drift_at_rest(config: Config, rest: list[Snapshot], normal_force_n: float) -> Measure:
    """Velocity of the contact in the picture before the drive, along it, from the frames at rest;
    unknown where it was not measured.
    """
    a = hertz_radius_m(config, normal_force_n)
    means = np.array([_mean_within(s.rings, a) for s in rest])
    t = np.array([s.sample for s in rest]) / config.forces.sample_rate
    u, t = means[known := np.isfinite(means)], t[known]
    if len(u) < FEWEST:
        return UNKNOWN
    t -= t.mean()
    spread = float(t @ t)
    slope = float(t @ u) / spread
    residual = u - u.mean() - slope * t
    variance = serial_inflation(residual) * float(residual @ residual) / (len(u) - 2)
    return slope, math.sqrt(variance / spread)


def _rest_s(config: Config, rest: list[Snapshot], drive: list[Snapshot]) -> float:
    reference = next((s for s in rest if s.motion), None)
    if reference is None or not drive:
        return 0.0
    since = (drive[0].sample - reference.sample) / config.forces.sample_rate
    return max(0.0, since - drive[0].conditions.time_s)


def _mean_within(rings: RingProfile | None, radius_m: float) -> float:
    """Mean of u_x over the disc of that radius; NaN where it is not known."""
    if rings is None:
        return math.nan
    inside = (rings.radius_m < radius_m) & np.isfinite(rings.ux_m)
    if not inside.any():
        return math.nan
    return float(np.average(rings.ux_m[inside], weights=rings.radius_m[inside]))
