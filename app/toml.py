"""TOML of the size of settings, from whoever wrote it."""

from __future__ import annotations

import tomllib
from typing import Any

LONGEST_TOML, MOST_DOTS = 1 << 16, 100  # characters; in a line


def parse_toml(text: str) -> dict[str, Any]:
    """Nested plain dicts from a TOML text of the size of settings; ValueError if it is none.

    The limits are there because the parser of the standard library takes minutes for a key of
    thousands of parts.
    """
    if len(text) > LONGEST_TOML:
        raise ValueError(f"more than {LONGEST_TOML} characters, which no settings need")
    if any(line.partition("#")[0].count(".") > MOST_DOTS for line in text.splitlines()):
        raise ValueError(f"a line with more than {MOST_DOTS} dots, which no settings need")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
