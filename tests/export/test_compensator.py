"""The compensator as native code: Python's volts to the bit, in any C program, for three systems."""

import ctypes
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars.selectors as cs
import pytest
from typer.testing import CliRunner

import compensation
from compensation import Context, Sample, native
from compensation import legs as compensator_legs
from hexsim import HexsimError, load_scenario
from hexsim.cli import app
from hexsim.export import compensator
from hexsim.simulation import simulate

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the library is built and loaded on Linux")
CONTEXT = Context()
ROUNDING_V = 1e-6  # a position reading that falls on the other side of its count makes 1e-7 V


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    """Folder of the export for this system; the library linked by zig."""
    pytest.importorskip("ziglang", reason="the library is linked by the wheel `ziglang`: pip install hexsim[fmu]")
    compensator.export_compensator("adaptive", "x86_64-linux", out := tmp_path_factory.mktemp("adaptive"), CONTEXT)
    return out


def library(exported: Path) -> compensation.Compensator:
    return compensation.create(str(exported / "libhexsim_adaptive.so"))


class Leg:
    """43 kg on a three-way valve with a spool of 60 Hz and 45.4 mV of overlap; friction, noise."""

    def __init__(self, seed: int) -> None:
        self.rng, self.valve_V = np.random.default_rng(seed), 0.0
        self.y, self.v, self.pressure, self.spool, self.rate = 0.1, 0.0, 3.398e6, 0.0, 0.0

    def move(self, volts: float) -> None:
        """One tick."""
        self.valve_V, w, h = volts, 2.0 * math.pi * 60.0, 1e-4
        for _ in range(20):
            self.rate += h * (w * w * (volts - self.spool) - 1.4 * w * self.rate)
            self.spool += h * self.rate
            opening = math.copysign(max(abs(self.spool) - 0.0454, 0.0), self.spool)
            drop = 7e6 - self.pressure if self.spool > 0.0 else self.pressure
            flow = 0.15 * opening * math.sqrt(drop / 3.5e6)
            self.pressure += h * 1.5e9 * (flow - self.v) / (self.y + 4e-4)
            friction = 75.0 * math.tanh(self.v / 1e-3) + 1500.0 * self.v
            self.v += h * ((self.pressure * 1.2566e-3 - 3848.6 - friction) / 43.0 - 9.81)
            self.y += h * self.v


TWO_LEGS = [replace(CONTEXT, leg=leg, mobility=row) for leg, row in enumerate([(1.0, 0.02), (0.02, 1.0)])]


def signals(seconds: float, legs: list[Leg]) -> Iterator[list[Sample]]:
    """Samples of legs that carry a hundredth of each other's load, of which they are told from 2 s to 9 s: the first one's pressure is
    lost for 0.1 s, later its preview for a tick."""
    ticks = np.arange(round(500 * seconds) + 15) / 500
    y = 0.1 + 0.05 * np.sin(np.pi * ticks) * np.minimum(ticks / 2.0, 1.0)
    load = 0.3 * np.cos(8.0 * ticks)
    for k, t in enumerate(ticks[:-15].tolist()):
        read = [(leg.y + leg.rng.normal(0, 1e-6), leg.pressure + leg.rng.normal(0, 1e3)) for leg in legs]
        forces, speeds = np.array([p * 1.2566e-3 - 3848.6 for _, p in read]), np.array([leg.v for leg in legs])
        row = [
            Sample(
                t,
                y[k],
                y[k : k + 15],
                position,
                50.0 * (y[k] - position),
                leg.valve_V,
                pressure,
                7e6,
                load_preview_m_s2=load[k : k + 15] if 2.0 < t < 9.0 else load[:0],
                forces_N=forces,
                speeds_m_s=speeds,
                load_of_pose_m_s2=0.01 * math.sin(t),
                mobility=np.array(context.mobility),
            )
            for leg, context, (position, pressure) in zip(legs, TWO_LEGS, read, strict=True)
        ]
        if 8.6 <= t < 8.7:
            row[0] = replace(row[0], pressure_bottom_Pa=math.nan)
        if k == 4650:
            row[0] = replace(row[0], preview_m=np.full(15, math.nan))
        yield row


