"""From a bench file to a folder of C for a board."""

import hashlib
import math
import os
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import NDArray

from estimator.core.compiler import CompilerError, compile_library
from estimator.declared_loop import DeclaredLoop
from estimator.observer import Observer
from hil.bench import Bench
from hil.bench.classic import CLASSIC
from hil.errors import InputError
from hil.generating.estimator_files import INTERFACE, decimal, files_of, filled
from hil.inputs.declared import board_device_of, controller_settings_of, drive_limit_of, observer_settings_of
from hil.plugins.finding import Kind, called
from hil.plugins.native import HEADER
from hil.records.atomic import write_text
from hil.wire.messages import Identity

_TARGET = ("-mcpu=cortex-m7", "-mthumb", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
_COMPILER = "arm-none-eabi-gcc"


@dataclass(frozen=True)
class Sizes:
    """Bytes on a Cortex-M7 with an FPU for doubles at -O2, without the mathematical library: code with its constants;
    the struct; the stack of a step, None with a GCC before 10.
    """

    flash_bytes: int
    struct_bytes: int
    stack_bytes: int | None


def sizes(folder: Path) -> Sizes | None:
    """Of gyro_estimator.c in a folder; None where the machine has no compiler for a Cortex-M7."""
    if shutil.which(_COMPILER) is None:
        return None
    with tempfile.TemporaryDirectory() as place:
        probe = Path(place) / "probe.c"
        probe.write_text('#include "gyro_estimator.h"\nchar probe[sizeof(gyro_estimator)];\n', encoding="ascii")
        told = {}
        for name, source in (("code", folder / "gyro_estimator.c"), ("struct", probe)):
            out = Path(place) / f"{name}.o"
            command = [_COMPILER, *_TARGET, "-std=c99", "-O2", "-ffp-contract=off", f"-I{folder}", "-c"]
            command += ["-o", str(out), str(source)]
            subprocess.run(command, check=True, capture_output=True)
            subprocess.run([*command, "-fcallgraph-info=su"], check=False, capture_output=True)
            line = subprocess.run(["arm-none-eabi-size", str(out)], check=True, capture_output=True, text=True).stdout
            told[name] = [int(number) for number in line.splitlines()[1].split()[:3]]
        graph = Path(place) / "code.ci"
        calls = graph.read_text("utf-8") if graph.exists() else ""
    stack = max(_stack(calls, name) for name in ("estimator_step", "estimator_step_codes")) or None
    return Sizes(sum(told["code"][:2]), told["struct"][2], stack)


def _stack(calls: str, function: str) -> int:
    """Bytes of a function's deepest path in what -fcallgraph-info=su says; 0 for one of a library."""
    own = {name: int(size) for name, size in re.findall(r'title: "([^"]+)" label: "[^"]*?(\d+) bytes', calls)}
    called = re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', calls)
    return own.get(function, 0) + max((_stack(calls, to) for by, to in called if by == function), default=0)


@dataclass(frozen=True)
class Golden:
    """What was sensed and applied (n + 1, 2), what the bench's observer answered (n + 1, 2), in codes; its angle (n,)
    in rad; its state and deviations after sample n, SI, deviations of what is declared below 0; and samples without
    drive at the start.  Some samples are missing, on both axes and on one.  The last row is a sample far outside the
    range, which the drive answers at its limit, of either sign.
    """

    sense: NDArray[np.int32]
    applied: NDArray[np.int32]
    drive: NDArray[np.int32]
    angle: NDArray[np.float64]
    state: NDArray[np.float64]
    deviation: NDArray[np.float64]
    quiet: int


def golden(observer: Observer, samples: int, quiet: int) -> Golden:
    """Close the loop about the device as declared, turning at 1 rad/s, for so many samples: the first without drive.

    The device has none of the effects: its signal is what the vectors are made from, not what they test.
    """
    loop = DeclaredLoop(observer)
    sense, applied, drive = (np.zeros((samples + 1, 2), np.int32) for _ in range(3))
    angle = np.zeros(samples)
    for m in range(samples):
        sense[m], applied[m] = loop.sample()
        sense[m, : 2 if m in _GONE else 1 if m in _GONE_X else 0] = MISSING
        observer.enable_control(m >= quiet)
        drive[m] = observer.tick(*_sensed(sense[m]), *map(float, applied[m]))
        loop.answer((int(drive[m, 0]), int(drive[m, 1])))
        angle[m] = observer.newest["angle"]
    state, deviation = observer.reading()
    told = np.full(len(state), -1.0)
    told[observer.estimated_index] = np.array(deviation)[observer.estimated_index]
    sense[-1], applied[-1] = _FAR, loop.sample()[1]
    drive[-1] = observer.tick(*map(float, sense[-1]), *map(float, applied[-1]))
    return Golden(sense, applied, drive, angle, np.array(state), told, quiet)


def _sensed(codes: NDArray[np.int32]) -> list[float]:
    return [math.nan if code == MISSING else float(code) for code in codes]


def rounding(observer: Observer, vectors: Golden, swing_mps2: float) -> int:
    """By how many codes in all the drive may differ in 32 bits: what rounding state and covariances to them after each
    sample makes of the answers in double, and the roundings of the control law itself, independent ones of terms as
    large as what pulls the swing back, swing_mps2.
    """
    arrays, apart = observer.arrays, 0
    for m, (sensed, applied, drive) in enumerate(zip(vectors.sense[:-1], vectors.applied, vectors.drive, strict=False)):
        observer.enable_control(m >= vectors.quiet)
        apart += int(np.abs(observer.tick(*_sensed(sensed), *map(float, applied)) - drive).sum())
        for array in (arrays.x, arrays.p, arrays.c):
            array[:] = array.astype(np.float32)
    each = math.sqrt(_LAW_ROUNDINGS) * 2.0**-24 * swing_mps2 / observer.drive_quantum
    return apart + math.ceil(each * 2 * (len(vectors.angle) - vectors.quiet))


_SAMPLES = 2000
_QUIET = 200
_SETTLED = 600
_FAR = (1 << 20, 1 << 20)
_GONE, _GONE_X = range(420, 430), range(440, 450)
MISSING = -(2**31)
"""GYRO_MISSING: a code that the board does not have."""
_LAW_ROUNDINGS = 18
"""Nine terms of the control law on an axis, each a product and a sum."""
_TOLERANCES = {False: (0, 1e-9, 1e-6), True: (_SETTLED, 1e-4, 1.0)}
"""By float32: the sample from which the angle counts, and tolerances of the angle in rad and of each state in its
deviations, from what the bench computed in double.

In 32 bits a drive code differs by one now and then from the recorded one that was applied. At the first one that
drives, the virtual rotation in it is then noticed some samples late, which turns the angle by a milliradian, once.
"""


@dataclass(frozen=True)
class Generated:
    """What was written: the folder, its files, the bytes that the code takes where a compiler for the target is."""

    folder: Path
    files: tuple[str, ...]
    sizes: Sizes | None


def generate(
    bench: Bench, place: str, identity: Identity, folder: Path, *, float32: bool = False, fmu: bool = False
) -> Generated:
    """Write the estimator of a bench file, for a board with these codes, into `folder`; place: how messages call the
    bench file; fmu: pack it as a co-simulation unit, too.

    Raises InputError for a device that is no two-axis gyro, and naming an effect that cannot be written.
    """
    if bench.device.axes != 2:
        raise InputError(
            f"{place}: [device] axes = {bench.device.axes}: only the estimator of a gyro, axes = 2, is written"
        )
    if bench.controller.mode in CLASSIC:
        raise InputError(
            f'{place}: [controller] mode = "{bench.controller.mode}": the source\'s estimator is written, mode = '
            '"whole_angle"; the loops of this one are C99 behind gyro_plugin.h, hil/plugins/shipped/classic'
        )

    plugins: dict[Kind, str | None] = {"observer": bench.observer.plugin, "controller": bench.controller.plugin}
    for kind, name in plugins.items():
        if name is not None:
            raise InputError(
                f"{place}: {called(kind, name)}: cannot be generated, only the bench's own estimator; take plugin "
                "out, or compile the plug-in for the board yourself"
            )

    def made() -> Observer:
        return Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))

    title = f"Estimator of {bench.device.name}: {len(made().estimated)} states and constants are estimated."
    facts = {
        "TITLE": title,
        "PRODUCT": version("gyrohil"),
        "BENCH": place,
        "SAMPLE_RATE": decimal(bench.device.sample_rate_Hz),
        "LATENCY": str(identity.latency_ticks),
        "ACQUISITION": str(math.ceil(bench.observer.acquisition_s * bench.device.sample_rate_Hz)),
        "SENSE_SCALE": decimal(identity.sense_scale_V),
        "DRIVE_SCALE": decimal(identity.drive_scale_mps2),
        "DRIVE_LIMIT": decimal(drive_limit_of(bench, identity) * identity.drive_scale_mps2),
        "ENERGY": decimal(bench.limits.energy_error),
        "QUADRATURE": decimal(bench.limits.quadrature),
    }
    texts = files_of(made(), facts, place, float32=float32)
    vectors = golden(made(), _SAMPLES, _QUIET)
    swing_mps2 = bench.target_stiffness_per_s2 * bench.device.amplitude_m
    codes = rounding(made(), vectors, swing_mps2) if float32 else 0
    texts["golden.h"] = _golden_text(vectors, codes, *_TOLERANCES[float32])
    for name in ("test_golden.c", "Makefile", "gyro_plugin.c"):
        texts[name] = filled(name, {})
    texts[HEADER.name] = HEADER.read_text("ascii")
    made_here = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        for name, text in texts.items():
            write_text(folder / name, text)
    except OSError:
        if made_here:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    taken = sizes(folder)
    told = (
        ""
        if taken is None
        else (
            f"\nOn a Cortex-M7 ({' '.join(_TARGET[2:])}) at -O2, in bytes: {taken.flash_bytes} of code and constants,\n"
            f"{taken.struct_bytes} of memory (the struct), {taken.stack_bytes or 'unknown'} of stack for a step.\n"
            "The mathematical library comes on top; so do software doubles where the FPU computes floats only.\n"
        )
    )
    write_text(folder / "README.txt", filled("README.txt", {**facts, "SAMPLES": str(_SAMPLES), "SIZES": told}))
    packed = (write_fmu(folder, made(), title, facts["PRODUCT"]),) if fmu else ()
    return Generated(folder, (*texts, "README.txt", *packed), taken)


