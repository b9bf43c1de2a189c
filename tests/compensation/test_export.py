"""Learned curves leave as a table and as C, and say the same there."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest
from leg_plant import run

import compensation
from compensation import export, report_functions


def learned(name: str) -> export.CompensationTable:
    """The table of an algorithm after 8 s of motion."""
    made = compensation.create(name)
    return export.table_of(made.parameters(run(made, duration_s=8.0).state))


def test_table_follows_the_function() -> None:
    """At its points the table is Eq. 5.3 to rounding; between them, beyond 50 mV, within 1 mV."""
    table = export.table_of({"function": 2, "a_V": 0.25, "q_V": 1.0, "r_V": 0.0})
    for u in table.control_V:
        assert table(u) == pytest.approx(report_functions.function_2(min(max(u, -2), 2), 0.25, 1.0, 0.0), abs=1e-15)
    for u in np.linspace(0.05, 1.9, 500):
        assert table(u) == pytest.approx(report_functions.function_2(u, 0.25, 1.0, 0.0), abs=1e-3)


def test_table_jumps_across_the_overlap() -> None:
    """What was learned in 8 s is the dead band of the report's valve: +-45.45 mV within 1 mV on either side of
    zero."""
    table = learned("adaptive")
    for u in (0.01, -0.01):
        assert table(u) == pytest.approx(math.copysign(5e-6 / 1.1e-4, u), abs=1e-3)


def test_csv_gives_the_same_numbers_back(tmp_path) -> None:
    """Writing a table and reading its columns changes no bit."""
    table = learned("buffered")
    export.to_csv(table, tmp_path / "table.csv")
    columns = np.genfromtxt(tmp_path / "table.csv", delimiter=",", names=True)
    assert tuple(columns["control_V"]) == table.control_V and tuple(columns["compensation_V"]) == table.compensation_V


def test_only_c_names_are_taken() -> None:
    """A name that C would not take, or a note that ends its comment, is refused."""
    table = export.CompensationTable((-1.0, 1.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="no name for a C function"):
        export.to_c(table, name="2nd-leg")
    with pytest.raises(ValueError, match=r"must not hold \*/"):
        export.to_c(table, note="end */ here")


@pytest.mark.parametrize("name", ["buffered", "adaptive", "exact"])
def test_c_agrees_with_python_to_1e_12(name, tmp_path) -> None:
    """The C function, compiled, and the Python table agree to 1e-12 V at 20,000 voltages, ends and step included."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler on this machine: the exported C function could not be compiled")
    table = learned(name)
    export.to_c(table, name="leg_1", note=f"learned by {name}", path=tmp_path / "leg_1.c")
    library = tmp_path / "leg_1.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "-o", str(library), str(tmp_path / "leg_1.c")], check=True, capture_output=True)
    function = ctypes.CDLL(str(library)).leg_1
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
    rng = np.random.default_rng(0)
    volts = np.concatenate([rng.uniform(-12, 12, 10000), rng.normal(0, 0.05, 10000), table.control_V])
    for u in volts.tolist():
        assert abs(function(u) - table(u)) <= 1e-12