def drive(made, states: list, rows: Sequence[list[Sample]] | Iterator[list[Sample]], legs: Sequence[Leg] = ()) -> list:
    """What each tick adds and says, and what is known at the end, of legs that tell each other."""
    found, all_legs = [], np.ones((len(states), len(states)), bool)
    for row in rows:
        stepped = [made.step(state, sample) for state, sample in zip(states, row, strict=True)]
        volts, states = [added for added, _ in stepped], [state for _, state in stepped]
        compensator_legs.tell([made] * len(states), states, all_legs[0], all_legs)
        found.append((volts, [made.status(state) for state in states]))
        for leg, added, sample in zip(legs, volts, row, strict=False):
            leg.move(added + sample.control_V)
    return [*found, [(made.parameters(state), made.knows(state), made.not_engaged(state)) for state in states]]


@pytest.fixture(scope="module")
def driven() -> tuple[list[list[Sample]], list]:
    """10 s of two legs with Python's algorithm: their samples, and what it made of them."""
    python, legs, rows = compensation.create("adaptive"), [Leg(1), Leg(2)], []
    kept = (rows.append(row) or row for row in signals(10.0, legs))
    return rows, drive(python, [python.start(context) for context in TWO_LEGS], kept, legs)


def restarted(made: compensation.Compensator, driven: tuple[list, list], seconds: float = 3.2, **changes) -> list:
    """The same from 2 s on, from what was learned in all of it."""
    rows, ours = driven
    known = ours[-1][1][0]
    given = [[replace(sample, **changes) for sample in row] for row in rows[1000 : 1000 + round(500 * seconds)]]
    return drive(made, [made.restore(context, known) for context in TWO_LEGS], given)


def test_legs_of_a_platform_are_pythons_to_the_bit(exported, driven):
    """10 s in which two legs are identified, tell each other and engage together, one loses a pressure and later its state, and they
    start again, with what was learned and with nothing: volts, sentences, numbers and errors equal; and once more from what was
    learned. Without the load that the other legs give the volts are other ones."""
    (rows, ours), made = driven, library(exported)
    assert drive(made, [made.start(context) for context in TWO_LEGS], rows) == ours
    volts, said = np.array([tick[0] for tick in ours[:-1]]), {sentence for tick in ours[:-1] for sentence in tick[1]}
    assert volts.any(axis=0).all() and len(said) == 3
    again = restarted(made, driven)
    assert again == restarted(compensation.create("adaptive"), driven) and np.any([tick[0] for tick in again[:-1]])
    assert restarted(made, driven, load_preview_m_s2=np.zeros(0)) != again


def test_a_short_preview_counts_as_none(exported, driven):
    """3 setpoints do not reach as far as is looked ahead: the volts are those of a preview of 1."""
    rows, ours = driven
    found = []
    for ends in (3, 1):
        cut = [[replace(sample, preview_m=sample.preview_m[:ends]) for sample in row] for row in rows[:1600]]
        found.append(restarted(library(exported), (cut, ours), 1.2, load_preview_m_s2=np.zeros(0)))
    assert found[0] == found[1] and np.any([tick[0] for tick in found[0][:-1]])


def sil(machine, exported: Path, seconds: float) -> None:
    """Logs of the machine with Python's algorithm and with the library in its place are the same, and it compensates. Of six legs to
    rounding: what the others do to a leg is computed in the compiled loop for the one and by NumPy for the other."""
    scenario = replace(load_scenario("heave"), duration_s=seconds)
    ours = simulate(machine, scenario, compensator=compensation.create("adaptive"), fast=True)
    theirs = simulate(machine, scenario, compensator=library(exported), fast=True)
    volts = [run.log.select(cs.starts_with("compensation")).to_numpy() for run in (ours, theirs)]
    assert volts[0].any()
    if machine.machine.kind == "bench":
        assert theirs.log.equals(ours.log)
        assert theirs.compensator_parameters == ours.compensator_parameters
    else:
        assert np.abs(volts[1] - volts[0]).max() < ROUNDING_V