def _golden_text(vectors: Golden, codes: int, settled: int, angle_rad: float, state: float) -> str:
    """golden.h."""
    n = len(vectors.angle)
    heads = {
        "GOLDEN_VERSION": f"{INTERFACE}u", "GOLDEN_SAMPLES": n, "GOLDEN_QUIET": vectors.quiet, "GOLDEN_CODES": codes,
        "GOLDEN_SETTLED": settled, "GOLDEN_ANGLE_RAD": decimal(angle_rad), "GOLDEN_STATE": decimal(state),
    }  # fmt: skip
    lines = [f"#define {name} {value}" for name, value in heads.items()]
    for name in ("sense", "applied", "drive"):
        lines.append(f"static const int32_t golden_{name}[{n + 1}][2] = {{")
        lines += ["    " + ", ".join(f"{{{x}, {y}}}" for x, y in part) + "," for part in _parts(getattr(vectors, name))]
        lines.append("};")
    for name in ("angle", "state", "deviation"):
        values = getattr(vectors, name)
        lines.append(f"static const double golden_{name}[{len(values)}] = {{")
        lines += ["    " + ", ".join(repr(float(value)) for value in part) + "," for part in _parts(values)]
        lines.append("};")
    head = "/* Codes sensed, applied and answered; angle in rad; state after the last sample, SI. */"
    return "\n".join([head, "#include <stdint.h>", "", *lines, ""])


