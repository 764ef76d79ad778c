"""Displacement fields of a run as a film, MP4 or GIF: maps with one fixed colour bar, axes in mm,
and the time and forces of each. One field is in memory at a time.
"""

from __future__ import annotations

import errno
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from analysis.arrays import F64, U8
from app.records.quantities import resolved
from app.records.record_types import Snapshot
from app.report.figures import STYLE, draw_field
from app.system.errors import UserError

RGB = U8  # shape (rows, columns, 3)
WIDTH_IN, DPI = 6.4, 100  # of a picture
ABOVE_IN = 1.1  # height of a picture beside that of the map
RATES_HZ = (2.0, 30.0)  # slowest and fastest film
_LEAST_BYTES = 1 << 12  # of a film
# of an MP4, the first that OpenCV has on this computer
CODINGS = {"avc1": "H.264", "vp09": "VP9, for browsers and VLC; PowerPoint may need a .gif"}
COLOURS, GREYS = 200, 56  # of a GIF: of the map, and of text and lines
CIRCLE: dict[str, Any] = {
    "fill": False, "ec": "#303030", "lw": 1.1,
    "path_effects": [withStroke(linewidth=2.0, foreground="white")],
}  # fmt: skip


@dataclass(frozen=True)
class FilmScene:
    """What all pictures of a film have in common.

    Attributes
    ----------
    x_mm, y_mm : ndarray, shape (nx,) and (ny,)
        Of the boxes from the contact's centre, y down.
    name : str
        Of the colour bar, with its unit.
    limits : tuple of float
        Values at its ends.
    is_signed : bool
        Whether the middle of the colours is 0.
    contact_mm : float
        Radius of the apparent contact; NaN: not measured.
    rate_hz : float
        Pictures in a second of the film.
    """

    x_mm: F64
    y_mm: F64
    name: str
    limits: tuple[float, float]
    is_signed: bool
    contact_mm: float
    rate_hz: float


def write_film(path: Path, scene: FilmScene, shots: Iterable[tuple[Snapshot, F64]]) -> str:
    """Write a picture of each field, shape (ny, nx) in the unit of the scene, with the conditions
    of its frame; the coding of the film.

    Raises
    ------
    UserError
        The film cannot be encoded.
    OSError
        It was not written completely.
    """
    with matplotlib.rc_context(STYLE):
        picture = _Picture(scene)
        pictures = (picture.of(snapshot, values) for snapshot, values in shots)
        if path.suffix.lower() == ".gif":
            _write_gif(path, scene.rate_hz, picture.colours, pictures)
            return "GIF"
        return _write_mp4(path, scene.rate_hz, picture.size, pictures)


class _Picture:
    """The picture of a field: what differs from one to the next is drawn over the rest."""

    def __init__(self, scene: FilmScene) -> None:
        shape = abs(np.ptp(scene.y_mm) / max(np.ptp(scene.x_mm), 1e-9))
        height = 2 * round((ABOVE_IN + 0.78 * WIDTH_IN * min(max(shape, 0.1), 2.0)) * DPI / 2) / DPI
        figure = Figure(figsize=(WIDTH_IN, height), dpi=DPI, layout="constrained")
        self._canvas = FigureCanvasAgg(figure)
        self._axes = figure.subplots()
        self.colours = "RdBu_r" if scene.is_signed else "viridis"
        nothing = np.full((len(scene.y_mm), len(scene.x_mm)), np.nan)
        draw_field(
            self._axes, nothing, scene.x_mm, scene.y_mm,
            label=scene.name, cut="", cmap=self.colours, limits=scene.limits,
        )  # fmt: skip
        self._stick = Circle((0, 0), 0, ls=":", **CIRCLE)
        edge = Circle((0, 0), scene.contact_mm, ls="--", **CIRCLE)
        self._field, self._title = self._axes.images[0], self._axes.set_title(" ", loc="left")
        self._moving: list[Artist] = [self._field, self._axes.add_patch(self._stick)]
        if scene.contact_mm > 0:
            self._moving.append(self._axes.add_patch(edge))
        self._moving += [*self._axes.spines.values(), self._title]
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._rest = self._canvas.copy_from_bbox(figure.bbox)
        self.size = self._canvas.get_width_height()

    def of(self, snapshot: Snapshot, values: F64) -> RGB:
        """The picture of one field."""
        now, c = snapshot.conditions, resolved(*snapshot.stick_radius)
        self._field.set_data(values)
        self._stick.set_radius(c * 1e3 if math.isfinite(c) else 0.0)
        known = [
            f"${symbol}$ = {value:z.{digits}f} {unit}"
            for symbol, value, digits, unit in (
                ("t", now.time_s, 2, "s"),
                ("P", now.normal_force_n, 3, "N"),
                ("Q", now.shear_force_n, 3, "N"),
            )
            if math.isfinite(value)
        ]
        self._title.set_text("   ".join([f"frame {snapshot.frame}, {now.phase}", *known]))
        self._canvas.restore_region(self._rest)
        for artist in self._moving:
            self._axes.draw_artist(artist)
        return np.asarray(self._canvas.buffer_rgba())[..., :3]


def _write_mp4(path: Path, rate_hz: float, size: tuple[int, int], pictures: Iterable[RGB]) -> str:
    """MP4 by OpenCV, which tells nobody of a full disk, in what browsers play; its coding."""
    path.write_bytes(bytes(_LEAST_BYTES))
    coding, writer = _opened_mp4(path, rate_hz, size)
    count = 0
    try:
        for picture in pictures:
            writer.write(np.ascontiguousarray(picture[..., ::-1]))
            count += 1
    finally:
        writer.release()
    film = cv2.VideoCapture(str(path))
    held = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    film.release()
    if held != count:
        raise OSError(
            errno.ENOSPC,
            f"it holds only {max(held, 0)} of {count} pictures, as where a disk is full",
        )
    return coding


def _opened_mp4(path: Path, rate_hz: float, size: tuple[int, int]) -> tuple[str, cv2.VideoWriter]:
    """A writer in the first of `CODINGS` that OpenCV has here, and the name of that."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # quiet: one may well be missing
    level = cv2.utils.logging.setLogLevel(0)
    try:
        for code, coding in CODINGS.items():
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), rate_hz, size)
            if writer.isOpened():
                return coding, writer
    finally:
        cv2.utils.logging.setLogLevel(level)
    raise UserError("OpenCV cannot encode MP4 on this computer; give a name that ends in .gif")


def _write_gif(path: Path, rate_hz: float, colours: str, pictures: Iterable[RGB]) -> None:
    """GIF by Pillow, picture by picture, all with the same colours; durations in whole hundredths
    of a second, whose rounding does not add up.
    """
    from PIL import Image
    from PIL.GifImagePlugin import getdata, getheader

    scale = matplotlib.colormaps[colours](np.linspace(0, 1, COLOURS))[:, :3]
    greys = np.linspace(0, 1, GREYS)[:, None].repeat(3, axis=1)
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.rint(255 * np.concatenate([scale, greys])).astype(int).ravel())
    with path.open("xb") as file:
        for n, picture in enumerate(pictures):
            whole = Image.fromarray(np.ascontiguousarray(picture))
            image = whole.quantize(palette=palette, dither=Image.Dither.NONE)
            if not file.tell():
                file.writelines(getheader(image, info={"loop": 0})[0])
            begin, end = (round(100 * k / rate_hz) for k in (n, n + 1))
            file.writelines(getdata(image, duration=(end - begin) * 10))
        file.write(b";")
