"""The compensator as native code: Python's volts to the bit, in any C program, for three systems."""

import ctypes
import math
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars.selectors as cs
import pytest
from typer.testing import CliRunner

import compensation
from compensation import Context, Sample
from compensation.adaptive.layout import LEARNED, SETTINGS, empty
from hexsim.cli import app
from hexsim.errors import HexsimError
from hexsim.export.compensator import export_compensator, header
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the library is built and loaded on Linux")
CONTEXT = Context()


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    """Folder of the export for this system; the library linked by zig."""
    pytest.importorskip("ziglang", reason="the library is linked by the wheel `ziglang`: pip install hexsim[fmu]")
    out = tmp_path_factory.mktemp("exported")
    export_compensator("adaptive", "x86_64-linux", out, CONTEXT)
    return out


def recorded(seconds: float, fault_s: float = math.inf) -> list[Sample]:
    """Samples of a leg under plain control of a valve with 45 mV of dead band, noise, and a pressure lost for 0.1 s."""
    rng, ticks = np.random.default_rng(3), round(500 * seconds)
    y = 0.1 + 0.05 * np.sin(np.pi * np.arange(ticks + 15) / 500) * np.minimum(np.arange(ticks + 15) / 1000, 1)
    place, valve, samples = 0.1, 0.0, []
    for k in range(ticks):
        position = round((place + rng.normal(0, 3e-6)) / 3e-6) * 3e-6
        control = 50.0 * (y[k] - position)
        velocity = 0.15 * math.copysign(max(abs(control) - 0.045, 0.0), control)
        bottom = 3.4e6 + 6e4 * math.tanh(velocity / 2e-3) + rng.normal(0, 4e3)
        lost = fault_s <= k / 500 < fault_s + 0.1
        samples.append(
            Sample(
                k / 500,
                y[k],
                y[k : k + 15],
                position,
                control,
                valve,
                math.nan if lost else bottom,
                7e6 + rng.normal(0, 4e3),
            )
        )
        place, valve = place + velocity * 0.002, control
    return samples


def volts(made: compensation.Compensator, samples: list[Sample], state=None) -> tuple[list[float], list[str]]:
    state = made.start(CONTEXT) if state is None else state
    out, said = [], []
    for sample in samples:
        added, state = made.step(state, sample)
        out.append(added)
        said.append(made.status(state))
    out.append(made.parameters(state))
    return out, said


def test_volts_flags_and_parameters_are_pythons_to_the_bit(exported):
    """9 s in which valve and friction are identified, it engages, a pressure is lost for 0.1 s and it starts again: volts,
    sentences and parameters equal; and once more from the parameters."""
    native = compensation.create(str(exported / "libhexsim_adaptive.so"))
    samples = recorded(9.0, fault_s=7.2)
    python = compensation.create("adaptive")
    ours, said = volts(python, samples)
    theirs, told = volts(native, samples)
    assert max(map(abs, ours[:-1])) > 0.05 and len(set(said)) == 2
    assert theirs == ours and told == said
    known = ours[-1]
    assert volts(native, samples[3000:], native.restore(CONTEXT, known)) == volts(
        python, samples[3000:], python.restore(CONTEXT, known)
    )


def test_the_load_of_other_legs_is_expected_alike(exported):
    """9 s, from 5 s on with a load that other legs give: other volts than without, and equal to Python's to the bit; an
    algorithm that is told no more goes back to its own acceleration."""
    samples = recorded(9.0, fault_s=20.0)
    loads = [
        0.3 * np.cos(8 * np.arange(k, k + 15) / 500) if 2500 < k < 4000 else np.zeros(0) for k in range(len(samples))
    ]
    told = [replace(sample, load_preview_m_s2=load) for sample, load in zip(samples, loads, strict=True)]
    ours, _ = volts(compensation.create("adaptive"), told)
    assert volts(compensation.create(str(exported / "libhexsim_adaptive.so")), told)[0] == ours
    assert max(map(abs, np.subtract(ours[:-1], volts(compensation.create("adaptive"), samples)[0][:-1]))) > 5e-5


