"""Errors that a user can correct, and the words of others in a sentence."""

import re

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x0d\x0e-\x1f\x7f-\x9f]")  # could steer a terminal


class UserError(Exception):
    """Input that cannot be used; one sentence says what is wrong and what to do.

    The program ends with exit code 2.
    """


def spelled_out(text: str) -> str:
    """A text with its control characters spelled out, but for tabs and ends of lines."""
    return _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)


def in_full(error: BaseException) -> str:
    """An error that nobody has put into words for people: its type, and what it says."""
    return f"{type(error).__name__}: {error}".removesuffix(": ")


class ConfigError(UserError, ValueError):
    """The settings cannot be used; the message says which key, what was found, what is allowed."""


class MissingFile(UserError, FileNotFoundError):
    """There is no such file; the message says what was looked for."""


class UnderLoad(UserError):
    """The sensors were to be zeroed while they read a force; who asked may say that it is none."""


class CalibrationRefused(ValueError):
    """The data of a calibration cannot be trusted; one sentence says why and what to do.

    The program ends with exit code 1.
    """
