"""A foreign FMU as payload and as setpoint: one that this test compiles, a spring, against the library's effect `spring`."""

import inspect
import os
import re
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import hexsim as hx
from hexsim import HexsimError, load_scenario
from hexsim.foreign_fmu import ALLOWED
from hexsim.machine.files import changed
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import payload_fmu, simulate

pytest.importorskip("ziglang", reason="the test compiles an FMU: pip install hexsim[fmu]")
fmpy = pytest.importorskip("fmpy", reason="FMPy runs the FMU: pip install hexsim[fmu]")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the FMU is compiled for Linux")

SOURCE = """
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
typedef unsigned R;
static double *new(void) { return calloc(3, sizeof(double)); } /* place; after a step minus the place, and t^2 */
static int get(double *c, const R r[], size_t n, double v[]) { for (size_t k = 0; k < n; k++) v[k] = c[r[k]]; return 0; }
static int set(double *c, const R r[], size_t n, const double v[]) { for (size_t k = 0; k < n; k++) c[r[k]] = v[k]; return 0; }
static int step(double *c, double t) { c[1] = -c[0], c[2] = t * t; return c[0] > 10 ? 3 : 0; }
#if FMI == 2
#define F(name) fmi2##name
void *F(Instantiate)(const char *a, int b, const char *c, const char *d, const void *e, int f, int g) { return new(); }
int F(SetupExperiment)(void *c, int a, double b, double t, int d, double e) { return 0; }
int F(EnterInitializationMode)(void *c) { return 0; }
int F(GetReal)(void *c, const R r[], size_t n, double v[]) { return get(c, r, n, v); }
int F(SetReal)(void *c, const R r[], size_t n, const double v[]) { return set(c, r, n, v); }
int F(DoStep)(void *c, double t, double h, int a) { return step(c, t + h); }
#else
#define F(name) fmi3##name
void *F(InstantiateCoSimulation)(const char *a, const char *b, const char *c, char d, char e, char f, char g, const R *h,
                                 size_t i, void *j, void *k, void *l) { return new(); }
int F(EnterInitializationMode)(void *c, char a, double b, double t, char d, double e) { return 0; }
int F(GetFloat64)(void *c, const R r[], size_t n, double v[], size_t m) { return get(c, r, n, v); }
int F(SetFloat64)(void *c, const R r[], size_t n, const double v[], size_t m) { return set(c, r, n, v); }
int F(DoStep)(void *c, double t, double h, char a, char *b, char *d, char *e, double *last) {
  *b = *d = *e = 0, *last = t + h;
  return step(c, t + h);
}
#endif
int F(ExitInitializationMode)(void *c) { return 0; }
int F(SetDebugLogging)(void *c, int on, size_t n, const char *k[]) { return 0; }
int F(Terminate)(void *c) { return 0; }
void F(FreeInstance)(void *c) { free(c); }
"""
DESCRIPTION = {
    2: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="spring" guid="1"><CoSimulation modelIdentifier="spring"/><ModelVariables>
<ScalarVariable name="place" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="pull" valueReference="1" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="square" valueReference="2" causality="output"><Real/></ScalarVariable></ModelVariables>
<ModelStructure><Outputs><Unknown index="2"/><Unknown index="3"/></Outputs></ModelStructure></fmiModelDescription>""",
    3: """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="spring" instantiationToken="1"><CoSimulation modelIdentifier="spring"/>
<ModelVariables><Float64 name="place" valueReference="0" causality="input" start="0"/>
<Float64 name="pull" valueReference="1" causality="output"/>
<Float64 name="square" valueReference="2" causality="output"/>
<Float64 name="time" valueReference="9" causality="independent"/></ModelVariables>
<ModelStructure><Output valueReference="1"/><Output valueReference="2"/></ModelStructure></fmiModelDescription>""",
}
STIFFNESS = 2000.0  # [N/m]


@pytest.fixture(scope="module", params=(2, 3))
def spring(request, tmp_path_factory):
    """An FMU whose output `pull` is minus its input `place`."""
    return compiled_fmu(tmp_path_factory.mktemp("spring"), request.param, SOURCE)


def compiled_fmu(folder, fmi, source):
    folder.mkdir(exist_ok=True)
    wanted = set(re.findall(rf'"(fmi{fmi}[A-Z]\w+)"', inspect.getsource(fmpy.fmi2 if fmi == 2 else fmpy.fmi3)))
    others = wanted - {f"fmi{fmi}{name}" for name in re.findall(r"F\((\w+)\)", source)}
    (folder / "spring.c").write_text(source + "".join(f"int {name}(void) {{ return 3; }}\n" for name in others))
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        "x86_64-linux-gnu.2.17",
        "-shared",
        "-fPIC",
        "-O2",  # as the export compiles: without, zig builds a checking library first (25 s)
        "-s",
        f"-DFMI={fmi}",
    ]
    subprocess.run(
        [*command, "-o", str(folder / "spring.so"), str(folder / "spring.c")],
        check=True,
        capture_output=True,
        env=os.environ | {"ZIG_LOCAL_CACHE_DIR": str(folder / "cache")},
    )
    place = {2: "linux64", 3: "x86_64-linux"}[fmi]
    with zipfile.ZipFile(folder / "spring.fmu", "w") as archive:
        archive.write(folder / "spring.so", f"binaries/{place}/spring.so")
        archive.writestr("modelDescription.xml", DESCRIPTION[fmi])
    return folder / "spring.fmu"


def heave(machine, interventions=()):
    scenario = replace(load_scenario("heave"), duration_s=3.0)
    return simulate(machine, scenario, interventions=interventions).log


def test_a_spring_as_fmu_is_the_spring_of_the_library(spring, bench):
    """The piston's path with the FMU against that with the effect: what a late tick leaves is below 2 % of the effect."""
    connected = payload_fmu.parse_connections(["position_m=place", f"force_N=pull*{STIFFNESS}"])
    payload = payload_fmu.PayloadFmu(spring, connected, has_platform=False, allow_native=True)
    preload = 0.5 * bench.cylinder.stroke_m * STIFFNESS  # the library's spring rests at half stroke
    with_effect = changed(bench, {"effects.spring.stiffness_N_m": STIFFNESS})
    held = changed(bench, {"effects.constant_force.force_N": preload})
    found, wanted, without = heave(held, [payload]), heave(with_effect), heave(bench)
    later = found["time_s"].to_numpy() > 1.0  # the FMU's force is not in the static equilibrium at the start
    size = np.abs(wanted["true_position_m"] - without["true_position_m"]).to_numpy()[later].max()
    left = np.abs(found["true_position_m"] - wanted["true_position_m"]).to_numpy()[later].max()
    assert size > 1e-5
    assert left < 0.02 * size


def test_a_payload_on_a_platform_pushes_where_it_should(spring, hexapod):
    """A force along x at the platform's origin from an FMU whose input is height: the legs' forces change by its share."""
    connected = payload_fmu.parse_connections(["platform_z_m=place", "force_x_N=pull*1e4", "moment_z_N_m=pull*1e4"])
    payload = payload_fmu.PayloadFmu(spring, connected, has_platform=True, allow_native=True)
    scenario = replace(load_scenario("heave"), duration_s=1.0)
    found = simulate(hexapod, scenario, fast=True, interventions=[payload]).log
    without = simulate(hexapod, scenario, fast=True).log
    moved = np.abs(found["platform_x_m"] - without["platform_x_m"]).max()
    turned = np.abs(found["platform_yaw_rad"] - without["platform_yaw_rad"]).max()
    assert moved > 1e-5
    assert turned > 1e-5


def test_what_is_not_connected_is_said(spring, tmp_path):
    """No output by a name of a load; a name that neither has; text that is no connection; a file that is no FMU."""
    with pytest.raises(
        HexsimError, match="gives none of force_N: name an output for it with --connect, as force_N=theirs"
    ):
        payload_fmu.PayloadFmu(spring, {}, has_platform=False, allow_native=True)
    with pytest.raises(HexsimError, match=r"spring\.fmu: there is no push; there are place, pull"):
        payload_fmu.PayloadFmu(
            spring, payload_fmu.parse_connections(["force_N=push"]), has_platform=False, allow_native=True
        )
    with pytest.raises(HexsimError, match="there is no force_x_N; there are position_m, velocity_m_s"):
        payload_fmu.PayloadFmu(
            spring, payload_fmu.parse_connections(["force_x_N=pull"]), has_platform=False, allow_native=True
        )
    with pytest.raises(HexsimError, match=r"'force_N' is not OURS=THEIRS"):
        payload_fmu.parse_connections(["force_N"])
    (tmp_path / "no.fmu").write_text("no")
    with pytest.raises(HexsimError, match=r"payload no\.fmu fails while it is unpacked: BadZipFile"):
        payload_fmu.PayloadFmu(tmp_path / "no.fmu", {}, has_platform=False, allow_native=True)


def test_a_payload_that_fails_at_once_is_a_sentence(spring, bench):
    """Before anything was simulated there is no log to keep."""
    payload = payload_fmu.PayloadFmu(
        spring,
        payload_fmu.parse_connections(["position_m=place*1e6", "force_N=pull"]),
        has_platform=False,
        allow_native=True,
    )
    with pytest.raises(HexsimError, match=r"payload spring\.fmu fails while it steps from 0 s: "):
        heave(bench, [payload])


def test_a_payload_that_fails_ends_the_run_with_its_log(spring, bench):
    """An FMU that returns an error: the run is incomplete and says which payload."""
    factor = 10 / (bench.cylinder.stroke_m / 2 + 0.03)  # it fails where its input passes 10
    connected = payload_fmu.parse_connections([f"position_m=place*{factor}", "force_N=pull*1e-6"])
    scenario = replace(load_scenario("heave"), duration_s=3.0)
    run = simulate(
        bench,
        scenario,
        interventions=[payload_fmu.PayloadFmu(spring, connected, has_platform=False, allow_native=True)],
    )
    assert not run.complete
    assert run.log.height > 100
    assert "payload spring.fmu" in run.reason


def test_an_output_of_an_fmu_is_a_setpoint(spring, bench):
    """t^2 by an FMU, times 0.01: value and slope between its steps; a run is commanded so, and keeps the FMU in its scenario."""
    table = {"kind": "fmu", "path": str(spring), "column": "square", "factor": 0.01, "duration_s": 2.0}
    scenario = scenario_from_dict(
        {"name": "square", "mode": "dof", "duration_s": 1.0, "fade_s": 0.0, "axes": {"z": table}},
        allow_native=True,
    )
    signal, t = scenario.signals["z"], np.arange(0.1, 1.9, 0.0137)
    assert signal.value(t) == pytest.approx(0.01 * t**2, abs=1e-9)
    assert signal.velocity(t) == pytest.approx(0.02 * t, abs=1e-6)
    assert signal.value(9.0) == pytest.approx(0.04, abs=1e-9)
    log = simulate(bench, scenario, fast=True).log
    rest = log["setpoint_m"][0]
    held = np.floor(log["time_s"].to_numpy() * 500 + 1e-6) / 500
    assert log["setpoint_m"].to_numpy() - rest == pytest.approx(0.01 * held**2, abs=1e-8)
    with pytest.raises(HexsimError, match=r"has no output 'cube': its outputs are pull, square"):
        scenario_from_dict({"name": "c", "mode": "dof", "axes": {"z": table | {"column": "cube"}}}, allow_native=True)
    with pytest.raises(HexsimError, match=r"there is no FMU none\.fmu"):
        scenario_from_dict({"name": "c", "mode": "dof", "axes": {"z": table | {"path": "none.fmu"}}}, allow_native=True)


def test_native_code_runs_only_when_it_is_allowed(spring, tmp_path, monkeypatch):
    """An FMU in a scenario's file, as a setting and as a payload: refused in a sentence that names the option, before any of
    it runs; a scenario's file cannot allow itself; what allows it in Python is an argument."""
    table = {"kind": "fmu", "path": str(spring), "column": "square", "duration_s": 0.5}
    tables = {"name": "c", "mode": "dof", "axes": {"z": table}}

    def refused(run):
        monkeypatch.setattr("subprocess.Popen", None)
        with pytest.raises(HexsimError, match=r"spring\.fmu is native code.*--allow-native"):
            run()
        monkeypatch.undo()

    refused(lambda: scenario_from_dict(tables))
    refused(lambda: payload_fmu.PayloadFmu(spring, {}, has_platform=False))
    refused(lambda: hx.run("heave", "bench", set={"scenario.axes.z": table}))
    with pytest.raises(HexsimError, match="allow_native is not a known key"):
        scenario_from_dict(tables | {"axes": {"z": table | {"allow_native": True}}})
    allowed = scenario_from_dict(tables, allow_native=True)
    assert allowed.allow_native and "allow_native" not in allowed.to_dict()["axes"]["z"]
    assert hx.run(allowed, "bench", set={"scenario.fade_s": 0.1, "scenario.duration_s": 0.01}).scenario.fade_s == 0.1


BAD = {
    "hang": ("for (;;) pause();", r"takes longer than 0\.5 s while it steps"),
    "spin": ("for (;;);", r"takes longer than 0\.5 s while it steps"),
    "exit": ("_exit(0);", r"ends its process \(exit code 0\) while it steps"),
    "crash": ("*(volatile int *)0 = 1;", r"ends its process \(signal SIGSEGV\) while it steps"),
    "leak": ("for (;;) *(volatile char *)malloc(1 << 28) = 1;", r"ends its process \(signal SIGSEGV\) while it steps"),
    "huge": ("c[1] = 1e300;", r"gives force_N = 1e\+300: -1e\+08 to 1e\+08 is possible"),
}


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    """An FMU without force that does what BAD_KIND says from BAD_FROM [s] on."""
    cases = "".join(
        f'if (t >= atof(getenv("BAD_FROM")) && !strcmp(getenv("BAD_KIND"), "{name}")) {{ {does} }}\n'
        for name, (does, _) in BAD.items()
    )
    return compiled_fmu(
        tmp_path_factory.mktemp("bad"), 2, SOURCE.replace("c[1] = -c[0], c[2] = t * t;", f"c[1] = 0; {cases}")
    )


@pytest.mark.parametrize(
    ("kind", "late"),
    [
        *((kind, True) for kind in BAD),
        ("crash", False),  # the others end the first step as they end a later one
        *(pytest.param(kind, False, marks=pytest.mark.slow) for kind in BAD if kind != "crash"),
    ],
)
def test_what_an_fmu_does_to_itself_stays_its_own(bad, kind, late, tmp_path, monkeypatch, bench):
    """An FMU that hangs, spins, exits, crashes, takes all memory or gives a force outside physics, in its first step or
    later: one sentence, the log so far is kept, and neither a process nor a folder of it stays."""
    monkeypatch.setattr("hexsim.foreign_fmu.ALLOWED", ALLOWED._replace(step_s=0.5))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("BAD_KIND", kind)
    monkeypatch.setenv("BAD_FROM", "0.25" if late else "0")
    payload = payload_fmu.PayloadFmu(
        bad, payload_fmu.parse_connections(["force_N=pull"]), has_platform=False, allow_native=True
    )
    process = payload._fmu._process
    scenario = replace(load_scenario("heave"), duration_s=0.5)
    if late:
        run = simulate(bench, scenario, interventions=[payload])
        assert not run.complete and re.search(BAD[kind][1], run.reason)
        assert 0.2 < run.log["time_s"][-1] < 0.3
    else:
        with pytest.raises(HexsimError, match=BAD[kind][1]):
            simulate(bench, scenario, interventions=[payload])
    payload._fmu.close()
    assert process.poll() is not None
    assert list(tmp_path.iterdir()) == []