def sil(machine, exported: Path, seconds: float) -> None:
    """Logs of the machine with Python's algorithm and with the library in its place are the same, and it compensates."""
    scenario = replace(load_scenario("heave"), duration_s=seconds)
    ours = simulate(machine, scenario, compensator=compensation.create("adaptive"), fast=True)
    theirs = simulate(
        machine, scenario, compensator=compensation.create(str(exported / "libhexsim_adaptive.so")), fast=True
    )
    assert theirs.log.equals(ours.log)
    assert theirs.compensator_parameters == ours.compensator_parameters
    added = ours.log.select(cs.starts_with("compensation")).to_numpy()
    assert np.abs(added).max() > 0.1


def test_software_in_the_loop_is_python(bench, exported):
    """11 s of the bench: the simulator calls the library at each tick; all columns of the log equal to the bit."""
    sil(bench, exported, 11.0)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seconds"), [("bench", 600.0), ("hexapod", 30.0)])
def test_ten_minutes_of_software_in_the_loop(name, seconds, request, exported):
    """10 minutes of the bench, half a minute of six legs: all columns of the log equal to the bit."""
    sil(request.getfixturevalue(name), exported, seconds)


def compilers() -> list[list[str]]:
    return [["gcc"], [sys.executable, "-m", "ziglang", "cc"]]


@pytest.mark.parametrize("compiler", compilers(), ids=["gcc", "zig"])
def test_the_example_compiles_and_compensates(compiler, exported, tmp_path):
    """main.c in strict C99 with the object file, no warning: finds the dead band of its plant within 1 mV, lags less than
    a tenth of plain control, and says how long a step and a design take."""
    if shutil.which(compiler[0]) is None:
        pytest.skip("gcc is not installed")
    program = tmp_path / "example"
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O2"]
    files = [str(exported / "main.c"), str(exported / "hexsim_adaptive.o")]
    subprocess.run([*compiler, *strict, *files, "-lm", "-o", str(program)], check=True, timeout=120)
    text = subprocess.run([str(program), "40"], check=True, capture_output=True, text=True, timeout=60).stdout
    numbers = [float(number) for number in re.findall(r"[0-9.]+", text)]
    plain_mm, compensated_mm, found_V = numbers[:3]
    assert compensated_mm < 0.1 * plain_mm
    assert found_V == pytest.approx(0.0454, abs=1e-3)
    assert re.search(r"steps: 20000, mean [0-9.]+ us, longest [0-9.]+ us", text) and "designs: " in text


MATHEMATICS = {"ceil", "exp", "exp2", "hypot", "log", "log1p", "pow", "rint", "sin", "cos", "sincos", "floor", "fmod"}


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
    f"hexsim_adaptive_{name}"
    for name in ("init", "step", "expect", "hear", "design", "get_parameters", "set_parameters", "state_size")
}


@pytest.mark.slow
def test_the_windows_library_has_the_functions_and_needs_windows_alone(exported, tmp_path):
    """hexsim_adaptive.dll: 64 bit, exports the header's functions, imports from kernel32 and the C runtime only."""
    pefile = pytest.importorskip("pefile")
    written = export_compensator("adaptive", "x86_64-windows", tmp_path, CONTEXT)
    assert {path.name for path in written} >= {"hexsim_adaptive.dll", "hexsim_adaptive.o", "hexsim_adaptive.h"}
    library = pefile.PE(str(tmp_path / "hexsim_adaptive.dll"))
    assert library.FILE_HEADER.Machine == 0x8664
    assert {symbol.name.decode() for symbol in library.DIRECTORY_ENTRY_EXPORT.symbols} == FUNCTIONS
    needed = {entry.dll.decode().lower() for entry in library.DIRECTORY_ENTRY_IMPORT}
    assert all(name == "kernel32.dll" or name.startswith("api-ms-win-crt-") for name in needed)
    if wine := shutil.which("wine"):
        program = tmp_path / "example.exe"
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-O2"]
        files = [str(tmp_path / "main.c"), str(tmp_path / "hexsim_adaptive.o")]
        subprocess.run([*zig, *files, "-o", str(program)], check=True, timeout=120)
        text = subprocess.run(
            [wine, str(program), "40"], check=True, capture_output=True, text=True, timeout=120
        ).stdout
        assert "dead band found: 0.045" in text


