"""The one error the estimator raises for a request it cannot meet, and a kind of it that a search can go round."""


class ModelError(ValueError):
    """A model, observer or controller was asked for something that has no meaning; the message says what to change."""


class DivergedError(ModelError):
    """An observer that does not follow the record: its states are no numbers any more."""

    def __init__(self) -> None:
        super().__init__(
            "the observer diverges on this record; correct [device] (signs, gains, noise_V) or [observer] (memory_s, "
            "initial_sd) in the bench file"
        )
