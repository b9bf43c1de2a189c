"""The compiler of equations where nothing can be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import numba.core.caching as caching
impl = getattr(caching, "CacheImpl", None) or caching._CacheImpl
impl._locator_classes = [locator for locator in impl._locator_classes if "UserProvided" in locator.__name__]
from hexsim.hydraulics import valve
assert valve.play(1.0, 0.0, 0.25) == 0.75
from numba import config
print(config.CACHE_DIR)
"""


@pytest.mark.parametrize("taken", [False, True])
def test_without_a_folder_for_the_cache_a_temporary_one_is_used(tmp_path, taken):
    """Neither the package's folder nor the user's can be written (numba finds no place): equations compile all the same,
    cached below the temporary folder, and not in a folder that others can write."""
    own = tmp_path / f"hexsim-cache-{os.getuid()}"
    if taken:
        own.mkdir()
        own.chmod(0o777)
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment |= {"PYTHONPATH": str(Path(__file__).parents[1]), "TMPDIR": str(tmp_path)}
    ended = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    used = Path(ended.stdout.strip())
    assert used.parent == tmp_path and (used != own) == taken
    assert any(used.rglob("*.nbi")) and not used.stat().st_mode & 0o077


HELD = """
from compensation.compiled import compiled

@compiled
def one_more(x):
    return x + 1.0

@compiled
def two_more(x):
    return x + 2.0
"""
CALLBACKS = """
from numba import types
from compensation.compiled import compiled_callback
from held import one_more, two_more

def callback(function):
    @compiled_callback(types.float64(types.float64))
    def called(x):
        return function(x)

    return called

for made in map(callback, (one_more, two_more)):
    print(made.ctypes(1.0), made.cache_hits)
"""


def test_callbacks_that_hold_compiled_functions_are_found_again(tmp_path):
    """Two callbacks of the same lines hold a function each: they are two, and the next process finds both compiled; where the file
    of what they hold was changed, neither is found, and the new one runs."""
    (tmp_path / "callbacks.py").write_text(CALLBACKS)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, str(tmp_path / "callbacks.py")]
    changed = HELD.replace("1.0", "5.0")
    for held, said in ((HELD, "2.0 0 3.0 0"), ("", "2.0 1 3.0 1"), (changed, "6.0 0 3.0 0")):
        if held:
            (tmp_path / "held.py").write_text(held)
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert ended.stdout.split() == said.split()


CALLED = """
import math
from compensation.compiled import compiled

@compiled
def inner(x):
    if x < 0.0:
        raise ValueError("below zero")
    return math.sqrt(x)

@compiled
def outer(x):
    return 2.0 * inner(x)

def of_python():
    return len(inner.signatures), len(inner.stats.cache_hits)

assert outer(4.0) == 4.0
before = of_python()
assert inner(4.0) == 2.0 and inner(9.0) == 3.0
for function in (inner, outer):
    try:
        function(-1.0)
    except ValueError as error:
        assert str(error) == "below zero"
    else:
        raise AssertionError
names = [made.fndesc.qualname for function in (inner, outer) for made in function.overloads.values()]
print(*before, *of_python(), len(outer.stats.cache_hits), *names)
"""


def test_what_compiled_callers_alone_ask_for_has_no_code_for_python(tmp_path):
    """A function that a compiled one calls has none until Python calls it, which is then a call of what the compiled one has; it says its
    errors through both; the next process finds all of it compiled."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path)}
    (tmp_path / "called.py").write_text(CALLED)
    for said in ("0 0 1 0 0 <lambda> outer", "0 0 1 1 1 <lambda> outer"):
        ended = subprocess.run(
            [sys.executable, str(tmp_path / "called.py")], env=environment, capture_output=True, text=True
        )
        assert ended.stdout.strip() == said, ended.stderr
    [linked] = [path.name for path in tmp_path.rglob("linked-*.nbc")]
    assert "inner" in linked


HANDED = """
import numpy as np
from hexsim.compiled import allocating, compiled

@compiled
def same(x):
    return x

@compiled
def both(x):
    return x[0], x

@allocating
def twice(x):
    return 2.0 * x

@compiled
def first_of_twice(x):
    return twice(x)[0]

@allocating
def first_of_same(x):
    return same(x)[0]

@compiled
def first_of_same_uncounted(x):
    return same(x)[0]

@allocating
def sum_of_twice(x):
    return twice(x).sum()

x = np.ones(3)
for function in 2 * (same, both, first_of_twice, first_of_same):
    try:
        function(x)
    except Exception as error:
        assert "hands an array to code that counts references otherwise" in str(error), error
    else:
        raise AssertionError(function)
assert twice(x).sum() == sum_of_twice(x) == 6.0 and first_of_same_uncounted(x) == 1.0
assert twice(3.0) == 6.0
"""


def test_arrays_go_only_where_they_are_counted_alike(tmp_path):
    """Code that counts no references hands no array to Python or to code that counts, nor takes one from it: it is refused when it is
    compiled, for the array would be freed under its user, or never."""
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path)}
    (tmp_path / "handed.py").write_text(HANDED)
    for _ in range(2):  # the next process finds none of it compiled either
        ended = subprocess.run(
            [sys.executable, str(tmp_path / "handed.py")], env=environment, capture_output=True, text=True
        )
        assert ended.returncode == 0, ended.stderr


DAMAGES = [("*.nbi", "flipped"), ("*.nbi", "empty"), ("*.nbi", "cut"), ("*.nbc", "empty"), ("*.nbc", "flipped")]


@pytest.mark.parametrize(
    ("suffix", "damage"),
    [("*.nbc", "cut"), *(pytest.param(*one, marks=pytest.mark.slow) for one in DAMAGES)],
)
def test_a_damaged_file_of_the_cache_is_compiled_again(tmp_path, suffix, damage):
    """A file of numba's cache that was cut short, emptied or has a flipped byte costs a compilation, and is right after it."""
    code = "from hexsim.hydraulics import valve\nassert valve.play(1.0, 0.0, 0.25) == 0.75\nprint(len(valve.play.stats.cache_hits))"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path)}

    def hits() -> int:
        ended = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
        return int(ended.stdout)

    assert (hits(), hits()) == (0, 1)
    for file in tmp_path.rglob(suffix):
        content = bytearray(file.read_bytes())
        if damage == "flipped":
            content[-20] ^= 1
        file.write_bytes({"empty": b"", "cut": bytes(content[: len(content) // 2])}.get(damage, bytes(content)))
    first = hits()
    assert first == 0 or (suffix, damage) == ("*.nbi", "flipped")  # an index may still tell its way
    assert hits() == 1