def _parts(values: NDArray[np.generic]) -> list[NDArray[np.generic]]:
    return [values[at : at + 5] for at in range(0, len(values), 5)]


MODEL = "gyro_estimator"
_SOURCES = ("gyro_estimator.c", "gyro_estimator.h", "fmi3.c")
_UNITS = {
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1}, "m": {"m": 1}, "m/s": {"m": 1, "s": -1}, "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1}, "1/s2": {"s": -2}, "1/s": {"s": -1}, "s": {"s": 1},
}  # fmt: skip
"""FMI's base units of each unit that a variable has; the coefficients of effects are told without."""

_MODEL_UNITS = ("m", "m/s", "m", "m/s", "V", "V", "rad/s", *3 * ("1/s2",), *3 * ("1/s",))


def write_fmu(folder: Path, observer: Observer, title: str, version: str) -> str:
    """Pack what stands in `folder` into gyro_estimator.fmu beside it; its name.

    Raises InputError where there is no compiler, naming the cures.
    """
    texts = {name: (folder / name).read_bytes() for name in _SOURCES if name != "fmi3.c"}
    rate = decimal(observer.device.sample_rate)
    token = hashlib.sha256(b"".join(texts.values())).hexdigest()[:32]
    texts["fmi3.c"] = filled("fmi3.c", {"TOKEN": token, "SAMPLE_RATE": rate}).encode("ascii")
    archive = folder / f"{MODEL}.fmu"
    with tempfile.TemporaryDirectory() as place:
        sources = Path(place)
        for name, text in texts.items():
            (sources / name).write_bytes(text)
        library = sources / f"{MODEL}.so"
        try:
            compile_library([sources / "fmi3.c", sources / "gyro_estimator.c"], library, [f"-I{sources}"])
        except CompilerError as error:
            raise InputError(f"--fmu: {error}") from None
        scratch = archive.with_suffix(f".{os.getpid()}")
        with zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED) as packed:
            packed.writestr("modelDescription.xml", _description(observer, title, version, token))
            packed.writestr("sources/buildDescription.xml", _build())
            for name, text in texts.items():
                packed.writestr(f"sources/{name}", text)
            packed.write(library, f"binaries/{platform.machine()}-linux/{MODEL}.so")
    scratch.replace(archive)
    return archive.name


