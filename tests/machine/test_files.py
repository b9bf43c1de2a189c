"""Finding, reading, changing and writing machine files."""

import tomllib
from pathlib import Path

import pytest
import tomli_w

import hexsim as hx
from hexsim import HexsimError
from hexsim.machine import load_machine, machine_from_dict, save_machine
from hexsim.machine.files import changed, machine_tables

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("name", ["bench", "micro_motion_system"])
def test_saved_machine_reads_back_equal(name, tmp_path):
    """Round trip through the file, every number to the bit, effects and their places included."""
    machine = changed(
        load_machine(name),
        {
            "valve.overlap_m": 1.0 / 3.0 * 1e-5,
            "effects.null_offset": [{"offset_V": 0.1, "where": "leg 1"}, {"offset_V": 0.2}],
            "effects.leakage_supply_to_chamber": {"conductance_m3_s_Pa": 2.4e-12},
        },
    )
    save_machine(machine, tmp_path / "machine.toml")
    assert load_machine(tmp_path) == machine
    assert load_machine(tmp_path / "machine.toml") == machine


def test_saved_machine_has_the_tables_of_the_format(bench, tmp_path):
    """The file has the tables and keys of measured/README.md, and none for what the machine has not."""
    save_machine(bench, tmp_path / "machine.toml")
    tables = tomllib.loads((tmp_path / "machine.toml").read_text())
    assert tables["machine"]["name"] == "bench"
    assert tables["cylinder"]["piston_diameter_m"] == 0.04
    assert "geometry" not in tables and "power_unit" not in tables and "effects" not in tables


def test_packaged_machines_are_found_by_name_and_path():
    """By name, by "models/<name>", by folder and by file: the same machine."""
    assert {"bench", "micro_motion_system"} <= set(hx.available()["machines"])
    for name in hx.available()["machines"]:
        folder = MODELS / name
        same = load_machine(name)
        assert same.name == name
        assert load_machine(f"models/{name}") == load_machine(folder) == load_machine(folder / "machine.toml") == same


def test_packaged_names_work_away_from_the_repository(tmp_path, monkeypatch):
    """In another working directory "bench" and "models/bench" are still found."""
    monkeypatch.chdir(tmp_path)
    assert load_machine("bench") == load_machine("models/bench")


def test_unknown_machine_lists_what_there_is():
    """The sentence names what was given and the machines that exist."""
    with pytest.raises(HexsimError) as caught:
        load_machine("micro_motion")
    assert "unknown machine 'micro_motion'" in str(caught.value)
    assert ", ".join(hx.available()["machines"]) in str(caught.value)


def test_folder_without_a_machine_file_says_so(tmp_path):
    """An empty folder is named, with the file that is missing."""
    with pytest.raises(HexsimError, match=r"has no machine.toml: put the machine's declaration there"):
        load_machine(tmp_path)


def test_file_that_is_no_toml_names_file_and_line(tmp_path):
    """A broken line is told with its number, and another encoding than UTF-8 by name."""
    path = tmp_path / "machine.toml"
    path.write_text('[machine]\nname = "x\n')
    with pytest.raises(HexsimError, match=r"machine.toml is not valid TOML: .*line 2"):
        load_machine(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HexsimError, match=r"machine.toml is no text in UTF-8"):
        load_machine(path)


def test_error_of_a_file_names_the_file(tmp_path, bench):
    """The path stands before table and key."""
    path = tmp_path / "machine.toml"
    save_machine(bench, path)
    path.write_text(path.read_text().replace("pressure_Pa = 7000000.0", "pressure_Pa = 70.0", 1))
    with pytest.raises(HexsimError) as caught:
        load_machine(tmp_path)
    assert str(caught.value).startswith(f"{path}: [supply] pressure_Pa = 70.0: ")


def test_changed_leaves_the_original_alone(bench):
    """A change gives a new machine that differs in that key only."""
    before = machine_tables(bench)
    after = machine_tables(changed(bench, {"valve.overlap_m": 20e-6}))
    assert machine_tables(bench) == before
    assert after["valve"].pop("overlap_m") == 20e-6
    del before["valve"]["overlap_m"]
    assert after == before


def test_changed_makes_new_tables(hexapod):
    """A table that the file leaves out, and an effect, may be set key by key."""
    machine = changed(hexapod, {"power_unit.motor_power_W": 3000.0, "effects.null_offset.offset_V": 0.1})
    assert machine.power_unit.motor_power_W == 3000.0
    assert machine.effects["null_offset"] == {"offset_V": 0.1}


def test_changed_keeps_the_effects_of_the_file(hexapod):
    """A second change leaves the first one's effect and table in place."""
    once = changed(hexapod, {"power_unit.motor_power_W": 3000.0, "effects.null_offset.offset_V": 0.1})
    twice = changed(once, {"effects.mass_change.mass_kg": 4.0})
    assert set(twice.effects) == {"null_offset", "mass_change"}
    assert twice.power_unit == once.power_unit


