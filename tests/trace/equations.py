"""The equations of a plane gyro with linear effects, and in the words of another cause (estimator/trace/symmetries)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.trace.symmetries import Constants, Equivalent, Intervals

Array = NDArray[np.float64]

CORIOLIS = np.array([[0.0, 1.0], [-1.0, 0.0]])


@dataclass(frozen=True)
class System:
    """The equations above: stiffness, damping, drive and coriolis (2, 2) per unit mass, sense (2, 2); by how many
    seconds sense, drive and rate are late.  The rate is that of the record: what it is multiplied by stands in C.
    """

    stiffness: Array
    damping: Array
    drive: Array
    sense: Array
    coriolis: Array
    late: tuple[float, float, float] = (0.0, 0.0, 0.0)


def displaced(system: System, by: Array) -> System:
    """The same voltages in coordinates x' with x = `by` x' (2, 2)."""
    back = np.linalg.inv(by)
    return replace(
        system,
        stiffness=back @ system.stiffness @ by,
        damping=back @ system.damping @ by,
        coriolis=back @ system.coriolis @ by,
        drive=back @ system.drive,
        sense=system.sense @ by,
    )


def retimed(system: System, unit: float) -> System:
    """The same voltages by a clock whose second has `unit` seconds of the one before."""
    return replace(
        system,
        stiffness=unit**2 * system.stiffness,
        drive=unit**2 * system.drive,
        damping=unit * system.damping,
        coriolis=unit * system.coriolis,
        late=(system.late[0] / unit, system.late[1] / unit, system.late[2] / unit),
    )


def reversed_in_time(system: System) -> System:
    """The same voltages in reverse order."""
    return replace(system, damping=-system.damping, coriolis=-system.coriolis)


def shifted(system: System, by: float) -> System:
    """The same voltages with every path later by so many seconds but the voltages themselves, which are less late."""
    sense, drive, rate = system.late
    return replace(system, late=(sense - by, drive + by, rate + by))


def system_with(named: Intervals, constants: Constants) -> System:
    """The system as it was found: the base model with those of the named effects that are linear."""

    def of(effect: str, symbol: str) -> float:
        return named[effect][symbol].value if effect in named else 0.0

    kxx, kyy, kxy = constants.stiffness
    dxx, dyy, dxy = constants.damping
    kn = of("nonreciprocal_stiffness", "kn")
    drive = [
        [1.0 + of("drive_gain", "hx"), of("drive_misalignment", "mx")],
        [of("drive_misalignment", "my"), 1.0 + of("drive_gain", "hy")],
    ]
    sense = [
        [1.0, of("sense_cross_coupling", "ex")],
        [of("sense_cross_coupling", "ey"), 1.0 + of("sense_gain", "gy")],
    ]
    late = (mean(named["sense_delay"]) if "sense_delay" in named else 0.0, 0.0, 0.0)
    if "drive_delay" in named:
        late = (late[0], mean(named["drive_delay"]), 0.0)
    return System(
        np.array([[kxx, kxy + kn], [kxy - kn, kyy]]),
        np.array([[dxx, dxy], [dxy, dyy]]),
        np.array(drive),
        np.array(sense),
        CORIOLIS,
        late,
    )


def mean(given):
    return float(np.mean([interval.value for interval in given.values()]))


def system_of(one: Equivalent, named: Intervals, constants: Constants) -> System:
    """The equations with the other cause, of the size that it then has."""
    system, size = system_with(named, constants), one.size
    gains = [named["drive_gain"][symbol].value for symbol in ("hx", "hy")] if "drive_gain" in named else []
    axis = int(np.argmax(np.abs(gains))) if gains else 1
    match one.effect, one.other:
        case _, "time_reversal":
            return reversed_in_time(system)
        case "drive_gain", "clock_rate":
            return retimed(system, 1.0 / (1.0 + size))
        case "drive_gain", "sense_scale":
            return displaced(system, (1.0 + size) * np.eye(2))
        case effect, ("drive_polarity" | "sense_polarity") as other if effect[:5] != other[:5]:
            symbols = ("hx", "hy") if effect == "drive_gain" else ("", "gy")
            flipped = [named[effect].get(symbol) for symbol in symbols]
            return displaced(system, np.diag([-1.0 if each and each.high < -1.0 else 1.0 for each in flipped]))
        case "drive_misalignment" | "sense_cross_coupling" as effect, _:
            turn = (np.eye(2) + size * CORIOLIS) / np.sqrt(1.0 + size**2)
            return displaced(system, turn if effect == "drive_misalignment" else turn.T)
        case "sense_gain", "unequal_masses":
            return displaced(system, np.diag([1.0, np.sqrt(1.0 + size)]))
        case "drive_gain", "unequal_masses":
            scale = np.ones(2)
            scale[axis] = 1.0 / (1.0 + size)
            return replace(system, coriolis=np.diag(scale) @ system.coriolis)
        case "drive_gain", "sense_gain":
            scale = np.ones(2)
            scale[axis] = 1.0 + size
            return displaced(system, np.diag(scale))
        case "sense_delay" | "drive_delay" as effect, _:
            return shifted(system, size if effect == "sense_delay" else -size)
    return system
