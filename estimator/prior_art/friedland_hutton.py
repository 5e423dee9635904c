"""(e) The orbital elements of the vibration: Friedland & Hutton, "Theory and error analysis of vibrating-member
gyroscope", IEEE Trans. Automatic Control 23(4), 545–556, 1978.

The vibrating member goes through an ellipse.  Its elements (half axes a and b, inclination θ, phase) are constants of
the ideal motion but for θ̇ = −Ω, and the paper gives how perturbations move them.  They are what demodulation at the
vibration's frequency leaves.  With the phasors X and Y of both axes, against any reference phase,

    tan 2θ = 2 Re(X Y*) / (|X|² − |Y|²),    quadrature a b = Im(X* Y),    a² + b² = |X|² + |Y|².

The low-pass of the demodulator is a Hann window of four periods of the target oscillator: it has its zeros where an
offset and the image at twice the frequency stand, so that neither gets into the elements.  An element belongs to the
middle of its window, and is carried on to its end by its slope.  What anisotropy of stiffness or damping and the forces
of a control do to θ is the paper's error analysis; its method has no means to know them, and only the virtual rotation
is taken off.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from estimator.errors import ModelError
from estimator.prior_art.reading import Reading, carried_on, displacement, rotation, samples_per_cycle
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device

CYCLES = 4


def read(sense: Array, device: Device, control: ControllerSettings | None = None) -> Reading:
    """Angle over a record: sense (n, 2) in volts.  A lost sample (NaN) takes the windows that hold it with it.  Raises
    ModelError for less than one window.
    """
    position = displacement(sense, device)
    index, phasor_x, phasor_y = elements(position, device)
    double = np.arctan2(2.0 * np.real(phasor_x * np.conj(phasor_y)), np.abs(phasor_x) ** 2 - np.abs(phasor_y) ** 2)
    half = round(0.5 * CYCLES * samples_per_cycle(device))
    return carried_on(index, rotation(double, index, device, control), half, half)


def elements(
    position: Array, device: Device
) -> tuple[NDArray[np.int64], NDArray[np.complex128], NDArray[np.complex128]]:
    """Samples at the middle of their windows (rows,), and the phasors of x and y there (rows,), complex [m]."""
    length = 2 * round(0.5 * CYCLES * samples_per_cycle(device)) + 1
    if len(position) < 3 * length // 2:
        raise ModelError(f"{len(position)} samples are less than {1.5 * CYCLES:g} cycles; give a longer record")
    window = np.hanning(length + 2)[1:-1]
    window *= 2.0 / window.sum()
    lost = np.isnan(position).any(axis=1)
    filled = np.nan_to_num(position)
    carrier = np.exp(-1j * math.sqrt(device.target) / device.sample_rate * np.arange(len(position)))
    phasors = [fftconvolve(channel * carrier, window, "valid") for channel in filled.T]
    holding: Array = fftconvolve(np.asarray(lost, dtype=float), np.ones(length), "valid")
    index = np.arange(len(phasors[0])) + length // 2
    whole = np.flatnonzero(np.less(holding, 0.5))
    return index[whole], phasors[0][whole], phasors[1][whole]
