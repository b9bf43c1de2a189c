"""The plugin of the hydraulic leg, in MuJoCo without hexsim, against `Plant`."""

import json
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from typer.testing import CliRunner

import hexsim as hx
from hexsim import export
from hexsim.cli import app
from hexsim.export import plugin
from hexsim.plant import Plant

pytest.importorskip("ziglang", reason="the export compiles C with the wheel `ziglang`: pip install hexsim[fmu]")
STEP_s = 1e-4
ALONE = """
import sys
import mujoco, numpy as np

library, given, out, begin = sys.argv[1:]
mujoco.mj_loadPluginLibrary(library)
model = mujoco.MjModel.from_xml_path(given + ".xml")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
mujoco.mj_forward(model, data)
at_home = max(abs(data.qacc[:6]).max(), abs(data.act_dot).max())
mujoco.mj_resetDataKeyframe(model, data, model.key(begin).id)
slides = [model.joint(f"slide_{i + 1}").qposadr[0] for i in range(model.nu)]
volts = np.load(given + ".npy")
places = np.zeros((len(volts), model.nu))
for row, place in zip(volts, places):
    place[:], data.ctrl[:] = data.qpos[slides], row
    mujoco.mj_step(model, data, round(1e-3 / model.opt.timestep))
assert not data.warning.number.any()
assert not [name for name in sys.modules if name.startswith(("hexsim", "compensation", "numba"))]
np.save(out, np.vstack([places, np.full(model.nu, at_home)]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The bench's plugin for this system: the compiler makes the C library of another one at its first use, which takes a minute."""
    export.export_plugin(hx.load_machine("bench"), out := tmp_path_factory.mktemp("plugin"), systems=["linux64"])
    return out


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What `hexsim export plugin bench` writes."""
    out = tmp_path_factory.mktemp("plugin")
    done = CliRunner().invoke(app, ["export", "plugin", "bench", "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    names = ["bench.xml", "hexsim_leg.dll", "libhexsim_leg.dylib", "libhexsim_leg.so"]
    assert sorted(json.loads(done.stdout)["files"]) == names
    return out


def driven(folder, xml, volts, tmp_path, begin="home"):
    """Pistons from neutral (n, n_legs) [m] before each millisecond from the keyframe `begin` on, and the largest rate at home, in
    a process of its own."""
    (tmp_path / "given.xml").write_text(xml)
    np.save(tmp_path / "given.npy", volts)
    command = [
        sys.executable,
        "-I",
        "-c",
        ALONE,
        folder / "libhexsim_leg.so",
        tmp_path / "given",
        tmp_path / "out.npy",
        begin,
    ]
    ended = subprocess.run(list(map(str, command)), cwd=tmp_path, capture_output=True, text=True)
    if ended.returncode:
        return ended.stderr
    found = np.load(tmp_path / "out.npy")
    return found[:-1], found[-1, 0]


def by_plant(machine, volts):
    """The same by `Plant`."""
    plant, places = Plant(machine, timestep=STEP_s), []
    plant.prepare(1000.0)
    for row in volts:
        places.append(plant.piston_positions() - plant.kinematics.neutral_positions)
        plant.tick(row)
    return np.array(places)


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("micro_motion_system", "servo_bench")]


@pytest.mark.parametrize("name", ("bench", *SLOW))
def test_heave_in_stock_mujoco_is_that_of_plant(folder, tmp_path, name):
    """4 s of heave, the same volts and constant step: pistons within 1e-9 m of the run's, from where it begins: home, in
    equilibrium, or with servo valves shut.

    MuJoCo's XML carries all digits, so what is left is rounding.
    """
    run = hx.run("heave", name, timestep=STEP_s, set={"scenario.duration_s": 4.0})
    legs = [""] if run.machine.n_legs == 1 else [f"_{i + 1}" for i in range(6)]
    volts = run.log.select([f"valve{leg}_V" for leg in legs]).to_numpy()
    told = (
        run.log.select([f"true_position{leg}_m" for leg in legs]).to_numpy() - run.machine.mechanics.neutral_positions
    )
    xml = plugin.machine_xml(Plant(run.machine, timestep=STEP_s))
    places, at_home = driven(folder, xml, volts, tmp_path, "shut" if name.startswith("servo") else "home")
    assert np.ptp(told) > 0.05 and np.abs(places - told).max() < 1e-9
    assert at_home < 1e-3


def test_a_servo_valves_home_has_the_volts_that_hold_it(folder, tmp_path):
    """servo_bench, whose valve leaks at null: with the keyframe's volts no rate at home, and the piston stays within 1e-9 m for
    half a second; with none, as `Plant` begins, it creeps by 0.1 mm."""
    xml = plugin.machine_xml(Plant(hx.load_machine("servo_bench"), timestep=STEP_s))
    key = ET.fromstring(xml).find("keyframe/key")
    assert key is not None
    volts = np.full((500, 1), float(key.get("ctrl", "0")))
    places, at_home = driven(folder, xml, volts, tmp_path)
    assert at_home < 1e-3 and np.abs(places).max() < 1e-9
    places, _ = driven(folder, xml, 0.0 * volts, tmp_path, "shut")
    assert np.abs(places).max() > 1e-4


def test_an_attribute_is_a_number_of_the_leg(folder, tmp_path):
    """Another overlap in the MJCF is the machine with that overlap, to rounding, and not the one before."""
    volts = np.full((300, 1), 0.12)
    xml = (folder / "bench.xml").read_text()
    assert xml.count('value="5e-06"') == 2
    places, _ = driven(folder, xml.replace('value="5e-06"', 'value="1e-05"'), volts, tmp_path)
    machine = hx.load_machine("bench")
    told = by_plant(machine.with_({"valve.overlap_m": 1e-5}), volts)
    assert np.abs(places - told).max() < 1e-12 < 1e-4 < np.abs(told - by_plant(machine, volts)).max()


@pytest.mark.parametrize(
    ("sentence", "changes"),
    [
        ("attribute density is 'heavy'", (('value="860.0"', 'value="heavy"'),)),
        ("has actdim 2, its leg has 3 states", (('actdim="3"', 'actdim="2"'), ('act="0 0', 'act="0'))),
        ("unrecognized attribute", (('key="density"', 'key="densities"'),)),
    ],
)
def test_what_is_no_leg_is_refused_in_mujoco(folder, tmp_path, sentence, changes):
    """A text for a number, states that the leg has not, and an unknown attribute are errors that say so, no crash."""
    xml = (folder / "bench.xml").read_text()
    for old, new in changes:
        assert old in xml
        xml = xml.replace(old, new)
    told = driven(folder, xml, np.zeros((1, 1)), tmp_path)
    assert isinstance(told, str) and "ValueError" in told and sentence in told


def test_what_a_leg_cannot_hold_is_refused(tmp_path):
    """A power unit, late valves and an impossible step are refused in a sentence; nothing is written."""
    for machine, step, sentence in (
        (hx.load_machine("micro_motion_system/power_unit"), None, "its supply has states"),
        (
            hx.load_machine("bench").with_({"effects": {"valve_delay": {"delay_s": 0.004}}}),
            None,
            "valves have a valve delay",
        ),
        (hx.load_machine("bench"), 1.0, "1e-6 to 1e-3 is possible"),
    ):
        with pytest.raises(hx.HexsimError, match=sentence):
            export.export_plugin(machine, tmp_path / "out", step)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_windows_library_needs_windows_alone(written):
    """Its imports are the C library and kernel32; MuJoCo is found in the process that loads it."""
    pefile = pytest.importorskip("pefile", reason="reads libraries of Windows")
    found = pefile.PE(data=(written / "hexsim_leg.dll").read_bytes())
    names = {entry.dll.decode().lower() for entry in found.DIRECTORY_ENTRY_IMPORT}
    assert all(name == "kernel32.dll" or name.startswith(("api-ms-win-crt", "msvcrt", "ucrtbase")) for name in names), (
        names
    )
    assert plugin.NAME.encode() in (written / "libhexsim_leg.so").read_bytes()


@pytest.mark.slow
def test_the_macos_library_needs_its_system_alone(written):
    """A signed library for arm64 that names no folder; it imports from libSystem alone, and nothing of MuJoCo or Python by name:
    MuJoCo's functions are found in the process that loads it."""
    data = (written / "libhexsim_leg.dylib").read_bytes()
    magic, processor, _, kind, count = struct.unpack_from("<5I", data)
    assert (magic, processor, kind) == (0xFEEDFACF, 0x0100000C, 6)  # 64 bit, arm64, a dynamic library
    commands, place = {}, 32
    for _ in range(count):
        command, size = struct.unpack_from("<2I", data, place)
        commands.setdefault(command, []).append(data[place : place + size])
        place += size
    own, loaded = ([one[24:].rstrip(b"\0") for one in commands[command]] for command in (0x0D, 0x0C))
    assert own == [b"@rpath/libhexsim_leg.dylib"] and loaded == [b"/usr/lib/libSystem.B.dylib"]
    assert 0x1D in commands  # a signature, without which arm64 loads nothing
    symbols, n, texts, _ = struct.unpack_from("<4I", commands[0x02][0], 8)
    wanted = set()
    for k in range(n):
        text, flags, *_ = struct.unpack_from("<IBBHQ", data, symbols + 16 * k)
        if flags & 0x0E == 0 and flags & 1:
            wanted.add(data[texts + text : data.index(b"\0", texts + text)].decode())
    assert "_dlsym" in wanted and not [name for name in wanted if name.startswith(("_mj", "_Py", "_NRT", "_numba"))]
