"""The settings of the analysis: the sample, the image correlation, the shear traction."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, NamedTuple

from analysis.options import UNITS, Section, described, option, options

METHODS = ("shared", "icgn", "direct")
PRESETS = {  # each from the front of `slipscope tradeoff`; docs/analysis.md has their figures
    name: {"order": 1} | given
    for name, given in {
        "fast": {"method": "shared", "box": 20, "step": 20, "tolerance": 0.3},
        "accurate": {"method": "shared", "order": 2, "box": 50, "step": 10, "tolerance": 0.06},
        "finest": {"method": "shared", "order": 2, "box": 38, "step": 10, "tolerance": 0.06},
    }.items()
}
# of a correlation: settings that sessions of earlier versions have, and what is always done now
RETIRED = {"interpolant": "matched", "precision": "single"}


@dataclass(frozen=True, kw_only=True)
class Sample(Section):
    """The block, the lens, and what holds them."""

    young_modulus: float = option(3.43, "Young's modulus E of the block", "MPa", gt=0, le=1e6)
    poisson: float = option(0.5, "Poisson's ratio of the block", ge=0, le=0.5)
    lens_radius: float = option(128.8, "Radius of curvature R of the lens", "mm", gt=0, le=1e5)
    roughness: float = option(
        0.595, "Standard deviation h of the heights of the rough surface", "um", ge=0, le=1000
    )
    thickness: float = option(
        0.0,
        "Thickness of the block on its rigid plate, for the traction; 0: a half-space",
        "mm",
        ge=0,
        le=1e4,
    )
    lens_compliance: float = option(
        0.68, "Displacement of the lens holder per newton of Q", "um/N", ge=0, le=100
    )
    relaxation: float = option(
        0.0,
        "Share of the block's modulus at once that relaxes to young_modulus, for the results of a"
        " run; 0: an elastic block",
        ge=0,
        le=0.5,
    )
    relaxation_time: float = option(
        5.0, "Time constant with which it relaxes under a constant strain", "s", gt=0, le=10000
    )

    @property
    def depth(self) -> float:
        """Thickness of the block in metres, infinite for a half-space."""
        return self.thickness or math.inf

    @property
    def bodies(self) -> tuple[float, float, float]:
        """E (Pa) and Poisson's ratio of the block, and R (m) of the lens, which touch."""
        return self.young_modulus, self.poisson, self.lens_radius

    @property
    def rim(self) -> float:
        """sqrt(R h) in metres: by so much the apparent contact radius exceeds that of Hertz."""
        # the factors in the order in which sessions have been analysed so far: to the bit
        height_um = options(Sample)["roughness"].written(self.roughness)
        return math.sqrt(self.lens_radius * height_um * UNITS["um"])


@dataclass(frozen=True, kw_only=True)
class Uncertainties(Section):
    """Standard uncertainties of the settings, for the budget of each result. Those of the
    cantilevers' stiffness are in [forces].
    """

    pixel: float = option(0.5, "Of camera.pixel", "%", ge=0, le=20)
    sensitivity: float = option(0.3, "Of the sensitivity of each force sensor", "%", ge=0, le=20)
    lens_radius: float = option(0.5, "Of sample.lens_radius", "%", ge=0, le=20)
    young_modulus: float = option(
        5.0,
        "Of sample.young_modulus, on which sigma of a frame depends; the measured E does not",
        "%",
        ge=0,
        le=50,
    )
    poisson: float = option(0.01, "Of sample.poisson", ge=0, le=0.2)
    roughness: float = option(10.0, "Of sample.roughness", "%", ge=0, le=50)
    thickness: float = option(5.0, "Of sample.thickness, if given", "%", ge=0, le=50)
    relaxation: float = option(
        10.0, "Of sample.relaxation, and of relaxation_time, if given", "%", ge=0, le=50
    )
    lens_compliance: float = option(10.0, "Of sample.lens_compliance", "%", ge=0, le=100)
    averaging: float = option(
        5.0, "Of the box over which the correlation averages u_x", "%", ge=0, le=50
    )
    distortion: float = option(
        0.1, "Of camera.distortion, in the position of an image corner", "%", ge=0, le=5
    )
    drift: float = option(
        0.0005, "Of the relative creep of image and stage, which is taken as 0", "um/s", ge=0, le=1
    )
    zero: float = option(
        1.0,
        "Of the reading of each force sensor without force, which is taken as 0",
        "mN",
        ge=0,
        le=1000,
    )
    coupling: float = option(
        0.3,
        "Of each cross term of forces.coupling, as a share of the other force",
        "%",
        ge=0,
        le=20,
    )
    delay: float = option(
        0.0,
        "Of forces.delay; an import that moves the clock of the forces sets it",
        "ms",
        ge=0,
        le=60_000,
    )
    start: float = option(
        0.0, "Of the time at which the drive began; an import sets it", "ms", ge=0, le=60_000
    )


