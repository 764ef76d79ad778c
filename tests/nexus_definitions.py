"""What the definitions of NeXus, which come with nexusformat, have against a file."""

from __future__ import annotations

import logging
from pathlib import Path

from nexusformat.nexus.validate import FileValidator, logger


def faults(path: Path) -> list[str]:
    """What they forbid; what they do not know is no fault."""
    found: list[str] = []

    class Kept(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.levelno == logging.ERROR:
                found.append(record.getMessage().strip())

    others, kept = logger.handlers[:], Kept()
    logger.handlers = [kept]
    try:
        FileValidator(path).validate()
    finally:
        logger.handlers = others
    return found
