"""What may know what: the rooms of docs/architecture.md."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "compensation": ("hexsim", "mujoco", "numba", "scipy"),
    "hexsim/hydraulics": ("mujoco", "hexsim.plant", "hexsim.simulation"),
    "hexsim/machine": ("mujoco", "hexsim.plant"),
    "hexsim/smoothness": ("mujoco", "hexsim.plant"),
    "hexsim/tracing": ("mujoco",),
}


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found.add(node.module)
    return found


@pytest.mark.parametrize("room", FORBIDDEN)
def test_rooms_do_not_know_what_they_must_not(room):
    """No file of the room imports what is forbidden to it."""
    files = sorted((ROOT / room).rglob("*.py"))
    assert files
    guilty = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in files
        for name in imports(path)
        if any(name == bad or name.startswith(f"{bad}.") for bad in FORBIDDEN[room])
    ]
    assert guilty == []


def test_no_pickle_anywhere():
    """No file of the project reads or writes pickles, nor numpy arrays with pickles allowed."""
    for folder in ("hexsim", "compensation", "benchmarks", "examples"):
        for path in (ROOT / folder).rglob("*.py"):
            assert not imports(path) & {"pickle", "joblib", "dill", "cloudpickle", "shelve"}, path
            assert "allow_pickle=True" not in path.read_text(), path
