"""Surface displacement of an elastic block under tangential tractions on a grid: half-space, or
layer on a rigid plate. SI units.

The kernels are uniform tractions on rectangular cells, integrated in closed form; they are
convolved without periodic images.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray
from scipy import fft
from scipy.special import j0, jv

from analysis.arrays import F64, floats
from analysis.mechanics.hertz import check

THINNEST = 3
"""Least thickness of a layer in pitches: its part of the kernel is taken at the middle of a cell,
which is then right to 0.5 % of it.
"""
NEAR_NODES, FAR_NODES = 8, 4  # Gauss nodes in each direction
TABLE = 600
MAX_THICKNESSES = 40.0  # beyond which the surface of a layer does not move (exp(-40))
Three = tuple[F64, F64, F64]


class SurfaceGreen:
    """Displacement of the block's surface at the middles of a grid's cells from the shear traction
    on the cells, as a linear operator.

    Parameters
    ----------
    shape : (ny, nx)
    pitch : float or (float, float)
        Distance between points, along x and y, metres; also the size of a cell.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio, 0 to 0.5.
    thickness : float
        Of a layer bonded to a rigid plate, metres, `THINNEST` pitches or more; default a
        half-space.
    box : float
        Side of the square over which the displacement is averaged, as image correlation does,
        metres.
    coupled : bool
        Both components, arrays of shape (2, ny, nx), (x, y); otherwise x alone, shape (ny, nx).

    Raises
    ------
    ValueError
        A parameter is out of its range.

    Notes
    -----
    Per metre of distance r, ``G_ij = [(1 - nu) delta_ij / r + nu x_i x_j / r^3] / (2 pi G)``. A
    layer adds, in the plane of wave vectors, ``(1 - nu)(F - 1)/(G q)`` along q and ``(tanh qH -
    1)/(G q)`` across, where ``F = [(3 - 4 nu) sinh 2qH + 2qH] / [(3 - 4 nu) cosh 2qH + 2 (qH)^2 + 5
    - 12 nu + 8 nu^2]``; the tangential displacement by normal tractions is left out (for the
    half-space at nu = 1/2 there is none).

    References
    ----------
    Johnson, Contact Mechanics, eq. 3.91 and section 3.6; Prevost et al. 2013, section 4 (Green's
    tensor).
    """

    def __init__(
        self,
        shape: tuple[int, int],
        pitch: float | tuple[float, float],
        E: float,
        nu: float,
        *,
        thickness: float = math.inf,
        box: float = 0.0,
        coupled: bool = False,
    ) -> None:
        px, py = (float(p) for p in (pitch if isinstance(pitch, tuple) else (pitch, pitch)))
        ny, nx = shape
        check("surface displacement", E=E, nu=nu, pitch_x=px, pitch_y=py)
        check_block(thickness, box, max(px, py), "surface displacement")
        if not (ny >= 1 and nx >= 1 and ny * nx >= 2):
            raise ValueError(
                f"surface displacement: a grid of {nx} x {ny} points was given; use two or more"
            )
        self.shape, self.pitch, self.coupled = (int(ny), int(nx)), (px, py), coupled
        rows, columns = (fft.next_fast_len(2 * n - 1, real=True) for n in (ny, nx))
        self._padded = rows, columns
        x, y = px * np.arange(float(nx)), py * np.arange(float(ny))
        one, xx, xy = _box_averaged(x, y, (px, py), box)
        scale = (1 + nu) / (np.pi * E)  # 1 / (2 pi G)
        g_xx = scale * ((1 - nu) * one + nu * xx)
        g_yy = scale * ((1 - nu) * one + nu * (one - xx))
        g_xy = scale * nu * xy
        if math.isfinite(thickness):
            even, double = layer_correction(np.hypot(x[None, :], y[:, None]), E, nu, thickness)
            angle = 2 * np.arctan2(y[:, None], x[None, :])
            area = px * py
            g_xx += area * (even + double * np.cos(angle))
            g_yy += area * (even - double * np.cos(angle))
            g_xy += area * double * np.sin(angle)
        self._xx = self._transformed(g_xx, odd=False)
        if coupled:
            self._yy = self._transformed(g_yy, odd=False)
            self._xy = self._transformed(g_xy, odd=True)

    def apply(self, sigma: ArrayLike) -> F64:
        """Displacement G*sigma in metres of the surface under the tractions `sigma` in pascals,
        same shape.

        The operator is its own transpose, because two cells act on each other alike (Maxwell and
        Betti).
        """
        sigma = floats(sigma)
        if not self.coupled:
            return self._back(self._forth(sigma) * self._xx)
        sx, sy = self._forth(sigma[0]), self._forth(sigma[1])
        ux, uy = sx * self._xx + sy * self._xy, sx * self._xy + sy * self._yy
        return np.stack([self._back(ux), self._back(uy)])

    def norm(self, mask: ArrayLike | None = None) -> float:
        """Largest eigenvalue, metres per pascal, of the operator between the points of a mask,
        shape (ny, nx); default all points.
        """
        inside = np.ones(self.shape, np.bool_) if mask is None else np.asarray(mask, np.bool_)
        if inside.shape != self.shape or not inside.any():
            raise ValueError(
                f"operator norm: a mask of shape {inside.shape} with {inside.sum()} points found;"
                f" use shape {self.shape} and a point"
            )
        inside = np.broadcast_to(inside, (2, *self.shape)) if self.coupled else inside
        n = int(inside.sum())

        def masked(v: F64) -> F64:
            field = np.zeros(inside.shape)
            field[inside] = v
            return self.apply(field)[inside]

        if n < 3:
            return float(np.linalg.eigvalsh(np.column_stack([masked(v) for v in np.eye(n)]))[-1])
        between = scipy.sparse.linalg.LinearOperator((n, n), matvec=masked, dtype=np.float64)
        largest = scipy.sparse.linalg.eigsh(
            between, k=1, tol=1e-6, v0=np.ones(n), return_eigenvectors=False
        )
        return float(largest[0]) * (1 + 1e-5)

    def _transformed(self, quadrant: F64, *, odd: bool) -> F64:
        """Real Fourier transform of a kernel known for x, y >= 0; `odd` in both x and y, or even in
        both.
        """
        (ny, nx), (my, mx) = self.shape, self._padded
        sign = -1.0 if odd else 1.0
        kernel = np.zeros(self._padded)
        kernel[:ny, :nx] = quadrant
        kernel[:ny, mx - nx + 1 :] = sign * quadrant[:, :0:-1]
        kernel[my - ny + 1 :] = sign * kernel[ny - 1 : 0 : -1]
        return np.ascontiguousarray(fft.rfft2(kernel).real)

    def _forth(self, field: F64) -> NDArray[np.complex128]:
        if field.shape != self.shape:
            raise ValueError(
                f"surface displacement: a field of shape {field.shape} found; the operator has"
                f" {self.shape}"
            )
        rows = fft.rfft(field, self._padded[1], axis=1)
        return np.asarray(fft.fft(rows, self._padded[0], axis=0, overwrite_x=True))

    def _back(self, spectrum: NDArray[np.complex128]) -> F64:
        ny, nx = self.shape
        rows = fft.ifft(spectrum, axis=0, overwrite_x=True)[:ny]
        return np.ascontiguousarray(fft.irfft(rows, self._padded[1], axis=1)[:, :nx])


def check_block(thickness: float, box: float, pitch: float, who: str) -> None:
    """Refuse a layer too thin for the grid, and a correlation box that is none.

    Raises
    ------
    ValueError
        As said; `who` begins the message.
    """
    thinnest = THINNEST * pitch
    if not thickness >= thinnest:
        raise ValueError(
            f"{who}: a block {thickness:g} m thick was given; use {thinnest:g} m ({THINNEST}"
            " pitches) or more"
        )
    if not 0 <= box < math.inf:
        raise ValueError(f"{who}: a correlation box of {box:g} m was given; use 0 or more")


def _cell_integrals(x: F64, y: F64, pitch: tuple[float, float]) -> Three:
    """Integrals of 1/r, x^2/r^3, x y/r^3 over a cell about the origin, seen from (x, y); metres."""
    one, xx, xy = (np.zeros(np.broadcast_shapes(x.shape, y.shape)) for _ in range(3))
    for i in (-0.5, 0.5):
        for j in (-0.5, 0.5):
            X, Y = x + i * pitch[0], y + j * pitch[1]
            sign = 4 * i * j
            along = Y * np.arcsinh(np.divide(X, np.abs(Y), out=np.zeros_like(X * Y), where=Y != 0))
            across = X * np.arcsinh(np.divide(Y, np.abs(X), out=np.zeros_like(X * Y), where=X != 0))
            one += sign * (along + across)
            xx += sign * along
            xy -= sign * np.hypot(X, Y)
    return one, xx, xy


def _box_averaged(x: F64, y: F64, pitch: tuple[float, float], box: float) -> Three:
    """The cell integrals averaged over a square about each point of the quadrant (x, y)."""
    if box == 0:
        return _cell_integrals(x[None, :], y[:, None], pitch)
    fields = _averaged(x, y, pitch, box, is_near=False)
    near_x, near_y = (math.ceil(2 * box / p) + 8 for p in pitch)
    near = _averaged(x[:near_x], y[:near_y], pitch, box, is_near=True)
    for field, part in zip(fields, near, strict=True):
        field[:near_y, :near_x] = part
    return fields


def _averaged(x: F64, y: F64, pitch: tuple[float, float], box: float, *, is_near: bool) -> Three:
    (tx, wx), (ty, wy) = (_box_nodes(p, box, is_near=is_near) for p in pitch)
    at_x, fields = (x[:, None] + tx).ravel(), np.empty((3, y.size, x.size))
    for row, at in enumerate(y.tolist()):  # all at once would take gigabytes for a wide box
        cells = _cell_integrals(at_x[None, :], (at + ty)[:, None], pitch)
        shape = ty.size, x.size, tx.size
        fields[:, row] = [np.einsum("ajb,a,b->j", f.reshape(shape), wy, wx) for f in cells]
    one, xx, xy = fields
    return one, xx, xy


def _box_nodes(pitch: float, box: float, *, is_near: bool) -> tuple[F64, F64]:
    """Nodes and weights, of sum 1, of Gauss over a box; near the source in parts that end where a
    cell does: there the integrand bends.
    """
    n = math.ceil(box / (2 * pitch) + 0.5) if is_near else 0
    edges = pitch * (np.arange(-float(n), n) + 0.5)
    ends = np.concatenate([[-box / 2], edges[np.abs(edges) < box / 2 * (1 - 1e-9)], [box / 2]])
    t, w = np.polynomial.legendre.leggauss(NEAR_NODES if is_near else FAR_NODES)
    half = np.diff(ends)[:, None] / 2
    return (ends[:-1, None] + half * (1 + t)).ravel(), (half * w / box).ravel()


def layer_correction(r: ArrayLike, E: float, nu: float, thickness: float) -> tuple[F64, F64]:
    """What a rigid plate behind a bonded layer adds to the half-space's G_xx, as (even, double):
    ``even + double cos 2 theta``.

    `r` in metres; result in metres per newton, shape of `r`. ``G_xy`` is ``double sin 2 theta``.
    Near r = 0 `even` is about -0.2 to -0.25 of 1/(G H): the surface moves almost uniformly less.
    """
    r = floats(r)
    G, place = E / (2 * (1 + nu)), r / thickness
    far = min(float(place.max(initial=0.0)), MAX_THICKNESSES)
    t, w = np.polynomial.legendre.leggauss(80 + int(12 * far))
    q, w = 9.5 * (1 + t), 9.5 * w  # q H up to 19: exp(-38) is left
    across = np.tanh(q) - 1
    along = (1 - nu) * _layer_along(q, nu)
    at = np.linspace(0.0, max(far, 1e-6), TABLE)
    qr = np.outer(at, q)
    scale = 1 / (4 * np.pi * G * thickness)
    even = scale * j0(qr) @ (w * (along + across))
    double = -scale * jv(2, qr) @ (w * (along - across))
    near, beyond = (
        np.minimum(place, far),
        2 * np.pi * G * np.maximum(r, MAX_THICKNESSES * thickness),
    )
    spline = scipy.interpolate.CubicSpline
    return (
        np.where(place > MAX_THICKNESSES, (nu / 2 - 1) / beyond, spline(at, even)(near)),
        np.where(place > MAX_THICKNESSES, -nu / 2 / beyond, spline(at, double)(near)),
    )


def _layer_along(q: F64, nu: float) -> F64:
    """F - 1 of the layer for wave vectors along the traction; `q` in units of 1/H."""
    k, rest, decay = 3 - 4 * nu, 5 - 12 * nu + 8 * nu * nu, np.exp(-2 * q)
    # numerator less denominator, by hand: they cancel
    excess = decay * (4 * q - 4 * q * q - 2 * rest - 2 * k * decay)
    return np.asarray(excess / (k * (1 + decay * decay) + decay * (4 * q * q + 2 * rest)))
