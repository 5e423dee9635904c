"""Coupling of the two axes by the elastic potential c x³ y."""

from estimator.custom import Coefficient, Declaration

CUBIC_COUPLING = Declaration(
    name="cubic_coupling",
    title="Coupling of the axes by a potential c x³ y",
    force=("-3 * c31 * x**2 * y", "-c31 * x**3"),
    coefficients={"c31": Coefficient("1/(m²·s²)")},
    source="fourth order of the elastic energy; Landau & Lifshitz, Theory of Elasticity, § 26",
    signature="quadrature that grows with the cube of the amplitude, largest along x",
)
