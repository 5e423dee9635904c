"""What was generated as a co-simulation unit of FMI 3.0: sources, their binary for this machine, a description."""

import hashlib
import os
import platform
import tempfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree as Xml

from estimator.core.compiler import CompilerError, compile_library
from estimator.observer import Observer
from hil.errors import InputError
from hil.generating.estimator_files import decimal, filled

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
