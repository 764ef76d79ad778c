"""Errors that a user can correct."""


class UserError(Exception):
    """Input that can not be used; one sentence says what is wrong and what to do.

    The program ends with exit code 2.
    """
