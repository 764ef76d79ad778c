"""How images are to be correlated: one description for all methods, and the tracker it makes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from analysis.dic.coarse import CoarseSearch
from analysis.dic.field import Tracker
from analysis.dic.grid import Grid
from analysis.dic.interpolants import CLASSICAL
from analysis.dic.passes import SharedPasses
from analysis.dic.points import SeparatePoints
from analysis.dic.refining import Refinement
from analysis.dic.searching import DirectSearch
from analysis.dic.threads import Threads
from analysis.dic.tracker import Method, Reference, ReferenceTracker, checked
from analysis.dic.updating import UpdatingTracker

DIRECT_SEARCH = 16  # px; half-width of the direct method's own search
METHODS = ("shared", "icgn", "direct")
MATCHED = "matched"
INTERPOLANTS = (MATCHED, *CLASSICAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """A way to correlate images with a reference.

    Attributes
    ----------
    method : str
        ``shared``: passes over the whole image, each deforming it back by a smoothed field
        (`analysis.dic.passes`): the fastest, and the most accurate where the field is smooth on the
        scale of a box. ``icgn``: inverse-compositional Gauss-Newton of each box for itself
        (`analysis.dic.icgn`). ``direct``: the paper's search for the highest correlation and 2D
        Gaussian (`analysis.dic.direct`).
    box, step : int
        Side of the correlation boxes (4 to 200) and pitch of their grid, px.
    order : int
        Of the deformation of a box, 0, 1 or 2 (``icgn``).
    interpolant : str
        How images are read between their pixels: ``matched`` to the reference's texture, or one of
        `analysis.dic.interpolation.CLASSICAL` (``shared``, ``icgn``).
    precision : str
        ``single`` or ``double`` arithmetic (``icgn``; ``shared`` and ``direct`` know single only).
    tolerance : float or None
        A step shorter than this is the last, px; None: 0.06 (``shared``, whose next step would be a
        hundred times shorter) or 0.001 (``icgn``).
    search : int
        Largest jump that must be found, px.
    min_correlation, min_contrast, max_saturated, full_scale, threads
        See `RefiningTracker`.
    update : str
        When the current image becomes the reference: ``never``, ``every`` so many images, or on
        loss of ``quality``; see `UpdatingTracker`.
    update_every : int
    update_below : float
        Median correlation.

    Raises
    ------
    ValueError
        A value that can not be used, or two that can not be used together.
    """

    method: str = "shared"
    box: int = 20
    step: int = 10
    order: int = 1
    interpolant: str = MATCHED
    precision: Literal["single", "double"] = "single"
    tolerance: float | None = None
    search: int = 64
    min_correlation: float = 0.5
    min_contrast: float = 2.0
    max_saturated: float = 0.2
    full_scale: int | None = None
    update: str = "never"
    update_every: int = 100
    update_below: float = 0.8
    threads: int = 2

    def __post_init__(self) -> None:
        _one_of("method", self.method, METHODS)
        _one_of("interpolant", self.interpolant, INTERPOLANTS)
        _one_of("precision", self.precision, ("single", "double"))
        _one_of("update", self.update, ("never", "every", "quality"))
        _one_of("order", self.order, (0, 1, 2))
        if not 4 <= self.box <= 200 or self.step < 1:
            raise ValueError(
                f"correlation: box {self.box} px and step {self.step} px asked; use a box of 4 to"
                " 200 px and a step of 1 px or more"
            )
        if self.method != "icgn" and self.precision == "double":
            raise ValueError(
                f"correlation: double precision asked of method '{self.method}'; use method 'icgn',"
                " or single precision"
            )
        if self.tolerance is not None and not self.tolerance > 0:
            raise ValueError(f"correlation: tolerance {self.tolerance} px asked; use more than 0")
        if self.update_every < 1:
            raise ValueError(
                f"correlation: an update every {self.update_every} images asked; use 1 or more"
            )

    def open(
        self,
        reference: NDArray[Any],
        *,
        usable: NDArray[np.bool_] | None = None,
        roi: tuple[int, int, int, int] | None = None,
    ) -> Tracker:
        """A tracker against `reference`; `usable` pixels and `roi` as for `RefiningTracker`.

        Raises
        ------
        ValueError
            The image can not be used with these settings.
        """
        if self.update == "never":
            return self._open(reference, usable, roi)
        if usable is not None:
            raise ValueError(
                "correlation: a mask of the first reference asked together with updates of the"
                " reference; use one of them"
            )
        every = self.update_every if self.update == "every" else None
        return UpdatingTracker(
            lambda image: self._open(image, None, roi), reference, every, self.update_below
        )

    def _open(
        self,
        reference: NDArray[Any],
        usable: NDArray[np.bool_] | None,
        roi: tuple[int, int, int, int] | None,
    ) -> Tracker:
        image = np.array(checked(reference, "reference"), order="C")
        if usable is not None and usable.shape != image.shape:
            raise ValueError(
                f"mask: shape {usable.shape} found, the reference has {image.shape}; use a mask of"
                " its size"
            )
        if self.search < 1:
            raise ValueError(
                f"tracker: a search of {self.search} px was requested; use 1 px or more"
            )
        grid = Grid.cover(image.shape, self.box, self.step)
        prepared = Reference(image, grid, Threads(self.threads), usable)
        method: Method
        if self.method == "direct":
            if usable is not None or roi is not None:
                raise ValueError(
                    "correlation: a mask or region asked of method 'direct'; use method 'shared' or"
                    " 'icgn'"
                )
            near = min(self.search, DIRECT_SEARCH)
            # further away, reduced images are searched first
            guess = CoarseSearch(prepared, self.search).find if self.search > near else None
            method = DirectSearch(
                prepared,
                search=near,
                min_correlation=self.min_correlation,
                min_contrast=self.min_contrast,
                first_guess=guess,
            )
        else:
            interpolant = CLASSICAL.get(self.interpolant)
            if self.method == "shared":
                make: Any = partial(SharedPasses, tolerance_px=self.tolerance or 0.06)
            else:
                options: dict[str, Any] = {"order": self.order, "precision": self.precision}
                make = partial(SeparatePoints, tolerance_px=self.tolerance or 1e-3, **options)
            method = Refinement(prepared, self, partial(make, interpolant=interpolant), roi)
        return ReferenceTracker(prepared, method)


def _one_of(name: str, value: Any, known: tuple[Any, ...]) -> None:
    if value not in known:
        raise ValueError(
            f"correlation: {name} '{value}' asked; use one of {', '.join(map(str, known))}"
        )


def compile_kernels(correlation: Correlation | None = None, dtype: Any = np.uint8) -> None:
    """Compile what a correlation of images of a type needs, or load it from the cache; takes
    seconds the first time on a machine.
    """
    rng = np.random.default_rng(0)
    images = rng.integers(0, 255, (2, 64, 64)).astype(dtype)
    settings = replace(correlation or Correlation(), box=8, step=8, search=2, update="never")
    tracker = settings.open(images[0])
    for image in images:
        tracker.track(image)
    tracker.start_from(np.full(tracker.grid.shape, np.nan), np.full(tracker.grid.shape, np.nan))
    tracker.track(images[0])
    tracker.close()
