"""Gauss-Newton of one box, slow and obvious: regression after regression."""

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

PARAMETERS = (2, 6, 12)  # of the orders 0, 1, 2


def by_spline(image):
    """A function that reads an image between its pixels."""
    knots = spline_filter(image, 5, mode="mirror")
    return lambda x, y: map_coordinates(knots, [y, x], order=5, mode="mirror", prefilter=False)


def taylor(order, p, x, y):
    """Displacement (x, y) at distances (x, y) from the centre of a box, from parameters in the
    order of `Solution`.
    """
    p = np.concatenate([p, np.zeros(12 - len(p))])
    ux = p[0] + p[2] * x + p[3] * y + p[6] * x * x / 2 + p[7] * x * y + p[8] * y * y / 2
    uy = p[1] + p[4] * x + p[5] * y + p[9] * x * x / 2 + p[10] * x * y + p[11] * y * y / 2
    return ux, uy


def box_pixels(grid, i, j):
    y, x = np.mgrid[
        grid.top[i] : grid.top[i] + grid.box_px, grid.left[j] : grid.left[j] + grid.box_px
    ]
    return x, y, x - grid.x_px[j], y - grid.y_px[i]


def slow_newton(reference, read, slopes, grid, i, j, order, usable):
    """Parameters, ZNCC and standard uncertainties of one box: regression after regression, the step
    applied to first order. `read` gives the grey levels of the other image between its pixels.
    """
    x, y, dx, dy = box_pixels(grid, i, j)
    f, w = reference[y, x], usable[y, x]
    gx, gy = (g[y, x] for g in slopes)
    p = np.zeros(PARAMETERS[order])
    units = np.eye(p.size)
    descents = [gx * ux + gy * uy for ux, uy in (taylor(order, unit, dx, dy) for unit in units)]
    design = np.stack([np.ones_like(f), f, *descents])[:, w].T
    for _ in range(60):
        ux, uy = taylor(order, p, dx, dy)
        g = read(x + ux, y + uy)[w]
        gain = g.std() / f[w].std()
        coefficients, sse, _, _ = np.linalg.lstsq(design, g, rcond=None)
        p = p - coefficients[2:] / gain
        if np.abs(coefficients[2:] / gain).max() < 1e-12:
            break
    zncc = np.corrcoef(f[w], g)[0, 1]
    variance = sse[0] / (gain * zncc) ** 2 / (w.sum() - p.size - 2)
    covariance = variance * np.linalg.inv(design.T @ design)
    return p, zncc, np.sqrt([covariance[2, 2], covariance[3, 3]])
