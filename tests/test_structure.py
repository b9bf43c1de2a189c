"""What no file of the project does. Which room may know which is held by import-linter (pyproject.toml)."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from hexsim.files import run_folder

ROOT = Path(__file__).parents[1]


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
    return found


def test_no_pickle_anywhere():
    """No file of the project reads or writes pickles, nor numpy arrays with pickles allowed."""
    for folder in ("hexsim", "compensation", "benchmarks", "examples"):
        for path in (ROOT / folder).rglob("*.py"):
            assert not imports(path) & {"pickle", "joblib", "dill", "cloudpickle", "shelve"}, path
            assert "allow_pickle=True" not in path.read_text(), path


EXTRAS = {
    "distributed",
    "asammdf",
    "matio",
    "ziglang",
    "fmpy",
    "mcap",
    "rosbags",
    "gymnasium",
    "viser",
    "mjviser",
    "exudyn",
    "h5py",
    "pandas",
    "stable_baselines3",
    "control",
}
OF_AN_EXTRA = ("hexsim.gym", "hexsim.web")  # packages that are nothing without it
IMPORT_ALL = """
import importlib, pkgutil, sys
for name in {extras!r}:
    sys.modules[name] = None
import compensation, hexsim
for package in (hexsim, compensation):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".", onerror=lambda name: None):
        if not module.name.startswith({left_out!r}) and not module.name.endswith("__main__"):
            importlib.import_module(module.name)
"""


def loaded_with(node: ast.AST) -> set[str]:
    """Names of what a module imports as it is loaded itself: not within functions, nor where it is tried."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.Try | ast.If):
        return set()
    own = {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()
    own |= {node.module} if isinstance(node, ast.ImportFrom) and node.module and not node.level else set()
    return own.union(*map(loaded_with, ast.iter_child_nodes(node)))


def test_no_module_names_an_extra_as_it_is_loaded():
    """None but those that are for an extra alone."""
    for path in (*(ROOT / "hexsim").rglob("*.py"), *(ROOT / "compensation").rglob("*.py")):
        if not ".".join(path.relative_to(ROOT).parts).startswith(OF_AN_EXTRA):
            names = loaded_with(ast.parse(path.read_text()))
            assert not {name.split(".")[0] for name in names} & EXTRAS, path
            assert not [name for name in names if name.startswith(OF_AN_EXTRA)], path


@pytest.mark.slow  # imports every module; none names an extra, above
def test_no_module_needs_an_extra():
    """With everything that an extra provides out of reach, every module is imported, but those that are for an extra alone."""
    code = IMPORT_ALL.format(extras=sorted(EXTRAS), left_out=OF_AN_EXTRA)
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


def test_every_file_name_is_one_on_windows():
    """No file of the project, and no folder of a run, has a name that Windows refuses or takes for another."""
    reserved = re.compile(r'[<>:"|?*\\]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE)
    names = [p for folder in ("hexsim", "compensation", "models", "tests", "docs") for p in (ROOT / folder).rglob("*")]
    assert len(names) > 500
    assert not [path for path in names if reserved.search(path.name)]
    assert len({str(path).lower() for path in names}) == len(names)
    assert not reserved.search(run_folder.default_folder('a: "b" <c>?').name)


def is_number(value: ast.expr) -> bool:
    """A number, or a formula or tuple of numbers and names."""
    parts = (
        ast.Constant,
        ast.UnaryOp,
        ast.BinOp,
        ast.Tuple,
        ast.List,
        ast.Name,
        ast.operator,
        ast.unaryop,
        ast.expr_context,
    )
    known = list(ast.walk(value))
    numbers = [one.value for one in known if isinstance(one, ast.Constant)]
    return all(isinstance(one, parts) for one in known) and any(type(one) in (int, float) for one in numbers)


def statements(tree: ast.Module) -> list[ast.stmt]:
    """Those of a module, and of its tables: its classes that are named tuples."""
    tables = [
        node for node in tree.body if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases)
    ]
    return [*tree.body, *(line for table in tables for line in table.body)]


def test_every_number_of_a_module_says_its_unit_or_reason():
    """Beside it, in a comment on its lines, or on the line before or behind it; the numbers of its tables too."""
    bare, n = [], 0
    for path in (path for room in ("hexsim", "compensation") for path in (ROOT / room).rglob("*.py")):
        text = path.read_text()
        lines = ["", *map(str.strip, text.splitlines()), ""]
        for node in statements(ast.parse(text)):
            if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None and is_number(node.value):
                n, own = n + 1, lines[node.lineno : (node.end_lineno or node.lineno) + 1]
                before, behind = lines[node.lineno - 1], lines[(node.end_lineno or node.lineno) + 1]
                if not any("#" in line for line in own) and not any(
                    line.startswith(("#", '"""')) for line in (before, behind)
                ):
                    bare.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert n > 100 and not bare, bare
