"""Errors that a user can correct."""


class UserError(Exception):
    """Input that cannot be used; one sentence says what is wrong and what to do.

    The program ends with exit code 2.
    """


def in_full(error: BaseException) -> str:
    """An error that nobody has put into words for people: its type, and what it says."""
    return f"{type(error).__name__}: {error}"


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
