"""hexsim: hydraulic six-DOF motion systems in MuJoCo, adaptive compensation, and tracing of measured residuals.

`import hexsim as hx`: the names of `__all__` are the public face, and stable; all else may change. They are loaded when
they are first used.
"""

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

try:
    __version__ = version("hexsim")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0+unknown"

_PLACES = {  # name of the face -> its module; hexsim/__init__.pyi says the same to type checkers
    "HexsimError": "errors",
    **dict.fromkeys(("Machine", "available", "load_machine", "load_scenario"), "face.given"),
    **dict.fromkeys(("Comparison", "Run", "compare", "run", "sweep"), "face.runs"),
    **dict.fromkeys(
        ("Identification", "Qualification", "TraceResult", "identify", "load_log", "qualify", "trace"), "face.measured"
    ),
    **dict.fromkeys(("LinearModel", "linearize"), "face.linear"),
    "Picture": "face.show",
    "Scenario": "scenarios",
}
__all__ = [*sorted(_PLACES), "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'hexsim' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"hexsim.{_PLACES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
