"""A hum of the pressure signal is no outside force, though it stands in the force balance as one."""

import pytest
from other_plant import write_machine

import hexsim as hx


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "injected", "found"),
    [(407, {"pressure_hum": 6e4}, []), (406, {"outside_force": 40.0}, ["outside_force_tone"])],
)
def test_a_hum_of_the_pressure_is_named_nothing_and_an_outside_force_is_named(tmp_path, seed, injected, found):
    """Benches of the second plant, its parameters off. The balances alone name the hum of 37 Hz an outside force of 75 N; with
    that force a held-out channel grows in simulation."""
    write_machine(tmp_path, seed, injected)
    report = hx.trace(tmp_path, ["fit", "sweep"], ["validate"]).report
    assert [own["name"] for own in report["effects"]] == found
