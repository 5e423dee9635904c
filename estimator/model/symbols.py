"""Symbols of the models, as declarations name them."""

from estimator.model.formula import symbols

x, vx, y, vy = symbols("x vx y vy")
phi_x, phi_y = symbols("phi_x phi_y")
rate, kxx, kyy, kxy, dxx, dyy, dxy = symbols("rate kxx kyy kxy dxx dyy dxy")
ux, uy = symbols("ux uy")
k, d, b = symbols("k d b")  # of a single axis
