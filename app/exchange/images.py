"""Grey images in files: PNG or TIFF, one image in each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from drivers.image_files import MOST_BYTES, decoded


def read_image(path: Path, most_bytes: int = MOST_BYTES) -> NDArray[Any]:
    """The grey levels of an image file, shape (rows, columns), as stored: 8 or 16 bit, or 32-bit
    floats.

    A file with three equal channels (a grey palette, a grey picture saved as RGB) counts as grey.

    Raises
    ------
    UserError
        The file is missing, is not an image, holds several images or colours, or takes more than
        `most_bytes` of memory.
    """
    try:
        image = decoded(path, most_bytes)
    except ValueError as error:
        raise UserError(f"{path}: {error}") from None
    except OSError as error:
        raise UserError(
            f"{path}: the file can not be read ({error.strerror or error}); check the name"
        ) from None
    if image.ndim == 3 and image.shape[2] == 3 and (image == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise UserError(
            f"{path}: a colour image ({image.shape[2]} channels); convert it to grey levels"
        )
    return np.ascontiguousarray(image)


def size_text(image: NDArray[Any]) -> str:
    """Width, height and pixel type of an image, for a message: ``1600 x 1200 uint8``."""
    rows, columns = image.shape
    return f"{columns} x {rows} {image.dtype}"
