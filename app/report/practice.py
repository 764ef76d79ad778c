"""What the Good Practices Guide asks of a publication that rests on two-dimensional digital image
correlation, from the settings and the results; what the program cannot know is said to be so.

References
----------
International Digital Image Correlation Society, A Good Practices Guide for Digital Image
Correlation (2018), doi 10.32720/idics/gpg.ed1, section 5.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.dic.spectrum import texture
from app.report.paper.runs import FigureRun, Runs

PracticeRows = list[tuple[str, str, str]]
"""Rows of the table: heading of their part, item, value."""
_Items = dict[str, str]

UNKNOWN = "not recorded"
CRITERIA = {
    "direct": "zero-normalised cross-correlation, maximum of a two-dimensional Gaussian through"
    " nine points",
    "icgn": "zero-normalised sum of squared differences, inverse-compositional Gauss-Newton",
    "shared": "sum of squared differences, normalised in mean and contrast, in passes over the"
    " whole image, which is deformed back by a smoothed field",
}
MATCHED = "least squares for the spectrum of the reference, 8 taps"
ORDERS = ("shift", "affine (first order)", "quadratic (second order)")


def practice_rows(runs: Runs) -> PracticeRows:
    """All items; where runs differ, the value of each with its load."""
    rows: PracticeRows = []
    for part, items in (("measurement", _hardware), ("analysis", _analysis)):
        tables = [items(run) for run in runs]
        rows += [
            (part, item, _of_all(runs, [table[item] for table in tables])) for item in tables[0]
        ]
    return [*rows, ("measurement", "pattern feature size", _feature(runs[len(runs) // 2]))]


def _of_all(runs: Runs, values: Sequence[str]) -> str:
    """What an item says of all runs, and of whose run where they differ."""
    pairs = list(zip(runs, values, strict=True))
    if len(set(values)) == 1 or all(run.name in value for run, value in pairs):
        return "; ".join(dict.fromkeys(values))
    return "; ".join(f"{value} (at {run.name})" for run, value in pairs)


def _feature(run: FigureRun) -> str:
    """Size of the grains in the reference image of one run."""
    pictures = run.run.pictures
    if not pictures.reference.size:
        return UNKNOWN
    seen = texture(pictures.reference.astype(np.float32))
    size = 2 * math.sqrt(seen.grain_px2 / math.pi)
    return (
        f"{size:.1f} px ({size * pictures.pixel_m * 1e6:.0f} µm), diameter of the correlation area;"
        f" contrast {seen.contrast:.1f} and noise {seen.noise:.2f} grey levels (at {run.name})"
    )


def _hardware(run: FigureRun) -> _Items:
    config, pictures = run.config, run.run.pictures
    camera, pixel = config.camera, pictures.pixel_m
    simulated = camera.source == "sim"
    device = "simulated" if simulated else f"{camera.source} {camera.device}".strip()
    bits = camera.full_scale.bit_length()
    gain = UNKNOWN if camera.gain < 0 else f"{camera.gain:g} dB"
    shutter = f"rolling, corrected for {camera.readout * 1e3:.4g} ms" if camera.readout else ""
    wide, high = camera.width * pixel * 1e3, camera.height * pixel * 1e3
    return {
        "camera": f"{device}; maker and model {UNKNOWN}",
        "image size": f"{camera.width} x {camera.height} px, {bits} bit",
        "lens, focal length, aperture": UNKNOWN,
        "image scale": f"{pixel * 1e6:.4g} µm/px ± {100 * config.uncertainty.pixel:.2g} %",
        "distortion corrected": f"{100 * camera.distortion:.3g} % at a corner of the picture",
        "shutter": shutter or "global, or not corrected for its rows",
        "field of view": f"{wide:.2f} mm x {high:.2f} mm",
        "stand-off distance": UNKNOWN,
        "frame rate": f"{config.frame_rate_hz:.4g} images/s, triggered by the sample clock",
        "exposure": f"{camera.exposure * 1e3:.4g} ms; gain {gain}",
        "lighting": UNKNOWN,
        "pattern": "the rough surface itself: asperities and micro-contacts; nothing applied",
        "images": f"{len(run.run.frames)} at {run.name}",
    }


def _analysis(run: FigureRun) -> _Items:
    config = run.config
    dic, pixel = config.dic, run.run.pictures.pixel_m
    floor = UNKNOWN
    if math.isfinite(sigma := run.noise_px):
        floor = f"{sigma:.4f} px ({sigma * pixel * 1e9:.0f} nm), standard deviation of u_x of a box"
    shape = ORDERS[0 if dic.method == "direct" else dic.order]
    if dic.method == "shared" and dic.order < 2:
        shape = "shift, of an image that is deformed back by a smoothed field"
    blur = dic.averaging_box_px
    update = {"never": "the image at rest under load, for all images"}.get(
        dic.update, f"updated: {dic.update}"
    )
    return {
        "DIC software": f"SlipScope, method {dic.method}",
        "reference image": update,
        "image pre-filtering": "none",
        "subset (box) size": f"{dic.box} px ({dic.box * pixel * 1e6:.0f} µm)",
        "step": f"{dic.step} px ({dic.step * pixel * 1e6:.0f} µm)",
        "subset shape function": shape,
        "matching criterion": CRITERIA.get(dic.method, dic.method),
        "interpolant": dict(dic.retired).get("interpolant", MATCHED),
        "spatial resolution": (
            f"as a plain mean over a box of {blur:.3g} px ({blur * pixel * 1e6:.0f} µm)"
        ),
        "points left out": (
            f"correlation below {dic.min_correlation:g}, contrast below {dic.min_contrast:g} grey"
            f" levels, or more than {100 * dic.max_saturated:g} % of the box saturated"
        ),
        "post-filtering of displacements": "none of the fields; means over rings for profiles",
        "displacement noise floor": floor,
        "strain, virtual strain gauge": "not applicable: no strain is computed",
    }
