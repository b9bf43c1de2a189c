"""The same FMU in FMI 3.0, and for Windows: what can be said of it on Linux."""

import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.plant import Plant

pytest.importorskip("ziglang", reason="the export compiles C with the wheel `ziglang`: pip install hexsim[fmu]")
fmpy = pytest.importorskip("fmpy", reason="FMPy runs the FMU: pip install hexsim[fmu]")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi3 import FMU3Slave, fmi3LogMessageCallback  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

from hexsim import export  # noqa: E402
from hexsim.export import mujoco_library  # noqa: E402

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the export needs MuJoCo's Linux library")
STEP = 0.002  # [s] communication step
VOLTS = 0.8 * np.sin(2 * np.pi * 4 * STEP * np.arange(60))


@pytest.fixture(scope="module")
def path(bench, tmp_path_factory) -> Path:
    """The bench by FMI 3.0."""
    export.export_fmu(bench, out := tmp_path_factory.mktemp("fmi3") / "bench.fmu", fmi=3)
    return out


class Slave:
    """An instance before the end of its initialisation, its variables by name, and what it said."""

    def __init__(self, path: Path, folder: Path) -> None:
        unpacked = fmpy.extract(str(path), unzipdir=str(folder))
        description = fmpy.read_model_description(unpacked)
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU3Slave(
            guid=description.guid,
            unzipDirectory=unpacked,
            instanceName="one",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        self.said: list[str] = []
        logger = fmi3LogMessageCallback(lambda *given: self.said.append(given[3].decode()))
        self.fmu.instantiate(logMessage=logger)
        self.kept = logger
        self.fmu.enterInitializationMode(startTime=5.0)

    def get(self, name: str) -> float:
        return self.fmu.getFloat64([self.references[name]])[0]

    def set(self, name: str, value: float) -> None:
        self.fmu.setFloat64([self.references[name]], [value])

    def run(self, volts: np.ndarray) -> np.ndarray:
        """Position, bottom pressure and acceleration before each step."""
        rows = []
        for k, command in enumerate(volts):
            rows.append([self.get(name) for name in ("position_m", "pressure_bottom_Pa", "acceleration_m_s2")])
            self.set("valve_V", float(command))
            self.fmu.doStep(5.0 + k * STEP, STEP)
        return np.array(rows)


def test_fmi3_is_valid_and_is_the_plant(path, tmp_path, bench):
    """FMPy has nothing to say of it; outputs are those of `Plant` with the steps that it chooses, within 2 %: they go
    by a rule in an FMU, by their error in `Plant`."""
    assert validate_fmu(str(path)) == []
    slave = Slave(path, tmp_path)
    slave.fmu.exitInitializationMode()
    found = slave.run(VOLTS)
    plant = Plant(bench)
    plant.prepare(1 / STEP, len(VOLTS))
    for command in VOLTS:
        plant.tick(np.array([command]))
    record = plant.record
    wanted = np.column_stack([record.qpos[:, 0], record.act[:, -1] * 1e6, record.qacc[:, 0]])
    wanted[:, 0] -= wanted[0, 0]
    found[:, 0] -= found[0, 0]
    assert np.ptp(wanted[:, 0]) > 1e-3
    assert (np.abs(found - wanted) / np.abs(wanted).max(axis=0)).max() < 0.02
    assert slave.get("time") == pytest.approx(5.0 + len(VOLTS) * STEP, rel=1e-12)


def test_fmpy_simulates_fmi3_as_it_would_any_other(path):
    """`fmpy.simulate_fmu` with a parameter: a stiffer friction moves the piston less."""
    ends = [
        fmpy.simulate_fmu(str(path), stop_time=0.1, step_size=STEP, start_values={"valve_V": 0.5, **values})[
            "position_m"
        ]
        for values in ({}, {"friction.coulomb_extend_N": 400.0})
    ]
    assert np.abs(ends[0] - ends[1]).max() > 1e-5


def test_a_kept_state_goes_on_to_the_bit_in_fmi3(path, tmp_path):
    """Kept in mid-motion, written to bytes, read and set again; reset gives the first state."""
    slave = Slave(path, tmp_path)
    slave.fmu.exitInitializationMode()
    first = slave.run(VOLTS)
    state = slave.fmu.getFMUState()
    kept = slave.fmu.serializeFMUState(state)
    later = slave.run(VOLTS)
    slave.fmu.setFMUState(slave.fmu.deserializeFMUState(kept))
    assert np.array_equal(slave.run(VOLTS), later)
    slave.fmu.reset()
    slave.fmu.enterInitializationMode(startTime=0.0)
    slave.fmu.exitInitializationMode()
    assert np.array_equal(slave.run(VOLTS), first)
    slave.fmu.freeFMUState(state)


def test_fmi3_refuses_through_the_logger(path, tmp_path):
    """A parameter beyond its range, volts that are no number, a step that is none: one sentence each."""
    slave = Slave(path, tmp_path)
    for act in (
        lambda: slave.set("friction.coulomb_extend_N", -1.0),
        lambda: slave.set("valve_V", np.nan),
        lambda: slave.fmu.doStep(0.0, STEP),
        lambda: (slave.fmu.exitInitializationMode(), slave.fmu.doStep(0.0, 0.0)),
    ):
        with pytest.raises(FMICallException):
            act()
    assert [said.split(":")[0] for said in slave.said] == [
        "friction.coulomb_extend_N = -1",
        "volts of valve 1 are nan",
        "a step before the initialisation",
        "a communication step of 0 s",
    ]


@pytest.mark.slow
def test_two_systems_in_one_file_below_5_MB(bench, tmp_path):
    """Folders of FMI 3.0; the Windows library asks for nothing but Windows, and finds MuJoCo beside itself."""
    pefile = pytest.importorskip("pefile", reason="reads libraries of Windows")
    try:
        windows = mujoco_library.windows_library()
    except HexsimError as error:
        pytest.skip(f"mujoco.dll is not to be had here: {error}")
    export.export_fmu(bench, path := tmp_path / "bench.fmu", fmi=3, windows=windows)
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        ours = pefile.PE(data=archive.read("binaries/x86_64-windows/hexsim_bench.dll"))
        given = pefile.PE(data=archive.read("binaries/x86_64-windows/mujoco.dll"))
        linux = {Path(name).suffix for name in names if name.startswith("binaries/x86_64-linux/")}
    assert linux == {".so", ".4"}
    assert path.stat().st_size < 5e6
    needed = {entry.dll.decode().lower() for entry in ours.DIRECTORY_ENTRY_IMPORT}
    assert {name for name in needed if not name.startswith("api-ms-win-crt-")} == {"kernel32.dll"}
    exported = {symbol.name.decode() for symbol in ours.DIRECTORY_ENTRY_EXPORT.symbols}
    functions = {name for name in dir(fmpy.fmi3._FMU3) if name.startswith("fmi3")}
    assert functions - exported == set()
    offered = {symbol.name.decode() for symbol in given.DIRECTORY_ENTRY_EXPORT.symbols}
    header = (Path(mujoco_library.__file__).parent / "plant.h").read_text().partition("MUJOCO_FUNCTIONS(X) \\")[2]
    called = {f"mj_{part.split(')')[0]}" for part in header.partition("#define")[0].split("X(")[1:]}
    assert len(called) == 14
    assert called - offered == set()
    assert {"mjcb_act_dyn", "mjcb_act_bias"} <= offered


def test_what_is_no_library_for_windows_is_refused(tmp_path):
    """A file that is missing, or another one."""
    with pytest.raises(HexsimError, match=r"no library for Windows: give mujoco\.dll of MuJoCo 4"):
        mujoco_library.windows_library(tmp_path / "mujoco.dll")


def test_a_library_without_what_is_never_called_keeps_the_rest():
    """More than a megabyte of traps, and no table to find more."""
    library = mujoco_library.linux_library().read_bytes()
    light = mujoco_library.lightened(library)
    assert len(light) < len(library)
    assert sum(a != b for a, b in zip(library, light, strict=False)) > 1e6
    assert mujoco_library.lightened(light) == light
