"""The two ways in which unshutter says no."""


class UnshutterError(Exception):
    """Something about the input makes the job impossible; the message is one line for the user (exit code 1)."""


class UsageError(UnshutterError):
    """The request itself is wrong, whatever the input (exit code 2)."""
