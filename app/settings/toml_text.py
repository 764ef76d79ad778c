"""TOML of the size of settings, from whoever wrote it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from app.system.errors import ConfigError
from app.system.inputs import check_ends

LONGEST_TOML, MOST_DOTS = 1 << 16, 100  # characters; in a line
LONGEST_WRITTEN = 4 * LONGEST_TOML  # the program writes every setting, with what it means
LISTED = re.compile(r"\d\.\d+(e[+-]?\d+)?[ \t]*(?=[],])")  # a number in a list, which is no key
DECIMAL_COMMA = re.compile(r"=[ \t]*([+-]?\d+,\d+)[ \t]*(?:#.*)?\r?$", re.MULTILINE)


def parse_toml(text: str, longest: int = LONGEST_WRITTEN) -> dict[str, Any]:
    """Nested plain dicts from a TOML text of the size of settings; ValueError if it is none.

    The limits are there because the parser of the standard library takes minutes for a key of
    thousands of parts.
    """
    if len(text) > longest:
        raise ValueError(f"more than {longest} characters, which no settings need")
    lines = (LISTED.sub("", line.partition("#")[0]) for line in text.splitlines())
    if any(line.count(".") > MOST_DOTS for line in lines):
        raise ValueError(f"a line with more than {MOST_DOTS} dots, which no settings need")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        advice = ""
        for comma in DECIMAL_COMMA.finditer(text):
            number = 1 + text.count("\n", 0, comma.start())
            if f"line {number}," in str(error):
                advice = f"; write {comma[1].replace(',', '.')} for {comma[1]}"
        raise ValueError(f"{error}{advice}") from None
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_toml(path: Path, what: str, known: Iterable[str]) -> dict[str, Any]:
    """Nested plain dicts from a TOML file; ConfigError if it cannot be read or is none. `known`
    are names of the program's own.
    """
    try:
        check_ends(path)
        with path.open("rb") as file:
            return parse_toml(decoded(file.read(2 * LONGEST_TOML + 2)), LONGEST_TOML)
    except OSError as error:
        raise ConfigError(
            f"{path}: the {what} cannot be read: {error.strerror}; check the name, or take one of"
            f" the program's own: {', '.join(known)}"
        ) from None
    except UnicodeError:
        raise ConfigError(
            f"{path}: not a TOML file: it is no text in UTF-8; save it so, or give a {what}"
        ) from None
    except ValueError as error:
        raise ConfigError(f"{path}: not a TOML file: {error}") from None


def decoded(content: bytes) -> str:
    """Text of a settings file; Windows shells write UTF-16 when they redirect output."""
    return content.decode("utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig")
