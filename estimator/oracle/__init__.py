"""The same declared model without the compiled kernels: plain NumPy, and filterpy's extended Kalman filter.

The oracles are slow and textbook-like on purpose.  They share with the kernels the declaration, the scaling and the
table of a stationary gain, and nothing of the arithmetic: the flow is a matrix exponential, the covariance dense, the
pattern a complex number.
"""
