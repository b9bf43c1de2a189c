"""What is compiled is said once and counted apart."""

import time

import pytest
from numba import njit

from hexsim.compile_time import compile_time


@pytest.fixture
def fresh(tmp_path):
    """Makes functions that nobody has called, of a module by name; kept: by numba's cache, in a folder that is new."""

    def make(module: str, kept: bool = True):
        made, path = {}, tmp_path / f"{module}.py"
        path.write_text("def function(x):\n    return x + 1.0\n")
        exec(compile(path.read_text(), str(path), "exec"), {"__name__": module}, made)
        return njit(cache=kept)(made["function"])

    return make


def test_compiling_is_said_once_and_counted(fresh):
    """Two of hexsim's functions: one message; the seconds are those that the first calls took, and a second call adds none.
    Functions of others, and those that are compiled in every process, are counted in time and not talked about."""
    said = []
    with compile_time(said.append) as compiling:
        fresh("somebody.else")(1.0)
        fresh("hexsim.small", kept=False)(1.0)
        assert said == [] and compiling.seconds > 0.0
        before, begin = compiling.seconds, time.perf_counter()
        functions = [fresh("hexsim.hydraulics.fresh"), fresh("compensation.fresh")]
        for function in functions:
            function(1.0)
        wall = time.perf_counter() - begin
        spent = compiling.seconds - before
        assert said == ["compiling (once)"] and compiling.count == 2
        assert 0.3 * wall < spent <= wall
        for function in functions:
            function(2.0)
        assert compiling.seconds == before + spent
    fresh("hexsim.fresh")(1.0)
    assert compiling.count == 2
