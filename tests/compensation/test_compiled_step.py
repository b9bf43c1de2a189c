"""The compiled step: nothing is compiled before the first call, the state has no gaps, the cache knows its sources."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np

import compensation
from compensation import compiled


def test_nothing_is_compiled_by_an_import() -> None:
    """After import, create and listing no function of the step has a compiled version."""
    code = (
        "import compensation\n"
        "from compensation.adaptive import step\n"
        "compensation.create('adaptive'), compensation.available()\n"
        "assert not step.tick_of.signatures and not step.start.signatures\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_state_is_one_flat_array() -> None:
    """Its fields follow each other without gaps, all 8 bytes wide, doubles or integers: a C struct of the same order."""

    def leaves(layout: np.dtype, at: int) -> list[tuple[int, str]]:
        if layout.subdtype is not None:
            item, shape = layout.subdtype
            return [leaf for i in range(int(np.prod(shape))) for leaf in leaves(item, at + i * item.itemsize)]
        if layout.names is None:
            return [(at, layout.str)]
        return [leaf for name in layout.names for leaf in leaves(layout.fields[name][0], at + layout.fields[name][1])]

    layout = compensation.create("adaptive").start(compensation.Context()).inner.states.dtype
    found = leaves(layout, 0)
    assert [at for at, _ in found] == list(range(0, layout.itemsize, 8))
    assert {kind for _, kind in found} == {"<f8", "<i8"}


def test_the_cache_knows_every_file_with_compiled_code() -> None:
    """Each file of the package that holds a compiled function or a layout is one of those that a change of makes the cache anew."""
    package = Path(compensation.__file__).parent
    holds = {
        path for path in package.rglob("*.py") if "@compiled" in (text := path.read_text()) or " = record(" in text
    }
    assert len(holds) > 10 and holds <= set(compiled.compiled_sources())
