"""What is compiled is said once and counted apart."""

import time

from numba import njit

from hexsim.compile_time import compile_time


def fresh(module: str):
    """A function that nobody has called, of a module by name."""
    made = {}
    exec(compile("def function(x):\n    return x + 1.0\n", "fresh", "exec"), {"__name__": module}, made)
    return njit(made["function"])


def test_compiling_is_said_once_and_counted():
    """Two of hexsim's functions: one message; the seconds are those that the first calls took, and a second call adds none.
    Functions of others are counted and not talked about."""
    said = []
    with compile_time(said.append) as compiling:
        fresh("somebody.else")(1.0)
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
