"""The vibration ellipse in the plane as it turns, with energy and quadrature beside it."""

from typing import TYPE_CHECKING

import numpy as np

from hil.numbers import prefix_for, relative
from hil.records.estimates import Estimates
from hil.report.material import Floats, Material
from hil.report.pixel_series import DRAWABLE
from hil.report.theme import FIRST, INK, MUTED, SECOND, Drawing, fit_to, new_figure, span_time, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ELLIPSES = 13
_PLANE = ("x_m", "vx_mps", "y_m", "vy_mps")


def pattern_figure(material: Material) -> Drawing | None:
    """Ellipses at a few instants of the scored window; the later, the darker."""
    estimates, stiffness = material.estimates, material.stiffness_per_s2
    if estimates is None or stiffness is None or not all(name in estimates for name in _PLANE):
        return None
    chosen = _chosen(estimates, material.settle_s)
    if not chosen:
        return None
    figure = new_figure(3.3)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.25))
    plane, energy = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    quadrature = figure.add_subplot(grid[1, 1], sharex=energy)
    t = np.array([at for at, _ in chosen])
    paths = [ellipse(state, stiffness) for _, state in chosen]
    reach = max(float(np.abs(path).max()) for path in paths)
    factor, prefix = prefix_for(reach)
    _draw_plane(plane, [path * factor for path in paths], t, reach * factor, prefix)
    drawn = None
    if "energy_ratio" in estimates:
        drawn = material.drawn(lambda part: [part["energy_ratio"], part["quadrature_ratio"], part["energy_ratio"] - 1])
    for k, (ax, colour) in enumerate(((energy, FIRST), (quadrature, SECOND))):
        if drawn is not None:
            trace(ax, drawn, k, colour)
            fit_to(ax, drawn.held.low[[k]], drawn.held.high[[k]])
        ax.locator_params(axis="y", nbins=5)
    span_time([energy, quadrature], estimates.ends_s, material.settle_s)
    energy.set_title("energy over its set point")
    energy.tick_params(labelbottom=False)
    quadrature.set_title("quadrature over energy")
    quadrature.set_xlabel("time / s")
    caption = (
        f"Left, the ellipse at {t.size} instants from {t[0]:.3g} s to {t[-1]:.3g} s, "
        "from pale to full colour. Right, how well energy and quadrature were held."
    )
    if drawn is not None:
        caption += f" Energy error {relative(float(drawn.held.rms[2])).lstrip('+')} rms."
    return Drawing(figure, "Pattern in the plane", caption, f"Vibration ellipses in the plane. {caption}")


def _chosen(estimates: Estimates, since_s: float) -> list[tuple[float, Floats]]:
    """Time and state (4,) at a few instants, evenly spread over the scored window, where they can be drawn."""
    scored = estimates.since(since_s)
    rows = scored if len(scored) else estimates
    found = []
    for row in np.unique(np.linspace(0, len(rows) - 1, min(_ELLIPSES, len(rows))).astype(int)):
        here = rows.part(int(row), int(row) + 1)
        state = np.array([float(here[name][0]) for name in _PLANE])
        if np.all(np.abs(state) < DRAWABLE):
            found.append((float(here.t_s[0]), state))
    return found


def ellipse(state: Floats, stiffness_per_s2: float, points: int = 121) -> Floats:
    """The path (2, points) an isotropic oscillator would take from `state` = x, ẋ, y, ẏ."""
    x, vx, y, vy = state
    phase, omega = np.linspace(0, 2 * np.pi, points), np.sqrt(stiffness_per_s2)
    cosine, sine = np.cos(phase), np.sin(phase)
    return np.stack([x * cosine + vx / omega * sine, y * cosine + vy / omega * sine])


def _draw_plane(ax: "Axes", paths: list[Floats], t_s: Floats, reach: float, prefix: str) -> None:
    ages = np.linspace(0.18, 1.0, len(paths)) if len(paths) > 1 else [1.0]
    for path, age in zip(paths, ages, strict=True):
        ax.plot(path[0], path[1], color=FIRST, alpha=float(age), linewidth=1.0)
    for path, t, colour in ((paths[0], t_s[0], MUTED), (paths[-1], t_s[-1], INK)):
        tip = path[:, np.argmax(np.hypot(*path))]
        x, y = 1.1 * (tip if tip[1] >= 0 else -tip)
        ax.annotate(f"{t:.3g} s", (x, y), color=colour, ha="center", va="center", fontsize=8)
    ax.set_aspect("equal")
    half = 1.25 * reach or 1.0  # of a mass that rests there is a point
    ax.set_xlim(-half, half)
    ax.set_ylim(-half, half)
    ax.locator_params(nbins=5)
    ax.set_xlabel(f"x / {prefix}m")
    ax.set_ylabel(f"y / {prefix}m")
