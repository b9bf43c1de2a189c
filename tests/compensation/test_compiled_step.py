"""The compiled step: the same volts as its source run by Python, nothing compiled before the first call, no gaps."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from leg_plant import Leg, run

import compensation
from compensation import Context
from compensation.adaptive import Adaptive
from compensation.adaptive.layout import DESIGN, STATE
from compensation.compiled import compiled_sources
from compensation.least_squares import add_row, solve, start_least_squares
from compensation.records import empty

CODE = """
import sys
import numpy as np
from compensation import Context, Sample, create
rows, volts = np.load(sys.argv[1]), []
made = create("adaptive")
state = made.start(Context(period_s=2.0))
for row in rows:
    values = row[:7].tolist()
    volts.append(made.step(state, Sample(*values[:2], row[7:], *values[2:]))[0])
np.save(sys.argv[2], volts)
"""


class Recorded(compensation.Compensator):
    """The algorithm, and every sample it was given."""

    def __init__(self, inner: compensation.Compensator) -> None:
        self.inner, self.name, self.preview_s, self.rows = inner, inner.name, inner.preview_s, []

    def start(self, context):
        return self.inner.start(context)

    def parameters(self, state):
        return self.inner.parameters(state)

    def restore(self, context, parameters):
        return self.inner.restore(context, parameters)

    def step(self, state, sample):
        self.rows.append(
            [sample.time_s, sample.setpoint_m, sample.position_m, sample.control_V, sample.valve_V,
             sample.pressure_bottom_Pa, sample.pressure_supply_Pa, *sample.preview_m]
        )  # fmt: skip
        return self.inner.step(state, sample)


@pytest.mark.slow
def test_compiled_step_gives_the_volts_of_its_source(tmp_path: Path) -> None:
    """A leg with a leak and 2 ms of delay for 9 s, identified, engaged and past its first compensated
    reversals: its samples, through the same functions without the compiler, give the same volts to 1e-9 V."""
    made = Recorded(compensation.create("adaptive"))
    leg = Leg(leak_supply_m3_s_Pa=1e-12, valve_delay_s=2e-3)
    record = run(made, leg, duration_s=9.0)
    assert np.abs(record.added_V).max() > 0.3
    np.save(tmp_path / "rows.npy", made.rows)
    arguments = [sys.executable, "-c", CODE, str(tmp_path / "rows.npy"), str(tmp_path / "volts.npy")]
    subprocess.run(arguments, check=True, env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, timeout=300)
    assert np.abs(np.load(tmp_path / "volts.npy") - record.added_V).max() <= 1e-9


def test_nothing_is_compiled_by_an_import() -> None:
    """After import, create and listing no function of the step has a compiled version."""
    code = (
        "import compensation\n"
        "from compensation.adaptive import step\n"
        "compensation.create('adaptive'), compensation.available()\n"
        "assert not step.tick.signatures and not step.step.signatures\n"
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

    found = leaves(STATE, 0)
    assert [at for at, _ in found] == list(range(0, STATE.itemsize, 8))
    assert {kind for _, kind in found} == {"<f8", "<i8"}


def test_a_design_is_the_least_squares_solution() -> None:
    """Rows rotated into a triangle one by one give the solution of numpy's lstsq of all rows at once, to 1e-12, with rows
    of weights from 1e-2 to 1e3 among them."""
    rng, work, found = np.random.default_rng(0), empty(DESIGN), np.zeros(7)
    rows = rng.normal(size=(200, 8)) * 10.0 ** rng.uniform(-2, 3, (200, 1))
    start_least_squares(work, 7)
    for row in rows:
        work.row[:8] = row
        add_row(work, 7)
    solve(work, 7, found)
    assert np.abs(found - np.linalg.lstsq(rows[:, :7], rows[:, 7], rcond=None)[0]).max() < 1e-12


def test_parameters_come_back_as_they_were_kept() -> None:
    """A state restored from JSON keeps the same numbers, to the bit, and has the taps of the state that learned them."""
    made = Adaptive()
    state = made.start(Context())
    state.numbers.valve.edges["lag_s"], state.numbers.valve.edges["ready"] = 4.1e-3, 1
    state.numbers.valve.edges["gain_m_s_V"], state.numbers.delay.sums[:] = 0.2, 0.1 * np.repeat(np.arange(17.0), 15)
    kept = made.parameters(state)
    restored = made.restore(Context(), json.loads(json.dumps(kept)))
    assert made.parameters(restored) == kept
    assert restored.numbers.lag_s == 4.1e-3 and restored.numbers.delay_s > 1e-4
    assert abs(restored.numbers.lead_taps.sum() - 1.0) < 1e-9 and np.abs(restored.numbers.lead_taps).max() > 1.0


def test_the_cache_knows_every_file_with_compiled_code() -> None:
    """Each file of the package that holds a compiled function or a layout is one of those that a change of makes the cache anew."""
    package = Path(compensation.__file__).parent
    holds = {
        path for path in package.rglob("*.py") if "@compiled" in (text := path.read_text()) or " = record(" in text
    }
    assert len(holds) > 30 and holds <= set(compiled_sources())
