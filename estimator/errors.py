"""The one error the estimator raises for a request it cannot meet."""


class ModelError(ValueError):
    """A model, observer or controller was asked for something that has no meaning; the message says what to change."""
