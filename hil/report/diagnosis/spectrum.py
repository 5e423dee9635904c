"""Spectrum of the residual before and after, over the noise floor."""

import numpy as np

from hil.numbers import prefix_for, quantity, significant
from hil.report.diagnosis.material import Material
from hil.report.figures.drawing import Drawing
from hil.report.figures.spectrum import mark_multiples
from hil.report.theme import FIRST, INK, SECOND, legend, plain_log_ticks, stacked


def held_out_spectrum_figure(material: Material) -> Drawing | None:
    """Amplitude density of the held-out part, a panel per axis, multiples of the resonance marked."""
    frequency, before, after = material.held_out_densities
    if len(frequency) < 8 or not (np.isfinite(before).all() and np.isfinite(after).all() and before.any()):
        return None
    rate, resonance = material.sample_rate_Hz, material.resonance_Hz
    axes = before.shape[1]
    floors = np.array(material.found.held_out_after.noise_floor) * np.sqrt(2.0 / rate)
    own = material.device.sense_unit
    factor, prefix = prefix_for(float(np.median(floors))) if own == "V" else (1.0, "")
    curves = [(before, FIRST, "residual")]
    if material.changed:
        curves = [(before, SECOND, "before"), (after, FIRST, "after")]
    figure, panels = stacked(0.7 + 1.75 * axes, (1.0,) * axes)
    for axis, ax in enumerate(panels):
        low, high = [], []
        for power, colour, name in curves:
            curve = np.sqrt(power[:, axis]) * factor
            ax.semilogy(frequency, curve, color=colour, linewidth=0.9, label=name)
            low.append(curve.min())
            high.append(curve.max())
        ax.axhline(floors[axis] * factor, color=INK, linewidth=0.9, dashes=(4, 3), label="noise floor")
        ax.set_ylim(min(*low, floors[axis] * factor) / 1.4, max(*high, floors[axis] * factor) * 3.0)
        plain_log_ticks(ax.yaxis)
        ax.set_ylabel(f"ν{'xy'[axis]} / ({prefix}{own}/√Hz)")
        mark_multiples(ax, resonance, 0.98 * rate / 2, most=9)
        ax.set_xlim(0, rate / 2)
    legend(panels[0])
    panels[-1].set_xlabel("frequency / Hz")
    caption = (
        "Amplitude density of the innovation on the part of the record that is held out (Welch). "
        f"Dotted: multiples of the resonance f₀ = {quantity(resonance, 'Hz', 4)}."
    )
    was, now = (significant(fit.ratio) for fit in material.fits[2:])
    told = f" before, {now} after" if material.changed else ""
    alt = f"The residual is {was} times the floor{told}."
    return Drawing(figure, "Spectrum of the residual", caption, f"{alt} {caption}")
