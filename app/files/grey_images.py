"""Grey images in files: PNG, BMP, or TIFF with one or many pages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arrays import Array
from app.records.quantities import counted
from app.system.errors import UserError
from drivers.cameras.image_files import MOST_BYTES, decoded, page_count
from drivers.cameras.image_folder import SUFFIXES, images_of

# pictures and films that are not read
FOREIGN = frozenset(
    (".jpg", ".jpeg", ".jp2", ".gif", ".webp", ".avi", ".mp4", ".mov", ".mkv", ".wmv", ".cine")
)
CONVERT = (
    "convert pictures to PNG, for example by ffmpeg -i FOLDER/%06d.jpg -pix_fmt gray NEW/%06d.png,"
    " or a film by ffmpeg -i FILM -pix_fmt gray NEW/%06d.png"
)


@dataclass(frozen=True, slots=True)
class ImagePage:
    """An image in a file: the only one, or a page of many, from 0 on."""

    path: Path
    page: int | None = None

    @property
    def name(self) -> str:
        """The file, and the page if it holds many."""
        return self.path.name if self.page is None else f"{self.path.name}, page {self.page}"

    def __str__(self) -> str:
        return str(self.path) if self.page is None else f"{self.path}, page {self.page}"


def pictures_of(paths: Iterable[Path]) -> list[ImagePage]:
    """The images of files, of the pages of files that hold many, and of folders, in their order.

    Raises
    ------
    UserError
        There is no such file, or a folder without images.
    """
    pictures: list[ImagePage] = []
    for path in paths:
        files = images_of(path) if path.is_dir() else [path]
        if not files:
            raise UserError(
                f"{path}: no image ({', '.join(SUFFIXES)}) in this folder; {_instead(path)}"
            )
        for file in files:
            try:
                pages = page_count(file) if file.is_file() else 1
            except OSError:  # told by who reads it
                pages = 1
            of_file = [ImagePage(file)] if pages < 2 else [ImagePage(file, n) for n in range(pages)]
            pictures.extend(of_file)
    return pictures


def _instead(folder: Path) -> str:
    """What to do with a folder in which there is no image."""
    kinds = Counter(path.suffix.lower() for path in folder.iterdir())
    for kind, count in kinds.most_common():
        if kind in FOREIGN:
            return f"it has {counted(count, 'file')} *{kind}; {CONVERT}"
    return "check the name"


def read_image(source: Path | ImagePage, most_bytes: int = MOST_BYTES) -> Array:
    """The grey levels of an image, shape (rows, columns), as stored: 8 or 16 bit, or 32-bit floats.

    A file with three equal channels (a grey palette, a grey picture saved as RGB, or as RGBA where
    nothing of it is transparent) counts as grey.

    Raises
    ------
    UserError
        The file is missing, is not an image, holds several images or colours, or takes more than
        `most_bytes` of memory.
    """
    path = source if isinstance(source, ImagePage) else ImagePage(source)
    try:
        image = decoded(path.path, most_bytes, path.page)
    except ValueError as error:
        is_foreign = path.path.suffix.lower() in FOREIGN
        raise UserError(f"{path}: {error}" + f"; {CONVERT}" * is_foreign) from None
    except OSError as error:
        raise UserError(
            f"{path}: the file cannot be read ({error.strerror or error}); check the name"
        ) from None
    if image.ndim == 3 and image.shape[2] == 4 and image[..., 3].min() == _opaque(image):
        image = image[..., :3]
    if image.ndim == 3 and image.shape[2] == 3 and (image == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise UserError(
            f"{path}: a colour image ({image.shape[2]} channels); convert it to grey levels"
        )
    return np.ascontiguousarray(image)


def _opaque(image: Array) -> float:
    """The value of a channel of opacity where nothing shines through."""
    return float(np.iinfo(image.dtype).max) if image.dtype.kind == "u" else 1.0


def size_text(image: Array) -> str:
    """Width, height and pixel type of an image, for a message: ``1600 x 1200 uint8``."""
    rows, columns = image.shape
    return f"{columns} x {rows} {image.dtype}"
