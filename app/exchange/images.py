"""Grey images in files: PNG or TIFF, one image in each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.errors import UserError


def read_image(path: Path) -> NDArray[Any]:
    """The grey levels of an image file, shape (rows, columns), as stored: 8 or 16 bit, or 32-bit
    floats.

    A file with three equal channels (a grey palette, a grey picture saved as RGB) counts as grey.

    Raises
    ------
    UserError
        The file is missing, is not an image, or holds several images or colours.
    """
    try:
        data = np.fromfile(path, np.uint8)  # OpenCV itself opens only some paths on Windows
    except OSError as error:
        raise UserError(
            f"{path}: the file can not be read ({error.strerror or error}); check the name"
        ) from None
    pages = _decoded(data)
    if not pages:
        raise UserError(f"{path}: not an image that can be read; give a PNG or TIFF file")
    if len(pages) > 1:
        raise UserError(f"{path}: {len(pages)} images in one file; save each as a file of its own")
    image: NDArray[Any] = np.asarray(pages[0])
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


def _decoded(data: NDArray[np.uint8]) -> list[NDArray[Any]]:
    """The images in an encoded file; none if it can not be decoded.

    OpenCV's own messages about damaged files are kept off the terminal.
    """
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        is_decoded, pages = cv2.imdecodemulti(data, cv2.IMREAD_UNCHANGED)
        return list(pages) if is_decoded else []
    except cv2.error:
        return []
    finally:
        cv2.utils.logging.setLogLevel(level)