@pytest.mark.slow
def test_the_arm_library_is_for_arm(exported, tmp_path):
    """libhexsim_adaptive.so for aarch64: an ELF file of that machine, with the header's functions in its table of names."""
    export_compensator("adaptive", "aarch64-linux", tmp_path, CONTEXT)
    content = (tmp_path / "libhexsim_adaptive.so").read_bytes()
    assert content[:5] == b"\x7fELF\x02" and int.from_bytes(content[18:20], "little") == 183  # EM_AARCH64
    assert all(name.encode() + b"\0" in content for name in FUNCTIONS)


def test_settings_that_no_machine_has_are_refused(exported):
    """init says which number: not finite, or not above zero; too many taps, which the state has no room for."""
    library = ctypes.CDLL(str(exported / "libhexsim_adaptive.so"))
    state = np.zeros(library.hexsim_adaptive_state_size())
    good = empty(SETTINGS)
    for name in SETTINGS.names or ():
        good[name] = getattr(compensation.create("adaptive").inner, name, getattr(CONTEXT, name, None))
    cases = [("stroke_m", math.nan), ("tick_s", 0.0), ("area_ratio", -1.0), ("damping_count", 17.0), ("", 0.0)]
    for name, value in cases:
        settings = good.copy()
        if name:
            settings[name] = value
        numbers = np.frombuffer(settings.tobytes())
        refused = library.hexsim_adaptive_init(ctypes.c_void_p(state.ctypes.data), ctypes.c_void_p(numbers.ctypes.data))
        assert refused == (1 + (SETTINGS.names or ()).index(name) if name else 0)


def test_a_short_preview_counts_as_none(exported):
    """3 setpoints do not reach as far as is looked ahead: the volts are those of a preview of 1."""
    native = compensation.create(str(exported / "libhexsim_adaptive.so"))
    samples = recorded(8.0)
    short = [replace(sample, preview_m=sample.preview_m[:3]) for sample in samples]
    none = [replace(sample, preview_m=sample.preview_m[:1]) for sample in samples]
    found = volts(native, short)
    assert max(map(abs, found[0][:-1])) > 0.01
    assert found == volts(native, none)


def test_learned_numbers_go_into_the_header():
    """The array has the parameters in the order of their places."""
    made = compensation.create("adaptive")
    parameters = made.parameters(made.start(CONTEXT))
    parameters["friction"]["half_step_Pa"] = 54321.5
    text = header("adaptive", CONTEXT, parameters)
    array = re.search(r"hexsim_adaptive_learned\[\d+\] = \{([^}]*)\}", text)
    names = re.search(r"Places in `parameters`. \*/\nenum \{([^}]*)\}", text)
    assert array and names
    numbers, places = ([part.strip() for part in found[1].split(",")] for found in (array, names))
    assert len(numbers) == len(places) == LEARNED.itemsize // 8
    assert float(numbers[places.index("HEXSIM_ADAPTIVE_LEARNED_FRICTION_HALF_STEP_PA")]) == 54321.5


def test_what_cannot_be_exported_is_refused(tmp_path):
    """Another compensator, another target, a learned.json that is none, a library that is none: one sentence each."""
    with pytest.raises(HexsimError, match="'buffered' cannot be exported as native code"):
        export_compensator("buffered", "x86_64-linux", tmp_path, CONTEXT)
    with pytest.raises(HexsimError, match="target 'vax' is unknown"):
        export_compensator("adaptive", "vax", tmp_path, CONTEXT)
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
    with pytest.raises(ValueError, match="is no exported compensator of this system"):
        compensation.create(str(tmp_path / "none.so")).start(CONTEXT)
