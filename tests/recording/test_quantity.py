"""Values as people read them: units by size, errors to their second place, words of keys."""

import pytest

from hexsim.recording import quantity as quantities


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2.53e-4, "m", "253 µm"),
        (1.91e4, "Pa", "0.191 bar"),
        (4010.0, "Pa", "40.1 mbar"),
        (1.5e9, "Pa", "1500 MPa"),
        (7.4e-8, "m3/s", "74.0 mm³/s"),
        (1.0e-4 / 6, "m3/s", "1.00 l/min"),
        (0.00117, "1", "0.117 %"),
        (0.611, "1", "0.611"),
        (6.76e-15, "m3/s/Pa", "6.76×10⁻¹⁵ m³/(s·Pa)"),
        (-3.2e-6, "m", "−3.20 µm"),
        (0.0, "N", "0 N"),
        (float("nan"), "m", "–"),
        (None, "m", "–"),
    ],
)
def test_a_value_has_the_unit_of_its_size(value, unit, text):
    """What a data sheet would print; a power of ten where the unit has no smaller name; a dash for nothing."""
    assert quantities.quantity(value, unit) == text


def test_what_is_compared_has_one_unit():
    """Two flows in one row: both as the larger one is read."""
    assert quantities.quantity(2.5e-7, "m3/s") == "250 mm³/s"
    assert quantities.quantity(2.5e-7, "m3/s", beside=1e-5) == "0.0150 l/min"


@pytest.mark.parametrize(
    ("value", "error", "unit", "text"),
    [
        (2.4003e9, 7.7e5, "Pa s/m3", "(2.40030 ± 0.00077)×10⁹ Pa·s/m³"),
        (0.4967, 0.00098, "rad", "0.49670 ± 0.00098 rad"),
        (66.87, 0.077, "N", "66.870 ± 0.077 N"),
        (12.0, 3000.0, "N", "12 ± 3000 N"),
        (0.04, 1e-5, "V", "40.000 ± 0.010 mV"),
        (1.0, 1e-9, "kg", "1.00000 ± <0.00001 kg"),
        (39.8, None, "kg", "39.80 kg"),
    ],
)
def test_an_error_decides_the_places(value, error, unit, text):
    """Value and error in one unit, to the error's second place, and not more than six places."""
    assert quantities.with_error(value, error, unit) == text


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("viscous_extend_N_s_m", ("viscous extend", "N s/m")),
        ("discharge_coefficient", ("discharge coefficient", "1")),
        ("angular_acceleration_z_rad_s2", ("angular acceleration z", "rad/s2")),
        ("gain_V_per_m", ("gain", "V/m")),
    ],
)
def test_keys_are_words_and_a_unit(key, words):
    """The longest ending that is a unit is the unit."""
    assert quantities.split_key(key) == words


def test_shares_are_whole_per_cents():
    """A small one is not called nothing, a negative gain is nothing."""
    assert [quantities.share(x) for x in (0.93, 0.003, 0.0, -0.2, None)] == ["93 %", "<1 %", "0 %", "0 %", "–"]
