"""Effects of one's own: laws as text, from a bench file or another package, with the units of their coefficients."""

from estimator.custom.declaration import Coefficient, Declaration, Parameter

__all__ = ["Coefficient", "Declaration", "Parameter"]
