"""What the clipping of black pixels does to the noise of a box."""

from __future__ import annotations

import cv2
import numpy as np

from analysis.arrays import F64
from analysis.dic.spectrum import TextureCorrelation, slopes
from analysis.dic.tracker import ReferenceImage

FEW = 0.01  # share of the pixels of a picture; if fewer are clipped, nothing changes
# of the contrast: what the interpolation of clipped grains leaves in the corner of the spectrum
CLIPPED_GRAINS = 0.05


def clipped_scatter(reference: ReferenceImage, texture: TextureCorrelation) -> F64 | float:
    """By what the residuals of each box understate the scatter of its displacement along x and y,
    shape (2, ny, nx), where usable pixels of the reference are clipped at 0; 1: hardly any
    is.

    A clipped pixel has neither noise nor slope: the noise of a box is that of its other pixels,
    which alone say where it is, and its residuals average over all.
    """
    image, grid = reference.image, reference.grid
    clipped = image == 0
    if reference.usable is not None:
        clipped &= reference.usable
    if np.count_nonzero(clipped) < FEW * clipped.size:
        return 1.0
    # the share of the noise that clipping leaves a pixel is that of the pixels around above 0
    noise = cv2.blur((~clipped).astype(np.float32), (3, 3))
    grains = CLIPPED_GRAINS * texture.contrast / max(texture.noise, 1e-9)
    pixels = np.maximum(grid.box_sums(noise), 1e-9) / grid.box_px**2
    squares = [slope**2 for slope in slopes(image.astype(np.float32), texture)]
    seen = [grid.box_sums(noise * s) / np.maximum(grid.box_sums(s), 1e-9) for s in squares]
    return np.sqrt(1 + (np.stack(seen) / pixels - 1) * max(0.0, 1 - grains**2))