def test_software_in_the_loop_is_python(bench, exported):
    """The bench until it is compensated: the simulator calls the library at each tick; all columns of the log equal to the bit."""
    sil(bench, exported, 6.0)


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "seconds"), [("bench", 600.0), ("hexapod", 30.0)])
def test_ten_minutes_of_software_in_the_loop(machine, seconds, request, exported):
    """10 minutes of the bench: all columns of the log equal to the bit. Half a minute of six legs: volts equal to 1 uV."""
    sil(request.getfixturevalue(machine), exported, seconds)


ZIG = [sys.executable, "-m", "ziglang", "cc"]


@pytest.mark.parametrize("compiler", [ZIG, pytest.param(["gcc"], marks=pytest.mark.slow)])
def test_the_example_compiles_and_compensates(compiler, exported, tmp_path):
    """main.c in strict C99 with the object file, no warning: finds the dead band of its plant within 2 mV, leaves less than a third
    of plain control's bump, and says how long its functions take."""
    if shutil.which(compiler[0]) is None:
        pytest.skip("gcc is not installed")
    program = tmp_path / "example"
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2", "-s"]
    files = [str(exported / "main.c"), str(exported / "hexsim_adaptive.o")]
    subprocess.run([*compiler, *strict, *files, "-lm", "-o", str(program)], check=True, timeout=120)
    text = subprocess.run([str(program), "20"], check=True, capture_output=True, text=True, timeout=60).stdout
    plain, compensated, found_V = (float(number) for number in re.findall(r"[0-9.]+(?= [mV])", text)[:3])
    assert plain > 0.3 and compensated < plain / 3.0
    assert found_V == pytest.approx(0.0454, abs=2e-3)
    assert re.findall(r"(\w+): [0-9]+, mean [0-9.]+ us, longest [0-9.]+ us", text) == ["steps"]


MATHEMATICS = {
    "ceil",
    "exp",
    "exp2",
    "hypot",
    "log",
    "log10",
    "log1p",
    "pow",
    "rint",
    "sin",
    "cos",
    "sincos",
    "tan",
    "tanh",
    "floor",
    "fmod",
}


def test_the_code_needs_the_c_librarys_mathematics_alone(exported):
    """Undefined symbols of the object file: mathematics and memory moves, nothing that allocates, nothing of Python."""
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    shown = subprocess.run(
        ["nm", "-u", str(exported / "hexsim_adaptive.o")], check=True, capture_output=True, text=True
    )
    needed = {line.split()[-1] for line in shown.stdout.splitlines()}
    assert "exp" in needed
    assert needed <= MATHEMATICS | {"memcpy", "memmove", "memset", "_GLOBAL_OFFSET_TABLE_"}


FUNCTIONS = {
    f"hexsim_adaptive_{function}"
    for function in ("init", "step", "expect", "feel", "hear", "get_parameters", "set_parameters", "state_size")
}


@pytest.mark.slow
def test_the_windows_library_has_the_functions_and_needs_windows_alone(tmp_path):
    """The DLL: 64 bit, exports the header's functions, imports from kernel32 and the C runtime only."""
    pefile = pytest.importorskip("pefile")
    written = compensator.export_compensator("adaptive", "x86_64-windows", tmp_path, CONTEXT)
    assert {path.name for path in written} >= {"hexsim_adaptive.dll", "hexsim_adaptive.o", "hexsim_adaptive.h"}
    dll = pefile.PE(str(tmp_path / "hexsim_adaptive.dll"))
    assert dll.FILE_HEADER.Machine == 0x8664
    assert {symbol.name.decode() for symbol in dll.DIRECTORY_ENTRY_EXPORT.symbols} == FUNCTIONS
    needed = {entry.dll.decode().lower() for entry in dll.DIRECTORY_ENTRY_IMPORT}
    assert all(name == "kernel32.dll" or name.startswith("api-ms-win-crt-") for name in needed)
    if wine := shutil.which("wine"):
        program = tmp_path / "example.exe"
        zig = [*ZIG, "-target", "x86_64-windows-gnu", "-O2"]
        files = [str(tmp_path / "main.c"), str(tmp_path / "hexsim_adaptive.o")]
        subprocess.run([*zig, *files, "-o", str(program)], check=True, timeout=120)
        text = subprocess.run(
            [wine, str(program), "20"], check=True, capture_output=True, text=True, timeout=120
        ).stdout
        assert float(re.findall(r"dead band found: ([0-9.]+)", text)[0]) == pytest.approx(0.0454, abs=1e-3)