def _description(observer: Observer, title: str, version: str, token: str) -> bytes:
    """modelDescription.xml; references as the enumeration in fmi3.c has them."""
    step = repr(1.0 / observer.device.sample_rate)
    root = Xml.Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=MODEL, instantiationToken=token, description=title,
        generationTool=f"gyrohil {version}", variableNamingConvention="flat",
    )  # fmt: skip
    Xml.SubElement(
        root, "CoSimulation", modelIdentifier=MODEL, canHandleVariableCommunicationStepSize="false",
        fixedInternalStepSize=step, canGetAndSetFMUState="true", hasEventMode="false",
    )  # fmt: skip
    units = Xml.SubElement(root, "UnitDefinitions")
    for name, base in _UNITS.items():
        Xml.SubElement(Xml.SubElement(units, "Unit", name=name), "BaseUnit", {key: str(n) for key, n in base.items()})
    Xml.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    variables = Xml.SubElement(root, "ModelVariables")
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = []

    def add(kind: str, name: str, causality: str, unit: str = "", text: str = "") -> None:
        reference = str(len(variables))
        told = {"name": name, "valueReference": reference, "causality": causality}
        told["variability"] = "continuous" if causality == "independent" else "discrete"
        if causality == "input":
            told["start"] = "false" if kind == "Boolean" else "0.0"
        if unit in _UNITS:
            told["unit"] = unit
        Xml.SubElement(variables, kind, told, description=text or name)
        if causality == "output":
            outputs.append(reference)

    add("Float64", "time", "independent", "s")
    for axis in "xy":
        add("Float64", f"sense_{axis}", "input", "V", "sampled at the beginning of the step")
    for axis in "xy":
        add("Float64", f"applied_{axis}", "input", "m/s2", "drive held until the beginning of the step, force per mass")
    add("Boolean", "drive_on", "input", text="whether the drive put out will be applied")
    for axis in "xy":
        add("Float64", f"drive_{axis}", "output", "m/s2", f"to hold {observer.latency} samples after the one sensed")
    add("Float64", "angle", "output", "rad", "rotation since the start")
    add("Float64", "sd_angle", "output", "rad", "its standard deviation by estimation")
    add("Boolean", "valid", "output", text="energy and quadrature are within the limits of the bench file")
    named = [(name, unit) for name, unit in zip(observer.names, _MODEL_UNITS, strict=False)]
    named += [(name, "") for name in observer.names[len(_MODEL_UNITS) :]]
    for prefix, said in (("", "estimated"), ("sd_", "standard deviation; below 0: declared, not estimated")):
        for name, unit in named:
            add("Float64", f"{prefix}{name}", "output", unit, said)
    for kind in ("Output", "InitialUnknown"):
        for reference in outputs:
            Xml.SubElement(structure, kind, valueReference=reference)
    return _text(root)


def _build() -> bytes:
    """sources/buildDescription.xml."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    build = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=MODEL)
    group = Xml.SubElement(build, "SourceFileSet", language="C99", compilerOptions="-ffp-contract=off")
    for name in _SOURCES:
        if name.endswith(".c"):
            Xml.SubElement(group, "SourceFile", name=name)
    Xml.SubElement(build, "Library", name="m")
    return _text(root)


def _text(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))
