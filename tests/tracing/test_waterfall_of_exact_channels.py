"""The error budget's picture where a channel reads what is declared, exactly: a supply without a sensor of its own."""

from types import SimpleNamespace

import pytest

from hexsim.tracing.report import budget as budgets

STEPS = ("as declared", "parameters refitted", "with effect")


def rows(channel: str, noise: float, *rms: float) -> list[dict]:
    return [
        {"run": "held_out", "channel": channel, "step": step, "rms": value, "multiple_of_noise": value / noise}
        for step, value in zip(STEPS, rms, strict=True)
    ]


@pytest.mark.parametrize("supply", [(0.0, 4.0e4, 0.04), (0.0, 0.0, 0.0), (0.0, float("nan"), 2.0e4)])
def test_no_error_at_all_is_drawn_too(supply):
    """A channel with no error before, after or at all: the picture is drawn, and a channel without any error has no panel."""
    budget = rows("position_m", 3e-6, 8e-4, 8e-4, 4e-6) + rows("pressure_supply_Pa", 4e3, *supply)
    shown = budgets.worst_of_kinds(budget)
    assert ("held_out", "position_m") in shown
    assert (("held_out", "pressure_supply_Pa") in shown) == (supply[1] > 0.0)
    assert budgets.waterfall(SimpleNamespace(budget=budget)).startswith(b"\x89PNG")
