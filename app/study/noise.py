"""How the scatter of u_x falls with the side of the correlation box, for the pictures of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from app.records.study_results import BoxNoise
from app.settings.sections import Config
from app.tradeoff.correlation_study import Scale, Tracking, VariantTimer
from app.tradeoff.exact_speckle import Picture
from app.tradeoff.texture import texture_of

BOXES = (10, 14, 20, 28, 38, 50, 70, 100)  # px; the paper's range
SCALE = Scale(crop=(576, 768), fractions=4)
DIRECT = {"method": "direct", "order": 1}  # of the paper
NOTHING = BoxNoise(np.empty(0), np.empty(0), np.empty(0), np.empty(0))


def box_noise(config: Config, reference: Picture | None, at_rest: Sequence[Picture]) -> BoxNoise:
    """Scatter of u_x and its Cramer-Rao bound in boxes of 10 to 100 px, on exactly displaced
    pictures of the texture and the noise of a run, by its method of correlation and by that of the
    paper; empty where there is no texture.

    Parameters
    ----------
    reference : ndarray or None
    at_rest : sequence of ndarray
        Further pictures of the same, which tell the noise.
    """
    if reference is None:
        return NOTHING
    try:
        texture = texture_of(reference, at_rest, config.camera.full_scale)
    except ValueError:  # a picture of nothing
        return NOTHING
    dic, bench = config.correlation, VariantTimer(texture, SCALE.crop, SCALE, 1)
    own = {name: getattr(dic, name) for name in ("method", "order", "tolerance")}
    methods = [own] if dic.method == DIRECT["method"] else [own, own | DIRECT]
    rows = []
    for box in BOXES:
        step = max(BOXES[0], box // 2)  # boxes that share more tell little more
        found = []
        for how in methods:
            tracking = Tracking({**how, "box": box, "step": step}, 1, texture.end)
            _, sigma, lost = bench.errors(tracking, box)
            found.append(sigma if lost < 1 else math.nan)
        rows.append((box, found[0], bench.floor(box, step), found[-1]))
    return BoxNoise(*np.array(rows, np.float64).T)
