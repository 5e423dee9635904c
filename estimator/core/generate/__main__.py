"""`python -m estimator.core.generate FILE`: all models and the whole catalogue of effects as model.h."""

import os
import sys
from pathlib import Path

from estimator.core.generate.header import generated
from estimator.effects.catalogue import EFFECTS
from estimator.model.catalogue import MODELS


def main() -> None:
    """Write the file whole or not at all."""
    target = Path(sys.argv[1])
    scratch = target.with_suffix(f".{os.getpid()}")
    scratch.write_text(generated(MODELS, EFFECTS, range(len(EFFECTS))), encoding="ascii")
    scratch.replace(target)


main()
