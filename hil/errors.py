"""The one error a user of the bench meets when something given to it cannot be used."""


class InputError(ValueError):
    """A file, key or value given by the user is unusable.

    The message is one line that names the place and the cure, e.g.
    ``ride.csv:17: column vy_V: 'abc' is not a number; correct or remove the row``.
    The command line prints it as it is and exits with 2.
    """

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))
