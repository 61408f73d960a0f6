"""What the user can mend."""


class UserError(ValueError):
    """Base of errors that a command shows as one line: a wrong value, file or recording."""
