"""What the results keep of a run's pictures: grey levels of 8 bits, and the search for one box in a
later picture (Figs 4a to 4c).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from analysis.arrays import U8, Array
from analysis.calibration.dic_noise import correlation_map
from analysis.dic.correlation import highest_by_chance
from analysis.dic.spectrum import texture
from app.records.study_results import BoxSearch
from app.settings.sections import Config

SEARCH_PX = 16  # largest displacement along x and y that is tried
MARGIN_PX = 8  # of what is kept around the search window


def grey8(image: Array | None, config: Config) -> U8:
    """An image with grey levels up to 255; an empty one for None."""
    if image is None:
        return np.empty((0, 0), np.uint8)
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    return np.asarray(image / (config.camera.full_scale / 255), np.uint8)


def box_search(
    config: Config,
    reference: Array | None,
    centre_px: tuple[float, float],
    later: Iterable[tuple[int, Array]],
) -> BoxSearch | None:
    """The search for the box at a point of the reference in the first of the later pictures in
    which it is found; None where there is none.

    Parameters
    ----------
    centre_px : tuple of float
        x and y of the point.
    later : iterable of (int, ndarray)
        Trigger number and picture.

    References
    ----------
    Prevost et al. 2013, section 2.3.2 and Fig. 4.
    """
    if reference is None:
        return None
    box = config.dic.box
    x, y = (round(centre - (box - 1) / 2) for centre in centre_px)
    kept = SEARCH_PX + MARGIN_PX
    left, top = max(0, x - kept), max(0, y - kept)
    # above what chance reaches, as for the method direct
    grain = texture(reference.astype(np.float32))
    least = max(config.dic.min_correlation, highest_by_chance(grain, box, SEARCH_PX))
    cut = slice(top, y + box + kept), slice(left, x + box + kept)
    for frame, image in later:
        try:
            found = correlation_map(reference, image, x, y, box, SEARCH_PX)
        except ValueError:  # it has moved further, or the window leaves the picture
            continue
        if found.c.max() >= least:
            before, after = grey8(reference[cut], config), grey8(image[cut], config)
            place = frame, box, x, y, left, top
            return BoxSearch(*place, before, after, found.tau_y, found.tau_x, found.c, *found.peak)
    return None
