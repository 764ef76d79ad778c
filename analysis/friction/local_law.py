"""Local law of friction sigma = mu p (1 - exp(-s/(mu L))) from a loading run that ends in sliding,
without a model of the pressure.

The shear traction of steady sliding is mu p(r) everywhere, so that the traction of any frame over
that of sliding, against the local slip, is the law itself, whatever p(r) is: smooth or rough. mu
comes from the forces, E from the balance of the traction with Q, and the sliding traction over mu
is a measured pressure p(r). Traction and slip of a frame come from the same inversion of the ring
means of u_x, in which the averaging by correlation boxes and rings is undone.

References
----------
Prevost et al. 2013, section 6; Bureau et al. 2003.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64, Bool, floats, in_step
from analysis.contact.rings import Rings
from analysis.friction.modulus import Modulus, balance_modulus
from analysis.friction.ratio import mean_friction
from analysis.inversion.axisymmetric import AxisymmetricInversion, InvertedRings
from analysis.mechanics.interface import cusp_length, elastic_length
from analysis.mechanics.relaxation import ELASTIC, Relaxation, RelaxationCorrection
from analysis.robust import robust_sd

MIN_POINTS = 12  # least points of the law, and least frames
FEWEST_SLIDING = 4  # frames
SLIDING = 7.0  # slip in mu L from which a point slides: all but exp(-7) of its traction is there
MAX_SLIP = 8.0  # slip in mu L up to which points tell L
LEAST_TRACTION = 0.1  # of the largest: rings with less sliding traction tell the law too badly
ROUNDS = 8
DRAWS = 24
MOST_FRAMES = 48  # most frames of a draw
LARGEST_CHI2 = 4.0  # beyond, the points do not follow the law
# relative bias of L by smoothing and ring averages, for rings as wide as the cusp at the rim of the
# stuck zone is round, and as their width squared (benchmarks coverage --exact, with --step 20)
L_RESIDUAL_BIAS = 0.1
MAX_RELATIVE_SD_OF_L = 0.5  # relative sd of L from which there is no result


@dataclass(frozen=True, slots=True)
class LocalLaw:
    """The law of friction of the interface, and what is measured with it. NaN where they cannot be
    determined; `notes` then gives the reason.

    Uncertainties are those of image and force noise, through the whole estimate.

    Attributes
    ----------
    mu, mu_sd : float
        Friction coefficient: mean of Q/P in steady sliding, of samples where there are such.
    L, L_sd, h, h_sd : float
        Elastic length and the roughness that it stands for, ``L = (2 - nu)/(2 (1 - nu)) h``,
        metres.
    E, E_sd : float
        Young's modulus at which the traction balances Q over the run, pascals.
    D : ndarray, shape (nt,)
        Displacement of the block far away in each frame, metres; NaN in frames that could not be
        inverted.
    radius, pressure, pressure_sd : ndarray, shape (nr,)
        Measured pressure p(r) = sigma_sliding/mu at the radii of the rings, pascals, metres.
    slip, ratio : ndarray, shape (nt, nr)
        Local slip (m) and traction over that of sliding: the master curve (paper, Fig. 15) over mu.
        NaN where they tell nothing.
    reduced_chi2 : float
        Mean square distance of the points from the law in their uncertainty.
    sliding : int
        Number of frames of steady sliding.
    notes : tuple of str
        What the numbers rest on, or why there are none.
    """

    mu: float = np.nan
    mu_sd: float = np.nan
    L: float = np.nan
    L_sd: float = np.nan
    h: float = np.nan
    h_sd: float = np.nan
    E: float = np.nan
    E_sd: float = np.nan
    D: F64 = field(default_factory=lambda: np.empty(0))
    radius: F64 = field(default_factory=lambda: np.empty(0))
    pressure: F64 = field(default_factory=lambda: np.empty(0))
    pressure_sd: F64 = field(default_factory=lambda: np.empty(0))
    slip: F64 = field(default_factory=lambda: np.empty((0, 0)))
    ratio: F64 = field(default_factory=lambda: np.empty((0, 0)))
    reduced_chi2: float = np.nan
    sliding: int = 0
    notes: tuple[str, ...] = ()


def law_of(slip: ArrayLike, mu: float, L: float) -> F64:
    """Traction over that of sliding, ``1 - exp(-s/(mu L))``, linear below zero slip.

    `slip` and L in metres; shape of `slip`.

    Examples
    --------
    >>> import analysis
    >>> analysis.law_of([0, 1e-6, 10e-6], mu=0.9, L=1e-6).round(3).tolist()
    [0.0, 0.671, 1.0]
    """
    t = floats(slip) / (mu * L)
    return np.where(t > 0, -np.expm1(-np.maximum(t, 0.0)), t)


def fit_local_law(
    rings: Sequence[Rings],
    P: ArrayLike,
    Q: ArrayLike,
    inversion: AxisymmetricInversion,
    *,
    Q_sd: float = 1e-3,
    seed: int = 0,
    draws: int = DRAWS,
    time: ArrayLike = 0.0,
    relaxation: Relaxation = ELASTIC,
    inverted: Sequence[InvertedRings] = (),
    samples: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
) -> LocalLaw:
    """mu, L, E and p(r) from a loading run that ends in sliding.

    Parameters
    ----------
    rings : sequence of Rings, length nt
        Ring means of u_x since the start of a first loading, lens removed, metres.
    P, Q : array_like, shape (nt,)
        Normal and shear force, newtons.
    inversion : AxisymmetricInversion
        Of these rings, with any modulus: the balance with Q corrects it.
    Q_sd : float
        Noise of the shear force, newtons.
    seed : int
        Of the noise that is drawn for the uncertainties.
    draws : int
        Number of runs that are drawn for them. 0: no uncertainties, and L is not corrected for
        noise in the slip.
    time : array_like, shape (nt,)
        Of each frame since the block was at rest, seconds; of a block that relaxes.
    relaxation : Relaxation, optional
        Of the block, to the modulus that is measured.
    inverted : sequence of InvertedRings, optional
        Which invert the rings, where there are such already.
    samples : tuple of array_like, optional
        Time (s, that of the frames), Q and P (N) of the samples of the sensors, for mu: hum has the
        same phase in all frames whose period is a multiple of its own.

    Raises
    ------
    ValueError
        A block that relaxes, and times that do not rise from 0.

    Notes
    -----
    A frame slides once the slip at the centre, the least of all, exceeds 7 mu L. The uncertainty is
    that of `DRAWS` runs with noise as stated on the fitted displacements, half of its variance
    shared by all frames, which is the reference image's; their mean corrects L for noise in slip.

    Noise makes L too long, smoothing in the inversion too short. The drawn runs have the bias by
    noise as the measured run has it, but too little of that by smoothing, as what they start from
    is smooth already. In 20 runs each at 0.1, 0.2 and 0.5 N, at noises of 50 and 232 nm, L is 0.0
    to 2.2 % too long uncorrected; corrected it is between 0.33 % too short and 0.43 % too long, and
    at 50 nm and 0.1 N no better than before (``python -m benchmarks estimators law --runs 20
    --loads 0.1 0.2 0.5``, column "L uncorrected" beside "L"; 2026-11-26).

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = np.linspace(-2e-3, 2e-3, 41)
    >>> inversion = analysis.AxisymmetricInversion(x, x, 1e-4, 1.2e-3, 3.4e6, 0.5)
    >>> r = inversion.radius
    >>> rings = analysis.Rings(r, 0 * r, 1e-8 + 0 * r, inversion.points.astype(int))
    >>> analysis.fit_local_law([rings] * 3, 0.5, 0.1, inversion).notes
    ('local law: 3 frames could be inverted; 12 or more are needed',)
    """
    _, normal, shear, at = in_step("local law", rings=np.zeros(len(rings)), P=P, Q=Q, time=time)
    if relaxation.share and not (np.diff(at, prepend=0.0) > 0).all():
        raise ValueError(
            "local law: a block that relaxes was given with times of its frames that do not rise"
            " from 0; give the time of each frame, in seconds since the block was at rest"
        )
    run = inverted_run(rings, normal, shear, inversion, at, relaxation, inverted)
    if len(run.Q) < MIN_POINTS:
        return _no_law(f"{len(run.Q)} frames could be inverted; {MIN_POINTS} or more are needed")
    if not run.P.min() > 0:
        return _no_law(
            f"a normal force of {run.P.min():.3g} N was measured; without contact there is no"
            " friction"
        )
    if not run.Q.max() > 10 * Q_sd:
        return _no_law(
            f"the shear force reached {run.Q.max():.3g} N at most, with a noise of {Q_sd:.2g} N;"
            " drive further"
        )
    found = _fit(run, Q_sd)
    if isinstance(found, str):
        return _no_law(found)
    slides = found.sliding
    time_s, Q_sliding, P_sliding = (of_run[slides] for of_run in (run.time, run.Q, run.P))
    mu, mu_sd, source = mean_friction(time_s, Q_sliding, P_sliding, Q_sd, samples)
    pressure = found.pressure * found.mu / mu
    if not draws:
        return LocalLaw(
            mu=mu,
            L=found.L * found.mu / mu,
            E=found.slope.E * inversion.E,
            D=run.D,
            radius=run.radius,
            pressure=pressure,
            pressure_sd=np.full(len(run.radius), np.nan),
            sliding=int(slides.sum()),
        )
    drawn = _draws(run, Q_sd, found, inversion, seed, draws, relaxation)
    if len(drawn) < max(draws // 2, 2):
        return _no_law(f"with its noise drawn anew only {len(drawn)} of {draws} runs give a law")
    shares = np.array([d.L for d in drawn]) / found.L
    # what noise in the slip adds: the runs drawn have it once more
    L = found.L * found.mu / mu / float(shares.mean())
    wide = float(np.var(shares, ddof=1)) * max(found.chi2, 1.0) * (1 + 1 / len(drawn))
    cusp = cusp_length(run.radius, pressure, found.slope.E * inversion.E, inversion.nu, L)
    by_rings = L_RESIDUAL_BIAS * (float(np.diff(inversion.radius[:2])[0]) / cusp) ** 2
    L_sd = L * math.hypot(math.sqrt(wide), mu_sd / mu, by_rings)
    if not L_sd < MAX_RELATIVE_SD_OF_L * L:
        return _no_law(f"L comes out within {L_sd / L:.0%} only; drive until it slides")
    pressure_sd = np.hypot(
        found.slope.E / mu * run.sigma_sd[slides].mean(axis=0),
        np.std([d.pressure for d in drawn], axis=0, ddof=1),
    )
    notes = [
        f"local law: {len(run.Q)} frames, {int(slides.sum())} of them sliding,"
        f" {found.points} points, {math.sqrt(found.chi2):.2g} times their uncertainty from the law;"
        f" mu from {source}"
    ]
    if not found.settled:
        notes.append(
            f"local law: which frames slide was still changing after {ROUNDS} rounds; drive further"
        )
    if found.chi2 > LARGEST_CHI2:
        notes.append(
            "local law: traction against slip does not follow mu p (1 - exp(-s/(mu L))): the points"
            f" lie {math.sqrt(found.chi2):.2g} times their uncertainty off it; look at the master"
            " curve, and check that the block was at rest at the reference"
        )
    rough = elastic_length(1.0, inversion.nu)
    D = np.full(len(rings), np.nan)
    D[run.frames] = run.D
    slip, ratio = (np.full((len(rings), len(run.radius)), np.nan) for _ in range(2))
    slip[run.frames], ratio[run.frames] = found.slip, found.ratio
    return LocalLaw(
        mu=mu,
        mu_sd=mu_sd,
        L=L,
        L_sd=L_sd,
        h=L / rough,
        h_sd=L_sd / rough,
        E=found.slope.E * inversion.E,
        E_sd=found.slope.E_sd * inversion.E,
        D=D,
        radius=run.radius,
        pressure=pressure,
        pressure_sd=pressure_sd,
        slip=slip,
        ratio=ratio,
        reduced_chi2=found.chi2,
        sliding=int(slides.sum()),
        notes=tuple(notes),
    )


def _no_law(reason: str) -> LocalLaw:
    return LocalLaw(notes=(f"local law: {reason}",))


@dataclass(frozen=True)
class InvertedRun:
    """Inverted frames: (nt,), and (nt, nr) inside the mask; SI units."""

    frames: Bool  # (all frames,)
    time: F64
    P: F64
    Q: F64
    D: F64
    radius: F64
    slip: F64
    slip_sd: F64
    sigma: F64
    sigma_sd: F64
    integral: F64
    integral_sd: F64
    fitted: F64  # (nt, all rings): displacements of the fit, as measured
    rings: tuple[Rings, ...]


def inverted_run(
    rings: Sequence[Rings],
    P: F64,
    Q: F64,
    inversion: AxisymmetricInversion,
    time: F64,
    relaxation: Relaxation = ELASTIC,
    inverted: Sequence[InvertedRings] = (),
) -> InvertedRun:
    """Traction and slip under the rings of each frame; frames that cannot be inverted, or have no
    force, are left out. Parameters as for `fit_local_law`.
    """
    inside = inversion.radius < inversion.mask_radius
    frames = np.zeros(len(rings), np.bool_)
    solved, sd = [], []
    each = inverted or (InvertedRings(inversion, r) for r in rings)
    for i, (one, r) in enumerate(zip(each, rings, strict=True)):
        if not (math.isfinite(P[i]) and math.isfinite(Q[i])):
            continue
        try:
            solved.append(one.fit(r.mean)[0])
        except ValueError:
            continue
        sd.append(one.sd[inside])
        frames[i] = True
    n = int(inside.sum())

    def table(rows: list[F64], width: int) -> F64:
        return np.array(rows) if rows else np.empty((0, width))

    tractions = [inversion.traction(fit) for fit in solved]
    sigma, sigma_sd = (table([both[k][inside] for both in tractions], n) for k in (0, 1))
    integral, integral_sd = np.array([inversion.force(fit) for fit in solved]).reshape(-1, 2).T
    if relaxation.share:
        block = RelaxationCorrection(relaxation)
        for i, at in enumerate(time[frames].tolist()):
            both = block.at(at, np.append(sigma[i], integral[i]))
            sigma[i], integral[i] = both[:-1], both[-1]
            sigma_sd[i] *= block.gain
            integral_sd[i] *= block.gain
    return InvertedRun(
        frames=frames,
        time=time[frames],
        P=P[frames],
        Q=Q[frames],
        D=np.array([fit.coefficients[0] for fit in solved]),
        radius=inversion.radius[inside],
        slip=table([inversion.slip(fit)[inside] for fit in solved], n),
        slip_sd=table(sd, n),
        sigma=sigma,
        sigma_sd=sigma_sd,
        integral=integral,
        integral_sd=integral_sd,
        fitted=table([inversion.seen(fit) for fit in solved], len(inversion.radius)),
        rings=tuple(one for one, is_kept in zip(rings, frames, strict=True) if is_kept),
    )


class _Fitted(NamedTuple):
    """What one run of inverted frames comes down to."""

    mu: float
    L: float
    slope: Modulus  # in that of the inversion
    sliding: Bool  # (nt,)
    pressure: F64  # (nr,)
    slip: F64  # (nt, nr), NaN where not used
    ratio: F64
    chi2: float
    points: int
    settled: bool  # law and sliding frames belong to each other


def _fit(run: InvertedRun, Q_sd: float, start: float = math.nan) -> _Fitted | str:
    """The law through the points, or why there is none."""
    at_centre = run.slip[:, :3].mean(axis=1)
    count = len(run.Q)
    slides = np.arange(count) >= count - FEWEST_SLIDING
    soft, settled = start, True
    for _ in range(ROUNDS):
        mu = float(np.mean((run.Q / run.P)[slides]))
        if not mu > 0:
            return "the shear force is not along the drive at the end of the run; check its sign"
        wider = np.cbrt(run.P / run.P[slides].mean())  # as radius and pressure of a sphere grow
        at, whole = run.radius, zip(run.sigma[slides], wider[slides], strict=True)
        sliding = np.mean([np.interp(at * by, at, one) / by for one, by in whole], axis=0)
        strong = sliding > LEAST_TRACTION * sliding.max()
        if not sliding.max() > 0 or strong.sum() < 3:
            return "no shear traction stands out of the noise while it slides"
        under = np.array([by * np.interp(at / by, at, sliding) for by in wider])
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(strong, run.sigma / under, np.nan)
            ratio_sd = np.where(strong, run.sigma_sd / sliding, np.nan)
        soft = _slip_scale(run, ratio, ratio_sd, slides, soft)
        if not math.isfinite(soft):
            return "the traction does not grow with the slip; check E, P and the zero of Q"
        again = at_centre > SLIDING * soft
        # it slides from where the longest run of such frames begins; a shaken picture is alone
        ends = np.flatnonzero(np.diff(again, prepend=False, append=False)).reshape(-1, 2)
        if len(ends):
            again[: ends[np.diff(ends).argmax(), 0]] = False
        if again.sum() < FEWEST_SLIDING:
            return (
                f"the centre slipped by {at_centre.max() * 1e6:.2g} um at most, and"
                f" {SLIDING:g} mu L = {SLIDING * soft * 1e6:.2g} um or more in"
                f" {FEWEST_SLIDING} frames are needed; drive further"
            )
        if np.array_equal(again, slides):
            break
        slides = again
    else:
        settled = False
    used = np.isfinite(ratio) & (run.slip < MAX_SLIP * soft) & ~slides[:, None]
    if used.sum() < MIN_POINTS:
        return f"{int(used.sum())} points lie on the rise of the law; take more frames"
    off = _residual(run, ratio, ratio_sd, soft)[used]
    slope = balance_modulus(run.integral, run.integral_sd, run.Q, 1.0, Q_sd=Q_sd)
    if not math.isfinite(slope.E):
        return "traction and shear force are not in proportion; check the sign and the zero of Q"
    return _Fitted(
        mu,
        soft / mu,
        slope,
        slides,
        slope.E * sliding / mu,
        np.where(used, run.slip, np.nan),
        np.where(used, ratio, np.nan),
        float(np.mean(np.minimum(off**2, 25.0))),
        int(used.sum()),
        settled,
    )


def _residual(run: InvertedRun, ratio: F64, ratio_sd: F64, soft: float) -> F64:
    law = law_of(run.slip, 1.0, soft)
    return (ratio - law) / np.hypot(ratio_sd, (1 - law) / soft * run.slip_sd)


def _slip_scale(run: InvertedRun, ratio: F64, ratio_sd: F64, slides: Bool, start: float) -> float:
    """Mu L in metres: the slip over which the traction comes up."""
    used = np.isfinite(ratio) & np.isfinite(run.slip) & ~slides[:, None]
    if used.sum() < MIN_POINTS:
        return math.nan
    if not math.isfinite(start):
        half = used & (np.abs(ratio - 0.5) < 0.2) & (run.slip > 0)
        if not half.any():
            return math.nan
        start = float(np.median(run.slip[half])) / math.log(2)
    weight = 1 / np.hypot(ratio_sd, np.exp(-np.maximum(run.slip, 0) / start) / start * run.slip_sd)

    slip, ratio, weight = run.slip[used], ratio[used], weight[used]

    def off(scale: F64) -> F64:
        return (ratio - law_of(slip, 1.0, start * math.exp(float(scale[0])))) * weight

    def slope(scale: F64) -> F64:
        t = slip / (start * math.exp(float(scale[0])))
        return (t * np.exp(-np.maximum(t, 0.0)) * weight)[:, None]

    spread = max(1.0, robust_sd(off(np.zeros(1))))
    found = scipy.optimize.least_squares(
        off, [0.0], slope, loss="huber", f_scale=2.5 * spread, xtol=1e-6
    )
    if not found.success:
        return math.nan
    return start * math.exp(float(np.clip(found.x[0], -3, 3)))


def _draws(
    run: InvertedRun,
    Q_sd: float,
    found: _Fitted,
    inversion: AxisymmetricInversion,
    seed: int,
    count: int,
    relaxation: Relaxation,
) -> list[_Fitted]:
    """The fit to runs with noise drawn anew on the fitted displacements."""
    rng = np.random.default_rng(seed)
    frames = np.unique(np.linspace(0, len(run.Q) - 1, MOST_FRAMES).round().astype(int))
    frames = np.union1d(frames, np.flatnonzero(found.sliding)[-2 * FEWEST_SLIDING :])
    rings = [run.rings[i] for i in frames]
    P, Q, time = (of_run[frames] for of_run in (run.P, run.Q, run.time))
    inverted = [InvertedRings(inversion, one) for one in rings]
    widest = max(inverted, key=lambda one: one.count)  # the first may show fewer rings than others
    drawn = []
    for _ in range(count):
        reference = widest.drawn_noise(rng)
        measured = []
        for i, one, was in zip(frames, inverted, rings, strict=True):
            own = one.drawn_noise(rng)
            noise = (own + reference[: len(own)]) / math.sqrt(2)
            measured.append(replace(was, mean=run.fitted[i, : len(own)] + noise))
        drawn_run = inverted_run(measured, P, Q, inversion, time, relaxation, inverted)
        fit = _fit(drawn_run, Q_sd, found.mu * found.L)
        if not isinstance(fit, str):
            drawn.append(fit)
    return drawn
