"""What no file of the project does. Which room may know which is held by import-linter (pyproject.toml)."""

import ast
from pathlib import Path

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
