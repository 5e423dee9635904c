"""Diagnoses that no trace came to, for tests of what follows one."""

from pathlib import Path
from typing import Any

from hil.records.diagnosis import Diagnosis, Fit, HeldOut, save_diagnosis

_FIT = Fit(innovation_rms=1e-4, noise_floor=1e-4, ratio=1.0, whiteness_p=0.5, simulation_rmse=None)


def explained(**said: Any) -> Diagnosis:
    """ "explained", by nothing and with nothing beside it but what is `said`."""
    least: dict[str, Any] = {"record": "r", "bench": "b", "samples": 100, "split": 60}
    least |= dict.fromkeys(("effects", "separations", "rejected", "findings", "reasons", "equations"), ())
    least |= {"before": _FIT, "after": _FIT, "held_out": HeldOut(before=_FIT, after=_FIT)}
    return Diagnosis(verdict="explained", **(least | said))


def save_trace(folder: Path, diagnosis: Diagnosis) -> None:
    """A trace folder with nothing but its answer."""
    folder.mkdir(parents=True)
    save_diagnosis(folder / "diagnosis.json", diagnosis)
