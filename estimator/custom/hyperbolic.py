"""The hyperbolic tangent of a law."""

from typing import Any

import sympy as sp


class tanh(sp.tanh):  # type: ignore[misc]  # noqa: N801  # printers of code know it by its name
    """Hyperbolic tangent of what is real, without being asked.

    SymPy divides by it, raises it to a power or puts a number in its place only when it knows whether it is real and
    finite, and splits its argument into real and imaginary parts to find out: of fractions within fractions, for
    minutes.  All that a law is made of is real.
    """

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """1 − tanh², by the same function."""
        if argindex != 1:
            raise sp.ArgumentIndexError(self, argindex)
        return 1 - self**2

    def as_real_imag(self, deep: bool = True, **hints: Any) -> tuple[sp.Expr, sp.Expr]:
        """Itself and nothing."""
        return self, sp.Integer(0)

    def _eval_conjugate(self) -> sp.Expr:
        return self

    def _eval_is_real(self) -> bool:
        return True

    _eval_is_extended_real = _eval_is_real
    _eval_is_finite = _eval_is_real
