"""What is claimed of any input: it works, or one sentence says why not; quickly, within memory, in its place."""

import os
import resource
import shutil
import traceback
from collections.abc import Callable
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import SearchStrategy
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app

LONGEST = timedelta(seconds=10)
MOST_BYTES = 2 << 30
DAILY = 10
MORE = pytest.mark.parametrize("examples", [DAILY, pytest.param(1000, marks=pytest.mark.slow)])


def fuzz(strategy: SearchStrategy, claim: Callable[[Any], None], examples: int) -> None:
    """Hold the claim against examples: the same ten each time in CI; other ones each time in the slow part, which prints
    how to repeat the one that failed."""
    quiet = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example]
    chosen = settings(
        max_examples=examples,
        derandomize=examples == DAILY,
        database=None,
        deadline=LONGEST,
        print_blob=True,
        suppress_health_check=quiet,
    )
    most = peak_bytes() + MOST_BYTES

    def within_memory(example: Any) -> None:
        claim(example)
        assert peak_bytes() < most, f"{peak_bytes() / 1e9:.1f} GB"

    chosen(given(strategy)(within_memory))()


def peak_bytes() -> int:
    """The most memory that this process ever held (Linux counts it in kB)."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def command(*arguments: str) -> None:
    """The command works, or ends with code 2 and one line on stderr; no traceback."""
    result = CliRunner().invoke(app, list(arguments))
    if result.exit_code == 0:
        return
    assert result.exit_code == 2, traceback.format_exception(result.exception)
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("hexsim: ") and len(lines[0]) < 2100, result.stderr


def refused(function: Callable[..., Any], *arguments: Any) -> bool:
    """Whether the function said in one sentence that it will not; any other exception is a failure."""
    try:
        function(*arguments)
    except HexsimError as error:
        assert "\n" not in str(error) and 0 < len(str(error)) < 3000, str(error)[:200]
        return True
    return False


@contextmanager
def sandbox(folder: Path):
    """Work in `folder`/work; afterwards nothing lies beside it."""
    work = folder / "work"
    work.mkdir(exist_ok=True)
    before = Path.cwd()
    os.chdir(work)
    try:
        yield work
    finally:
        os.chdir(before)
    left = [path.name for path in folder.iterdir()]
    shutil.rmtree(work)
    assert left == ["work"], left
