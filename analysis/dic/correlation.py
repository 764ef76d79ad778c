"""The tracker that correlates images as the settings say."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import betaincinv

from analysis.arrays import Array, Bool
from analysis.dic.coarse import CoarseSearch
from analysis.dic.direct import match_rows
from analysis.dic.field import Field, Tracker
from analysis.dic.icgn import solve_rows
from analysis.dic.passes import SharedPasses
from analysis.dic.periodicity import repetition
from analysis.dic.points import SeparatePoints
from analysis.dic.quadratic import solve_quadratics
from analysis.dic.refining import ALMOST_SURE, CHANCE, MakeRefiner, Refinement
from analysis.dic.searching import DirectSearch
from analysis.dic.spectrum import TextureCorrelation, texture
from analysis.dic.strips import sum_cells
from analysis.dic.threads import Threads
from analysis.dic.tracker import ReferenceImage, ReferenceTracker, checked
from analysis.dic.updating import UpdatingTracker
from analysis.grid import Grid
from analysis.kernels import is_kept
from analysis.settings import Correlation as Correlation  # noqa: PLC0414 (the package exports it)

DIRECT_SEARCH = 16  # px; half-width of the direct method's own search


def correlate(
    reference: Array, image: Array, *, um_per_px: float = math.nan, **settings: Any
) -> Field:
    """The displacement of every box of the reference in one image, searched from zero.

    Parameters
    ----------
    reference, image : ndarray, shape (rows, columns), uint8, uint16, float32 or float64
        Grey levels, of one shape and type; float64 is converted to float32. Grey levels from 0 to 1
        need a smaller `Correlation.min_contrast` than the default of 2.
    um_per_px : float, optional
        Size of a pixel, um, for the coordinates and displacements of the field in um.
    **settings
        Those of `Correlation`: ``preset="accurate"``, ``box=40``, ...

    Returns
    -------
    Field
        Displacements in pixels on a grid of shape (ny, nx).

    Raises
    ------
    ValueError
        The images or settings cannot be used; TypeError where no setting has that name.

    References
    ----------
    Prevost et al. 2013, section 2.3.2 and Fig. 4.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (40, 50))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> field = analysis.correlate(grey, np.roll(grey, 2, axis=1), box=12, step=6, um_per_px=4.0)
    >>> round(float(np.nanmedian(field.ux_um)), 1), field.x_um[:2].tolist()
    (8.0, [26.0, 50.0])
    """
    with open_tracker(Correlation.of_preset(**settings), reference) as tracker:
        for remark in tracker.remarks:
            warnings.warn(remark, stacklevel=2)
        return replace(tracker.track(image), um_per_px=um_per_px)


def open_tracker(
    correlation: Correlation,
    reference: Array,
    *,
    usable: Bool | None = None,
    roi: tuple[int, int, int, int] | None = None,
) -> Tracker:
    """A tracker of the displacements, in pixels, of many images against `reference`.

    Parameters
    ----------
    correlation : Correlation
    reference : ndarray, shape (rows, columns), uint8, uint16, float32 or float64
        The image at t = 0; float64 is converted to float32.
    usable : ndarray of bool, shape (rows, columns), or None
        Pixels that may be used; None: all. Boxes with too few of them are MASKED.
    roi : tuple of int, or None
        Left, top, right, bottom, in pixels: points outside are MASKED.

    Raises
    ------
    ValueError
        The image cannot be used with these settings.

    References
    ----------
    Prevost et al. 2013, section 2.3.2: the method ``direct``.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (40, 50))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> with analysis.open_tracker(analysis.Correlation(box=12, step=6), grey) as tracker:
    ...     tracker.grid.shape, bool(np.nanmax(np.abs(tracker.track(grey).ux_px)) < 1e-3)
    ((5, 7), True)
    """
    if not isinstance(correlation, Correlation):
        raise TypeError(
            "open_tracker: the first argument must be the settings, a Correlation, got"
            f" {type(correlation).__name__}; use correlate(reference, image) for two pictures"
        )
    if correlation.refusal:
        raise ValueError(correlation.refusal)
    if correlation.update == "never":
        return _open(correlation, reference, usable, roi)
    if usable is not None:
        raise ValueError(
            "correlation: a mask of the first reference asked together with updates of the"
            " reference; use one of them"
        )
    every = correlation.update_every if correlation.update == "every" else None
    make = partial(_open, correlation, usable=None, roi=roi)
    return UpdatingTracker(make, reference, every, correlation.update_below)


def _open(
    correlation: Correlation,
    reference: Array,
    usable: Bool | None,
    roi: tuple[int, int, int, int] | None,
) -> Tracker:
    image = np.array(checked(reference, "reference"), order="C")
    image.flags.writeable = False  # as all that follow, so that kernels compile once
    if usable is not None and usable.shape != image.shape:
        raise ValueError(
            f"mask: shape {usable.shape} found, the reference has {image.shape}; use a mask of its"
            " size"
        )
    if usable is not None and not usable.any():
        raise ValueError("mask: no pixel of it is usable, and so no box; widen it")
    grid = Grid.cover(image.shape, correlation.box, correlation.step)
    prepared = ReferenceImage(image, grid, Threads(correlation.threads), usable)
    if correlation.method != "direct":
        make: MakeRefiner = partial(SeparatePoints, tolerance_px=correlation.tolerance or 1e-3)
        if correlation.method == "shared":
            tolerance = correlation.tolerance or 0.06  # the next step: a hundred times shorter
            is_quadratic = correlation.is_quadratic
            make = partial(SharedPasses, tolerance_px=tolerance, is_quadratic=is_quadratic)
        return ReferenceTracker(prepared, Refinement(prepared, correlation, make, roi))
    if usable is not None or roi is not None:
        raise ValueError(
            "correlation: a mask or region asked of method 'direct'; use method 'shared' or 'icgn'"
        )
    near = min(correlation.search, DIRECT_SEARCH)
    guess = CoarseSearch(prepared, correlation.search)  # for jumps that are longer
    grain = texture(image.astype(np.float32))
    by_chance = highest_by_chance(grain, correlation.box, near)
    search = DirectSearch(
        prepared,
        search=near,
        min_correlation=max(correlation.min_correlation, by_chance),
        min_contrast=correlation.min_contrast,
        first_guess=guess.find if correlation.search > near else None,
        repetition=repetition(prepared, grain, correlation.min_contrast),
    )
    return ReferenceTracker(prepared, search)


def highest_by_chance(grain: TextureCorrelation, box: int, search: int) -> float:
    """Correlation that a box which is not in the image reaches once in 1 / `CHANCE` searches, given
    the grains of the texture in a box and in the area searched.
    """
    area = max(grain.grain_px2, 1.0)
    places = max((2 * search + 1) ** 2 / area, 1.0)
    freedom = max(box**2 / area - 2, 1.0)
    share = betaincinv(0.5, freedom / 2, 1 - 2 * CHANCE / places)
    return float(min(np.sqrt(share), ALMOST_SURE))


def compile_kernels(
    correlation: Correlation | None = None, dtype: Any = np.uint8, part: str = "all"
) -> None:
    """Compile what a correlation of images of a type needs, or load it from the cache; this takes
    seconds the first time on a machine.

    `part` is all, or one of two that processes can compile side by side: what measures a field
    ("field"), and the search for large displacements ("search").

    Examples
    --------
    >>> import numpy as np, analysis
    >>> analysis.compile_kernels(analysis.Correlation(), np.float32, part="field")
    """
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (2, 64, 64)).astype(dtype)
    asked = correlation or Correlation()
    # what is asked of the pictures does not hold for these
    asked = replace(asked, region=(), min_contrast=0.0, max_saturated=1.0, full_scale=0)
    settings = replace(asked, box=8, step=8, search=2, update="never")
    nowhere = np.full((2, *Grid.cover(images[0].shape, 8, 8).shape), np.nan)
    if part == "search":
        settings = replace(settings, method="direct", quality="full")
    with open_tracker(settings, images[0]) as tracker:
        if part == "field":
            tracker.start_from(*np.zeros_like(nowhere))
            tracker.track(images[0])
            return
        for image in images:
            tracker.track(image)
        tracker.start_from(*nowhere)
        tracker.track(images[0])


def is_compiled(correlation: Correlation) -> bool:
    """Whether the larger part of what a correlation needs is kept from an earlier start."""
    if correlation.method == "shared":
        return is_kept(solve_quadratics if correlation.order == 2 else sum_cells)
    return is_kept(match_rows if correlation.method == "direct" else solve_rows)
