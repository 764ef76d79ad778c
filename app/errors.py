"""What a user can mend."""


class UserError(Exception):
    """Input that can not be used; one sentence says what it is and what to do.

    The program ends with exit code 2.
    """