@pytest.mark.slow
def test_the_arm_library_is_for_arm(tmp_path):
    """The library for aarch64: an ELF file of that machine, with the header's functions in its table of names."""
    compensator.export_compensator("adaptive", "aarch64-linux", tmp_path, CONTEXT)
    content = (tmp_path / "libhexsim_adaptive.so").read_bytes()
    assert content[:5] == b"\x7fELF\x02" and int.from_bytes(content[18:20], "little") == 183  # EM_AARCH64
    assert all(function.encode() + b"\0" in content for function in FUNCTIONS)


REFUSED = [("stroke_m", math.nan), ("tick_s", 0.0), ("area_bottom_m2", 0.0), ("legs", 9.0), ("leg", -1.0), ("", 0.0)]


def test_settings_that_no_machine_has_are_refused(exported):
    """init says which number: not finite, not above zero, or more than the state has room for."""
    dll, made = ctypes.CDLL(str(exported / "libhexsim_adaptive.so")), native.native("adaptive")
    call = {each: getattr(dll, f"hexsim_adaptive_{each}") for each in ("init", "state_size")}
    state, good = np.zeros(call["state_size"]()), made.settings_of(made.algorithm(), CONTEXT).view(np.float64)
    for setting, value in REFUSED:
        settings, place = good.copy(), made.setting_names.index(setting) if setting else -1
        if setting:
            settings[place] = value
        assert call["init"](*(ctypes.c_void_p(array.ctypes.data) for array in (state, settings))) == 1 + place


def test_learned_numbers_go_into_the_header():
    """The array has the parameters in the order of their places."""
    made = compensation.create("adaptive")
    parameters = made.parameters(made.start(CONTEXT))
    parameters["numbers"]["mass"] = 54321.5
    text = compensator.header("adaptive", CONTEXT, parameters)
    array = re.search(r"hexsim_adaptive_learned\[\d+\] = \{([^}]*)\}", text)
    names = re.search(r"Places in `parameters`. \*/\nenum \{([^}]*)\}", text)
    assert array and names
    numbers, places = ([part.strip() for part in found[1].split(",")] for found in (array, names))
    assert len(numbers) == len(places) == native.native("adaptive").learned.itemsize // 8
    assert float(numbers[places.index("HEXSIM_ADAPTIVE_LEARNED_NUMBERS_MASS")]) == 54321.5


def test_what_cannot_be_exported_is_refused(tmp_path):
    """Another compensator, another target, a learned.json that is none, a library that is none: one sentence each."""
    with pytest.raises(HexsimError, match="'buffered' cannot be exported as native code"):
        compensator.export_compensator("buffered", "x86_64-linux", tmp_path, CONTEXT)
    with pytest.raises(HexsimError, match="target 'vax' is unknown"):
        compensator.export_compensator("adaptive", "vax", tmp_path, CONTEXT)
    with pytest.raises(HexsimError, match="holds no parameters of `adaptive` for leg 1"):
        (tmp_path / "learned.json").write_text('{"legs": [{"numbers": {"ln_spool": 4.0}}]}')
        compensator.learned_of("adaptive", tmp_path / "learned.json", 1)
    (tmp_path / "learned.json").write_text('{"legs": []}')
    arguments = [
        "export",
        "compensator",
        "adaptive",
        "--out",
        str(tmp_path),
        "--learned",
        str(tmp_path / "learned.json"),
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2 and "holds no parameters of `adaptive` for leg 1" in " ".join(result.output.split())
    (tmp_path / "none.so").write_text("nothing")
    result = CliRunner().invoke(app, ["run", "heave", "-c", str(tmp_path / "none.so"), "--out", str(tmp_path / "run")])
    assert result.exit_code == 2 and "is no exported compensator of this system" in " ".join(result.output.split())
