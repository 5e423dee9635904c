"""The models there are, numbered: the number is what a compiled kernel dispatches on."""

from estimator.errors import ModelError
from estimator.model.declaration import Model
from estimator.model.gyro import GYRO
from estimator.model.oscillator import OSCILLATOR

MODELS: tuple[Model, ...] = (GYRO, OSCILLATOR)


def model_for(axes: int) -> tuple[int, Model]:
    """Number and declaration of the model of a device with that many axes.

    Raises ModelError when no model has that many.
    """
    for number, model in enumerate(MODELS):
        if model.axes == axes:
            return number, model
    raise ModelError(f"no model with {axes} axes; known: {', '.join(str(model.axes) for model in MODELS)}")
