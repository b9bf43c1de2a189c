"""How many small errors in equations, figures and readers the daily tests notice: python -m benchmarks.mutants

Places are drawn with a seed from the functions of each module: a sign or an operator turned, a comparison turned, a number made a
tenth larger. A child process imports the changed source in the place of the file (no file is written), compiles into an empty cache
and runs that module's tests; a mutant is killed where one fails. Survivors are listed, with what changes nothing among them.
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.util
import json
import os
import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

import numba
import pytest
import typer

for _name in ("matplotlib.figure", "mujoco", "polars", "scipy.signal"):  # once, for all children
    importlib.import_module(_name)

ROOT = Path(__file__).parents[1]
LONGEST_S = 180  # of processor time; who takes longer does not end, which a test would notice
LOGS = "readers/test_clocks_by_truth.py readers/test_time_stamps.py readers/test_field_logs.py readers/test_readers.py"
MODULES: dict[str, tuple[int, str]] = {  # module: places, tests
    "hexsim.hydraulics.valve": (
        2,
        "hydraulics/test_valve.py hydraulics/test_laminar_edge.py hydraulics/test_leg.py plant/test_valve_delay.py",
    ),
    "hexsim.hydraulics.ports": (
        2,
        "hydraulics/test_four_way.py hydraulics/test_laminar_edge.py hydraulics/test_leg.py",
    ),
    "hexsim.hydraulics.chamber": (2, "hydraulics/test_chamber.py hydraulics/test_leg.py"),
    "hexsim.hydraulics.friction": (2, "hydraulics/test_friction.py hydraulics/test_leg.py"),
    "hexsim.hydraulics.oil": (2, "hydraulics/test_oil.py"),
    "hexsim.mechanics.kinematics": (3, "test_kinematics.py"),
    "hexsim.mechanics.rigid_body": (3, "test_rigid_body.py"),
    "hexsim.smoothness.reversals": (3, "test_smoothness.py"),
    "hexsim.smoothness.perception": (3, "test_perception.py test_smoothness.py"),
    "hexsim.setpoints.formulas": (3, "motion_computer/test_signals.py"),
    "hexsim.cueing.washout": (2, "test_vehicle_cueing.py test_qualification_pack.py"),
    "hexsim.recording.figures": (4, "recording/test_figures.py"),
    "hexsim.recording.figure_style": (2, "recording/test_figures.py"),
    "hexsim.readers.clocks": (2, LOGS),
    "hexsim.readers.assemble": (2, LOGS),
    "hexsim.readers.one_grid": (2, LOGS),
    "hexsim.readers.mapping": (2, LOGS),
    "hexsim.readers.faulty_values": (2, LOGS),
    "hexsim.readers.formats.text": (2, LOGS),
}
TURNED: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}


def places(tree: ast.Module) -> list[ast.AST]:
    """What can be changed: operators, comparisons and floating-point numbers inside functions."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    return [node for f in functions for statement in f.body for node in ast.walk(statement) if can_change(node)]


def can_change(node: ast.AST) -> bool:
    """Sums of texts are none of a number."""
    if isinstance(node, ast.BinOp):
        is_text = any(
            isinstance(x, ast.JoinedStr) or type(getattr(x, "value", 0)) is str for x in (node.left, node.right)
        )
        return type(node.op) in TURNED and not is_text
    if isinstance(node, ast.Compare):
        return type(node.ops[0]) in TURNED
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.USub)
    return isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value != 0.0


def change(node: Any) -> str:
    """Turn the node, and say its line and what is there now."""
    if isinstance(node, ast.BinOp):
        node.op = TURNED[type(node.op)]()
    elif isinstance(node, ast.Compare):
        node.ops[0] = TURNED[type(node.ops[0])]()
    elif isinstance(node, ast.UnaryOp):
        node.op = ast.UAdd()
    else:
        node.value *= 1.1
    return f"{node.lineno}: {ast.unparse(node)[:80]}"


class InPlace(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Gives one module a changed source."""

    def __init__(self, module: str, path: Path, code: Any) -> None:
        self.module, self.path, self.code = module, path, code

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        return (
            importlib.util.spec_from_file_location(fullname, self.path, loader=self)
            if fullname == self.module
            else None
        )

    def get_code(self, fullname: str) -> Any:
        return self.code

    def get_source(self, fullname: str) -> str:
        return self.path.read_text()


def killed(module: str, code: Any, tests: list[str]) -> bool:
    """Whether a test fails in a process that imports the code in the module's place."""
    child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] != 0
    with tempfile.TemporaryDirectory() as cache:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        os.nice(5)
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S))
        path = ROOT / f"{module.replace('.', '/')}.py"
        sys.meta_path.insert(0, InPlace(module, path, code))
        if b"import compiled" in path.read_bytes():
            numba.config.CACHE_DIR = cache  # type: ignore[attr-defined]
        ended = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-m", "not slow", *tests])
    os._exit(int(ended))


def main(
    seed: Annotated[int, typer.Option(help="Draws the places.")] = 43,
    tests: Annotated[Path, typer.Option(help="Folder of the tests.")] = ROOT / "tests",
    out: Annotated[Path, typer.Option(help="One JSON line a mutant.")] = Path("mutants.jsonl"),
    only: Annotated[str, typer.Option(help="Part of the modules' names.")] = "",
) -> None:
    """Print how many mutants die, and who survives."""
    count = died = 0
    for module, (wanted, names) in MODULES.items():
        if only not in module:
            continue
        path = ROOT / f"{module.replace('.', '/')}.py"
        text = path.read_text()
        n = len(places(ast.parse(text)))
        if killed(module, compile(text, str(path), "exec"), [str(tests / name) for name in names.split()]):
            raise SystemExit(f"{names}: the tests fail without a change")
        for k in sorted(random.Random(f"{seed} {module}").sample(range(n), min(wanted, n))):
            tree = ast.parse(text)
            said = change(places(tree)[k])
            begun = time.monotonic()
            code = compile(ast.fix_missing_locations(tree), str(path), "exec")
            is_dead = killed(module, code, [str(tests / name) for name in names.split()])
            count, died = count + 1, died + is_dead
            with out.open("a") as file:
                row = {"module": module, "change": said, "killed": is_dead, "s": round(time.monotonic() - begun, 1)}
                file.write(json.dumps(row) + "\n")
            if not is_dead:
                print(f"survives: {module}:{said}", flush=True)
    print(f"{died} of {count} killed")


if __name__ == "__main__":
    typer.run(main)
