"""`hexsim export schema`: what a machine, scenario or mapping file may say, for editors that complete and check as you type."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer


def schema(
    what: Annotated[Literal["machine", "scenario", "mapping"], typer.Argument(help="Kind of file.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; default: print it.")] = None,
) -> None:
    """JSON schema of machine, scenario or mapping files. In the file's first line: `#:schema ./machine.schema.json`."""
    from hexsim.files.json_files import dumps, write_json

    tables = {"machine": machine_schema, "scenario": scenario_schema, "mapping": mapping_schema}[what]()
    if out is None:
        typer.echo(dumps(tables))
    else:
        write_json(out, tables)


def machine_schema() -> dict[str, Any]:
    """All tables of machine.toml, and each effect of the library with its parameters, units and bounds."""
    from hexsim.declaration import Machine
    from hexsim.hydraulics.effects import library

    tables = Machine.model_json_schema()
    tables["properties"]["effects"] |= {
        "additionalProperties": False,
        "properties": {name: _one_or_more(_effect(effect)) for name, effect in library().items()},
    }
    return {"$schema": DRAFT, **tables}


def scenario_schema() -> dict[str, Any]:
    """All keys of a scenario file, its signals and faults by kind."""
    from pydantic import create_model

    from hexsim.scenarios.scenario import ScenarioFile
    from hexsim.simulation.faults import FaultTable

    whole = create_model("Scenario", __base__=ScenarioFile, faults=(list[FaultTable], []))
    return {"$schema": DRAFT, **whole.model_json_schema()}


def mapping_schema() -> dict[str, Any]:
    """All keys of a mapping file; a column for all legs has {leg} in its name."""
    from hexsim.readers.mapping import Mapping

    return {"$schema": DRAFT, **Mapping.model_json_schema()}


DRAFT = "https://json-schema.org/draft/2020-12/schema"
PLACES = {"description": '"all legs", "platform", "leg 2", or a list of legs', "type": ["string", "array"]}


def _effect(effect: Any) -> dict[str, Any]:
    numbers = {
        parameter.name: {
            "type": "number",
            "minimum": parameter.bounds[0],
            "maximum": parameter.bounds[1],
            "description": f"[{parameter.unit}], typically {parameter.typical:g}",
        }
        for parameter in effect.parameters
    }
    free = {"description": {"type": "string"}, "curve": {"type": "object"}}
    return {
        "type": "object",
        "description": effect.description,
        "properties": {**numbers, "where": PLACES, **free},
        "required": [parameter.name for parameter in effect.parameters if parameter.default is None],
        "additionalProperties": False,
    }


def _one_or_more(table: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [table, {"type": "array", "items": table}], "description": table["description"]}
