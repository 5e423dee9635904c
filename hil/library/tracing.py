"""What a trace came to, as an object."""

from pathlib import Path
from typing import TYPE_CHECKING

from hil.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil.bench import Bench
    from hil.records.diagnosis import Diagnosis, Effect, Separation


class Trace:
    """The answer of a trace, and the folder where it is kept."""

    def __init__(self, folder: Path, diagnosis: "Diagnosis") -> None:
        self._folder = folder
        self.diagnosis = diagnosis

    @property
    def path(self) -> Path:
        """Folder with diagnosis.json, bench.toml and report.html."""
        return self._folder

    @property
    def verdict(self) -> str:
        """`adequate`, `explained`, `partly explained` or `unexplained`."""
        return str(self.diagnosis.verdict)

    @property
    def effects(self) -> "tuple[Effect, ...]":
        """What acts, or acts like it, in the order of what it explains; coefficients with their 95 % intervals."""
        return self.diagnosis.effects

    @property
    def ambiguity_groups(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the record cannot tell apart, the named one first."""
        return self.diagnosis.ambiguity_groups

    @property
    def separations(self) -> "tuple[Separation, ...]":
        """Of each group, the named effect with every other member, and the experiment that separates them."""
        return self.diagnosis.separations

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is what it is, a sentence each."""
        return self.diagnosis.reasons

    def add_to(self, bench: "Bench") -> "Bench":
        """`bench` with the effects found declared, for the next run.  Raises InputError where there is nothing to add:
        only what is explained is declared.
        """
        from hil.tracing.addition import additions

        found = additions(self.diagnosis)
        if not found:
            raise InputError(f"{self.verdict}: there is nothing to add; only what is explained is declared")
        effects = {one.name: {symbol: value for symbol, (value, _) in one.coefficients.items()} for one in found}
        return bench.with_(effects=effects)

    def report(self) -> Path:
        """The page of the trace.  Raises InputError where it was not drawn."""
        page = self._folder / "report.html"
        if not page.exists():
            raise InputError(f"{page}: not there; trace again with report=True")
        return page

    def plot(self) -> "Figure":
        """Innovation over its floor on the part that was held out, before and after, and what each candidate would
        have explained by itself.
        """
        from hil.library.trace_figure import trace_figure

        return trace_figure(self.diagnosis)

    def __repr__(self) -> str:
        named = ", ".join(effect.name for effect in self.effects)
        return f"<Trace of {self.diagnosis.record}: {self.verdict}{': ' + named if named else ''}>"
