"""Changes that were once made by hand and that no test noticed: each must be noticed by cheap tests."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from benchmarks.mutants.changes import Mutant


@dataclass(frozen=True)
class Named:
    """What is wrong then; the module, the text that stands there once, what stands there instead, and the tests."""

    says: str
    module: str
    before: str
    after: str
    tests: tuple[str, ...]

    def mutant(self) -> Mutant:
        """The change. Raises SystemExit where the text does not stand there exactly once."""
        spec = importlib.util.find_spec(self.module)
        assert spec is not None
        assert spec.origin is not None
        source = Path(spec.origin).read_text(encoding="utf-8")
        if source.count(self.before) != 1:
            raise SystemExit(f"{self.module}: {self.before!r} stands there {source.count(self.before)} times, not once")
        line = source[: source.index(self.before)].count("\n") + 1
        return Mutant(line, self.before, self.after, lambda: source.replace(self.before, self.after))


_ANGLE = ("tests/trace/test_angle.py",)
_LAWS = ("tests/estimator/test_laws.py",)

NAMED = (
    Named(
        "an interval of 90 % is said to be one of 95 %",
        "estimator.chance", "1.959963984540054", "1.6448536269514722", _ANGLE,
    ),
    Named(
        "what is scored as held out includes the fitted part",
        "estimator.trace.examination", "slice(split, len(record) // every * every)",
        "slice(settled, len(record) // every * every)", _ANGLE,
    ),
    Named(
        "the angle's bound is that of one principal axis",
        "estimator.trace.angle", "np.sqrt(sum(float(np.max(np.abs(angle - usual))) ** 2 for angle in moved))",
        "np.sqrt(max(float(np.max(np.abs(angle - usual))) ** 2 for angle in moved))", _ANGLE,
    ),
    Named(
        "the judge of the angle takes W² with the other sign",
        "hil.scoring.score", "stiffness_per_s2 + spin_rad_s**2", "stiffness_per_s2 - spin_rad_s**2",
        ("tests/records/test_score.py",),
    ),
    Named(
        "drag drives",
        "estimator.effects.damping", "force=(-dqx * vx**2", "force=(dqx * vx**2", _LAWS,
    ),
    Named(
        "cubic damping has the unit of another law",
        "estimator.effects.damping", 'Coefficient(dcx, "dcx", 0.01, -2, 1)', 'Coefficient(dcx, "dcx", 0.01, -2, -1)',
        _LAWS,
    ),
)  # fmt: skip