MOST_CORNERS, MOST_POLYGONS = 100, 20
_POLYGON = re.compile(rf"(inside|outside)((?: -?\d{{1,5}} -?\d{{1,5}}){{3,{MOST_CORNERS}}})")


class Polygon(NamedTuple):
    """A part of the picture that is measured, or left out; its corners are (x, y), px."""

    is_measured: bool
    corners: tuple[tuple[int, int], ...]

    @property
    def text(self) -> str:
        """As it is written in the settings."""
        numbers = " ".join(f"{x} {y}" for x, y in self.corners)
        return f"{'inside' if self.is_measured else 'outside'} {numbers}"


def _polygon(text: str) -> Polygon:
    found = _POLYGON.fullmatch(text)
    if found is None:
        raise ValueError(
            f"dic.region: '{text[:200]}' cannot be read; write inside or outside, then x and y of"
            f" 3 to {MOST_CORNERS} corners in whole px, such as 'inside 100 100 700 100 400 500'"
        )
    numbers = [int(one) for one in found[2].split()]
    return Polygon(found[1] == "inside", tuple(zip(numbers[::2], numbers[1::2], strict=True)))


@described
@dataclass(frozen=True, kw_only=True)
class Correlation(Section):
    """Digital image correlation of each frame with the reference.

    ``shared`` makes passes over the whole image, and each deforms it back by a smoothed field:
    it is the fastest method, and the most accurate where the field is smooth on the scale of a box
    (`analysis.dic.passes`); with order 2 the displacement within a box is a quadratic
    (`analysis.dic.quadratic`). ``icgn`` is inverse-compositional Gauss-Newton of each box by
    itself (`analysis.dic.icgn`). ``direct`` is the paper's search for the highest correlation, with
    a 2D Gaussian through its peak (`analysis.dic.direct`).

    A preset stands for the method and its settings, and is replaced by them where settings are read
    (`resolved`): an instance has none. An instance may be what an earlier version recorded a
    session with and this version does not do (`refusal`): what it measured can be read.

    Other Parameters
    ----------------
    retired : tuple of (str, str); default ()
        Settings of an earlier version that are no more, each a name in `RETIRED` with its value.

    Raises
    ------
    ValueError
        A value cannot be used, or two cannot be used together.
    """

    preset: str = option(
        "custom",
        "Sets method, order, tolerance, box and step at once; values given explicitly are kept",
        choices=("custom", *PRESETS),
    )
    method: str = option(
        "shared",
        "Passes over the whole image, IC-GN of each box by itself, or the paper's search",
        choices=METHODS,
    )
    box: int = option(20, "Side of the correlation box", "px", ge=4, le=200)
    step: int = option(10, "Pitch of the grid of boxes", "px", ge=1, le=200)
    region: tuple[str, ...] = option(
        (),
        "Where displacements are measured: polygons, each 'inside' or 'outside' followed by the"
        " corners x y in whole px. A box counts if its centre lies in an inside polygon (if there"
        " are any) and in no outside polygon; empty: the whole image",
    )
    order: int = option(
        1,
        "Displacement within a box. In shared: with 2 a quadratic, otherwise a shift in addition"
        " to the predicted deformation; in icgn, which allows only 1: a shift and its gradient",
        ge=0,
        le=2,
    )
    tolerance: float = option(
        0.0,
        "The iteration ends with a step shorter than this; 0: the method's own limit",
        "px",
        ge=0,
        le=1,
    )
    search: int = option(
        64, "Largest displacement between two images that must be found", "px", ge=1, le=200
    )
    min_correlation: float = option(
        0.5, "A point with a lower correlation counts as lost", ge=0, lt=1
    )
    min_contrast: float = option(
        2.0,
        "A box with a smaller standard deviation of grey levels is not correlated",
        "grey levels",
        ge=0,
    )
    max_saturated: float = option(
        0.2, "Largest share of a box that may be at full scale (shared, icgn)", ge=0, le=1
    )
    full_scale: int = option(
        0,
        "End of the grey scale, 4095 for 12 bits; 0: that of the image type, or a lower maximum"
        " shared by many pixels of a 16-bit image",
        "grey levels",
        ge=0,
        le=65535,
    )
    update: str = option(
        "never",
        "When a later image becomes the new reference",
        choices=("never", "every", "quality"),
    )
    update_every: int = option(
        100, "Number of images from one reference to the next, for update = every", "images", ge=1
    )
    update_below: float = option(
        0.8,
        "Median correlation below which a new reference is taken, for update = quality",
        ge=0,
        le=1,
    )
    quality: str = option(
        "full",
        "Computation in a live run: full, everything requested for each frame; auto, in shared"
        " only, less while the processor cannot keep up",
        choices=("full", "auto"),
    )
    threads: int = option(
        2, "Threads that share a field; the result does not depend on their number", ge=1, le=64
    )
    retired: tuple[tuple[str, str], ...] = ()  # names in `RETIRED`, with other values

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quality == "auto" and (self.method == "direct" or self.update != "never"):
            raise ValueError(
                f"correlation: quality 'auto' asked with method '{self.method}' and update"
                f" '{self.update}', of which nothing can be left out; use method 'shared', and"
                " update 'never'"
            )
        if len(self.region) > MOST_POLYGONS:
            raise ValueError(
                f"dic.region has {len(self.region)} polygons; {MOST_POLYGONS} is the most"
            )
        if self.polygons and self.method == "direct":
            raise ValueError(
                "dic.region asked with method 'direct', which measures the whole picture; use"
                " method 'shared' or 'icgn'"
            )
        if self.preset != "custom":
            raise ValueError(
                f"correlation: the preset '{self.preset}' is replaced by its settings when settings"
                f" are read; use Correlation.of_preset('{self.preset}')"
            )

    @classmethod
    def of_preset(cls, preset: str = "custom", **others: Any) -> Correlation:
        """The settings of a preset, with `others` in place of its own."""
        return cls(**cls.resolved({"preset": preset, **others}))

    @classmethod
    def resolved(cls, written: dict[str, Any]) -> dict[str, Any]:
        """The values that are written, over the settings of the preset if one is.

        Raises
        ------
        ValueError
            The preset would change nothing.
        """
        name = written.get("preset")
        if not isinstance(name, str) or name not in PRESETS:
            return written
        preset = PRESETS[name]
        if all(key in written for key in preset) and not preset.items() <= written.items():
            raise ValueError(
                f"dic.preset = '{name}' changes nothing, since {', '.join(preset)} are all given,"
                " and what is given is kept; leave out what the preset is to decide"
            )
        return {**preset, **written, "preset": "custom"}

    @property
    def refusal(self) -> str:
        """Why no image is correlated so, in one sentence; empty where images are."""
        if self.method == "direct":  # which never had any of it
            return ""
        asked, now = dict(self.retired), {**RETIRED, "order": 1, "quality": "full"}
        if self.method == "icgn":
            of_icgn = ((name, getattr(self, name)) for name in ("order", "quality"))
            asked |= {name: f"{value} in icgn" for name, value in of_icgn if value != now[name]}
        if not asked:
            return ""
        return (
            f"dic: {', '.join(' '.join(one) for one in asked.items())} asked, which only earlier"
            f" versions did; set {', '.join(f'dic.{name}={now[name]}' for name in asked)}, or a"
            " dic.preset, to correlate now"
        )

    @property
    def polygons(self) -> tuple[Polygon, ...]:
        """The region in which displacements are measured; ValueError if one cannot be read."""
        return tuple(map(_polygon, self.region))

    @property
    def averaging_box_px(self) -> float:
        """Side of the box whose plain average passes as much of long waves as the correlation does
        (``python -m benchmarks dic waves``).
        """
        if self.is_quadratic:
            return 0.25 * self.box  # a quadratic within the box follows what a mean would flatten
        return 0.6 * self.box if self.method == "shared" else float(self.box)

    @property
    def noise_box_px(self) -> float:
        """Side of the box whose plain average has the noise of a displacement, and shares as much
        of it with its neighbours.
        """
        # the value in the middle of a quadratic has 3.5 times the variance of the mean
        return self.box / math.sqrt(3.5) if self.is_quadratic else self.box

    @property
    def is_quadratic(self) -> bool:
        """Whether a displacement is that of a quadratic in the middle of its box."""
        return self.method != "direct" and self.order == 2


@dataclass(frozen=True, kw_only=True)
class StressSettings(Section):
    """The shear traction sigma_xz, computed from the displacement field with the block's Green's
    tensor.
    """

    method: str = option(
        "axisymmetric",
        "Profile about the contact's centre for every frame, or none",
        choices=("axisymmetric", "none"),
    )
    field: bool = option(
        False, "Also compute the traction at every grid point, by conjugate gradients"
    )