def test_changed_through_a_number_is_refused(bench):
    """A dotted key that leads through a number names the part that is no table."""
    with pytest.raises(HexsimError, match=r"fault 1: valve.overlap_m.x leads through overlap_m, which is no table"):
        changed(bench, {"valve.overlap_m.x": 1.0}, "fault 1")


def test_changed_checks_again(bench):
    """What a file may not say a change may not either."""
    with pytest.raises(HexsimError, match=r"changes: \[valve\]: overlap_m = 0.002 must be smaller than"):
        changed(bench, {"valve.overlap_m": 2e-3})


def test_tables_make_the_machine_again(hexapod):
    """machine_tables and machine_from_dict are each other's inverse."""
    assert machine_from_dict(machine_tables(hexapod)) == hexapod


def test_a_fitted_file_keeps_what_its_author_wrote(tmp_path):
    """Comments, order and spaces stay; a number that changed stands in its line, a new effect in a table of its own; and the file reads
    back as the machine that was saved."""
    written = "# The rig in hall 3.\n" + (MODELS / "bench" / "machine.toml").read_text().replace(
        "\n[valve]", "\n[valve]   # from a data sheet"
    )
    (tmp_path / "declared.toml").write_text(written)
    declared = load_machine(tmp_path / "declared.toml")
    fitted = changed(declared, {"valve.overlap_m": 8.25e-6, "effects.null_offset": {"offset_V": 0.1}})
    save_machine(fitted, tmp_path / "machine.toml", tmp_path / "declared.toml")
    text = (tmp_path / "machine.toml").read_text()
    assert load_machine(tmp_path) == fitted
    before, after = written.splitlines(), text.splitlines()
    apart = [(one, other) for one, other in zip(before, after, strict=False) if one != other]
    assert (
        len(apart) == 1 and apart[0][1].startswith("overlap_m = 8.25e-06") and "[valve]   # from a data sheet" in text
    )
    assert tomllib.loads(text)["effects"] == {"null_offset": {"offset_V": 0.1}}
    save_machine(declared, tmp_path / "same.toml", tmp_path / "declared.toml")
    assert (tmp_path / "same.toml").read_text() == written


LEGS = """
[[leg]]
number = 3  # rebuilt
[leg.valve]
overlap_m = 2e-5  # changed in May

[[leg]]
number = 6
[leg.valve]
overlap_m = 1e-5

[effects.null_offset]
offset_V = 0.1
"""


def test_single_legs_and_effects_are_changed_in_their_place(tmp_path):
    """Tables of single legs keep their comments; a new effect is there, and one that is gone is gone."""
    (tmp_path / "declared.toml").write_text((MODELS / "micro_motion_system" / "machine.toml").read_text() + LEGS)
    tables = machine_tables(load_machine(tmp_path / "declared.toml"))
    tables["effects"] = {"leakage_supply_to_chamber": {"conductance_m3_s_Pa": 1e-12}}
    tables["leg"][0]["valve"]["overlap_m"] = 2.5e-5
    fitted = machine_from_dict(tables)
    save_machine(fitted, tmp_path / "machine.toml", tmp_path / "declared.toml")
    text = (tmp_path / "machine.toml").read_text()
    assert load_machine(tmp_path) == fitted
    assert "number = 3  # rebuilt" in text and "overlap_m = 2.5e-05  # changed in May" in text
    assert "null_offset" not in text


@pytest.mark.parametrize(
    "name", [*hx.available()["machines"], "micro_motion_system/power_unit", "micro_motion_system/tuned"]
)
def test_every_machine_of_hexsim_can_be_fitted_and_keeps_its_comments(name, tmp_path):
    """Another overlap or mass: the file reads as the fitted machine, and every comment of the declared one is in it."""
    declared = load_machine(name)
    mass = "load.platform_mass_kg" if declared.is_hexapod else "load.moving_mass_kg"
    value = declared.load.platform_mass_kg if declared.is_hexapod else declared.load.moving_mass_kg
    fitted = changed(declared, {mass: value + 1.25})
    save_machine(fitted, tmp_path / "machine.toml", name)
    assert load_machine(tmp_path) == fitted
    text = (tmp_path / "machine.toml").read_text()
    place = MODELS / name
    file = place / "machine.toml" if place.is_dir() else place.with_suffix(".toml")
    comments = [line[line.index("#") :] for line in file.read_text().splitlines() if "#" in line]
    assert comments and all(comment in text for comment in comments)


def test_what_is_declared_in_another_way_is_written_whole(tmp_path, bench):
    """From a run's config.toml, whose machine stands in a table: all numbers, and it reads back."""
    (tmp_path / "config.toml").write_text(tomli_w.dumps({"machine": machine_tables(bench)}))
    save_machine(bench, tmp_path / "machine.toml", tmp_path / "config.toml")
    assert load_machine(tmp_path) == bench
