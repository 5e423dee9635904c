"""The one error a user of the bench meets when something given to it cannot be used."""


class InputError(ValueError):
    """A file, key or value given by the user is unusable.

    The message is one line that names the place and the cure, e.g.
    ``ride.csv:17: column vy_V: 'abc' is not a number; correct or remove the row``.
    The command line prints it as it is and exits with 2.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))


_PACKAGES = ("hil", "estimator", "device_emulator")


def told_to_user(error: BaseException) -> str | None:
    """What a user has to know about ``error``, or None when the fault is ours and the traceback is due.

    Known by the package of its class: an emulator's errors come through an entry point, and nothing here may import
    them.
    """
    if type(error).__module__.partition(".")[0] in _PACKAGES:
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {(error.strerror or 'cannot be used').lower()}"
    return None
