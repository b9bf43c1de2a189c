"""modelDescription.xml of an FMU: FMI 2.0.4 or 3.0, co-simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib.metadata import version
from typing import Literal
from xml.etree import ElementTree as xml

from hexsim.export.variables import Variables

# Unit at the end of a name -> its name in FMI and its powers of base units. The longest that fits.
UNITS: dict[str, tuple[str, dict[str, int]]] = {
    "V": ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "m": ("m", {"m": 1}),
    "m_s": ("m/s", {"m": 1, "s": -1}),
    "m_s2": ("m/s2", {"m": 1, "s": -2}),
    "rad": ("rad", {"rad": 1}),
    "rad_s2": ("rad/s2", {"rad": 1, "s": -2}),
    "m3": ("m3", {"m": 3}),
    "m3_s": ("m3/s", {"m": 3, "s": -1}),
    "m3_s_Pa": ("m3/(s.Pa)", {"m": 4, "s": 1, "kg": -1}),
    "Pa": ("Pa", {"kg": 1, "m": -1, "s": -2}),
    "kg": ("kg", {"kg": 1}),
    "kg_m3": ("kg/m3", {"kg": 1, "m": -3}),
    "N": ("N", {"kg": 1, "m": 1, "s": -2}),
    "N_m": ("N/m", {"kg": 1, "s": -2}),
    "N_s_m": ("N.s/m", {"kg": 1, "s": -1}),
    "s_m": ("s/m", {"s": 1, "m": -1}),
    "Hz": ("Hz", {"s": -1}),
    "s": ("s", {"s": 1}),
}


def unit_of(name: str) -> str | None:
    """Key of UNITS; None for a ratio, and for m3/(s sqrt(Pa)), which FMI cannot say."""
    fitting = [key for key in UNITS if name.endswith(f"_{key}")]
    return max(fitting, key=len, default=None)


def model_description(
    variables: Variables,
    *,
    name: str,
    identifier: str,
    guid: str,
    step_s: float,
    fmi: Literal[2, 3],
    description: str,
) -> bytes:
    """The XML. identifier: name of the binaries; guid: what the binary answers to; step_s: communication step to begin with."""
    root = xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": name,
            "guid" if fmi == 2 else "instantiationToken": guid,
            "generationTool": f"hexsim {version('hexsim')}",
            "description": description,
            "variableNamingConvention": "structured",
        },
    )
    state = "FMUstate" if fmi == 2 else "FMUState"
    able = ("canHandleVariableCommunicationStepSize", f"canGetAndSet{state}", f"canSerialize{state}")
    xml.SubElement(root, "CoSimulation", {"modelIdentifier": identifier, **dict.fromkeys(able, "true")})
    units = xml.SubElement(root, "UnitDefinitions")
    names = [*(n for n, *_ in variables.inputs), *(v.name for v in (*variables.outputs, *variables.parameters))]
    for key in sorted({unit for name in names if (unit := unit_of(name))} | ({"s"} if fmi == 3 else set())):
        unit = xml.SubElement(units, "Unit", name=UNITS[key][0])
        xml.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[key][1].items()})
    categories = xml.SubElement(root, "LogCategories")
    xml.SubElement(categories, "Category", name="logStatusError", description="what was refused, and why")
    xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=f"{step_s:g}")
    listed = xml.SubElement(root, "ModelVariables")
    for reference, (name, kind, numbers) in enumerate(_reals(variables, fmi)):
        unit = unit_of(name)
        about = {"name": name, "valueReference": str(reference), **kind}
        numbers |= {"unit": UNITS[unit][0]} if unit else {}
        if fmi == 3:
            xml.SubElement(listed, "Float64", about | numbers)
        else:
            xml.SubElement(xml.SubElement(listed, "ScalarVariable", about), "Real", numbers)
    structure = xml.SubElement(root, "ModelStructure")
    outputs = range(len(variables.inputs), len(variables.inputs) + len(variables.outputs))
    for part in ("Output", "InitialUnknown"):
        if fmi == 3:
            for reference in outputs:
                xml.SubElement(structure, part, valueReference=str(reference))
        else:
            unknowns = xml.SubElement(structure, f"{part}s")
            for reference in outputs:
                xml.SubElement(unknowns, "Unknown", index=str(reference + 1))
    xml.indent(root)
    return xml.tostring(root, encoding="UTF-8", xml_declaration=True)


def _reals(variables: Variables, fmi: int) -> Iterator[tuple[str, dict[str, str], dict[str, str]]]:
    """Name, kind and numbers of all variables in the order of their references."""
    for name, text, start in variables.inputs:
        yield name, {"description": text, "causality": "input", "variability": "continuous"}, {"start": repr(start)}
    kind = {"causality": "output", "variability": "continuous", "initial": "calculated"}
    for output in variables.outputs:
        yield output.name, {"description": output.description, **kind}, {}
    kind = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
    for p in variables.parameters:
        bounds = {key: repr(bound) for key, bound in (("min", p.low), ("max", p.high)) if math.isfinite(bound)}
        yield p.name, {"description": p.description, **kind}, {"start": repr(p.start), **bounds}
    if fmi == 3:
        yield "time", {"causality": "independent", "variability": "continuous"}, {"unit": "s"}
