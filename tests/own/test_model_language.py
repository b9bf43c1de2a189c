"""The language of model.toml: formulas that are data, states, elements with a memory, friction at rest."""

import json
import tomllib

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.own import simulate
from hexsim.own.declaration import ModelTables
from hexsim.own.model import model_of
from hexsim.signals.log import Log

HOSTILE = [
    "__import__('os').system('true')",
    "(lambda: 1)()",
    "[x for x in x]",
    "x.real",
    "x[0]",
    "'a' * 9",
    "f'{x}'",
    "(y := 3)",
    "x if x else x",
    "1e999",
    "x and x",
    "x < 1",
    "exec(x)",
    "abs(x, x)",
    "abs(x=1)",
    "abs(*x)",
    "not x",
    "~x",
    "True",
    "None",
    "1j",
    "x @ x",
    "x // 2",
    "(" * 150 + "x" + ")" * 150 + "+",
    "+".join("x" * 1500),
    "-" * 3000 + "x",
    "x" * 5000,
    "",
    "9" * 400,
    "await x",
    "x\n; x",
    "...",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_a_formula_is_data_and_nothing_else(text):
    """Whatever is no arithmetic of names and numbers, or is too large, is refused in one sentence that says where."""
    with pytest.raises(HexsimError, match=r"model\.toml \[states\.x\]: [^\n]*$"):
        model(f'[states.x]\nrate = {json.dumps(text)}\n[outputs.x]\nformula = "x"')


def model(text: str, columns: set[str] | None = None):
    return model_of(ModelTables.model_validate(tomllib.loads(text)), "model.toml", columns)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[states.x]\nrate = 'y'\n[constants]\ny = 'z'\nz = 'y'", "circle"),
        ("[states.x]\nrate = 'y'\n[outputs.x]\nformula = 'x'", "no column"),
        ("[states.abs]\nrate = '1'", "cannot be a name"),
        ("[states.x]\nrate = '1'\n[parameters.x]\nstart = 1.0", "name it once"),
        ("[states.x]\nrate = '1 / 0'", "division by 0"),
        ("[states.x]\nrate = '1'\nsum = '1'", "not both"),
        ("[parameters.k]\nlow = 2.0\nhigh = 1.0\n[states.x]\nrate = 'k'", "nothing is between"),
        ("[parameters.k]\nstart = -1.0\nsign = 1\n[states.x]\nrate = 'k'", "outside"),
        ("[states.x]\nrate = '1'\n[memory.m]\nkind = 'magic'\nof = 'x'", "no kind of memory"),
        ("[states.x]\nrate = '1'\n[memory.m]\nkind = 'lag'\nof = 'x'", "time_s is missing"),
        ("[constants]\na = 1.0", "states"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(text, said):
    """Circles, unknown names, double names, empty intervals, wrong keys."""
    with pytest.raises(HexsimError, match=said):
        model(text, {"u"})


def log(n: int, dt: float, **columns) -> Log:
    return Log(
        name="run",
        kind="own",
        time=np.arange(n) * dt,
        columns={key: np.asarray(v, dtype=float) for key, v in columns.items()},
    )


OSCILLATOR = """
[states.x]
rate = "v"
start = 1.0
[states.v]
rate = "-4.0 * x"
[outputs.x]
formula = "x"
[simulation]
steps = {steps}
scheme = "{scheme}"
"""


@pytest.mark.parametrize(("scheme", "order"), [("rk4", 4), ("heun", 2), ("euler", 1)])
def test_a_scheme_has_its_order(scheme, order):
    """Error against cos(2 t) falls by 2^order when the step is halved."""
    errors = []
    for steps in (2, 4):
        made = model(OSCILLATOR.format(steps=steps, scheme=scheme))
        run = log(101, 0.1, x=np.zeros(101))
        free = simulate.Simulator(made).run(simulate.record_of(made, run, "here"), np.zeros(0))
        errors.append(np.abs(free.outputs[:, 0] - np.cos(2.0 * run.time)).max())
    assert 0.75 * 2**order < errors[0] / errors[1] < 1.35 * 2**order


BLOCK = """
[parameters.coulomb]
start = 2.0
sign = 1
[parameters.mass]
start = 0.5
sign = 1
[states.x]
rate = "v"
[states.v]
sum = "force"
storage = "mass"
dry = ["coulomb"]
[outputs.x]
formula = "x"
[simulation]
steps = 4
"""


@pytest.fixture(scope="module")
def block():
    made = model(BLOCK)
    return made, simulate.Simulator(made)


def test_friction_holds_at_rest_and_stops_what_slides(block):
    """Below the Coulomb force nothing moves, exactly. A block pushed with 5 N for 1 s against 2 N stops after it has slid
    a t^2/2 and then v^2/(2 F/m): 3 m + 4.5 m at 0.5 kg; then it stays."""
    made, simulator = block
    force = np.where(np.arange(5000) < 1000, 1.99, np.where(np.arange(5000) < 2000, 5.0, 0.0))
    free = simulator.run(
        simulate.record_of(made, log(5000, 1e-3, force=force, x=0 * force), "here"), np.array([2.0, 0.5])
    )
    x = free.outputs[:, 0]
    assert np.all(x[:1000] == 0.0)
    assert x[-1] == pytest.approx(3.0 + 4.5, rel=2e-3)  # 1 ms of a ramp between two samples
    assert np.all(x[-500:] == x[-1])


def test_derivatives_carry_over_reversals_with_dry_friction(block):
    """Slopes by mass and by friction are those of finite differences, over motion with twelve reversals and rests."""
    made, simulator = block
    t = np.arange(6000) * 1e-3
    record = simulate.record_of(made, log(6000, 1e-3, force=4.0 * np.sin(2 * np.pi * t), x=0 * t), "here")
    p = np.array([1.0, 0.5])
    free = simulator.run(record, p, slopes=True)
    for k in range(2):
        ahead, behind = p.copy(), p.copy()
        ahead[k] += 1e-3
        behind[k] -= 1e-3
        difference = (simulator.run(record, ahead).outputs - simulator.run(record, behind).outputs)[:, 0] / 2e-3
        assert np.abs(free.slopes[:, 0, k] - difference).max() < 0.02 * np.abs(difference).max()


ELEMENTS = """
[parameters.gap]
start = 0.4
[parameters.tau]
start = 0.2
[parameters.late]
start = 0.03
[signals.late_u]
delay = "late"
[memory.play]
kind = "backlash"
of = "u"
width = "gap"
[memory.smooth]
kind = "lag"
of = "u"
time_s = "tau"
[memory.band]
kind = "dead_band"
of = "u"
lower = -0.2
upper = "0.5 * gap"
[memory.bristle]
kind = "dahl"
of = "rate_u"
coulomb = 3.0
stiffness = "3.0 / 0.05"
[memory.stribeck]
kind = "lugre"
of = "rate_u"
coulomb = 3.0
static = 5.0
stribeck = 0.5
stiffness = 100.0
[memory.loop]
kind = "bouc_wen"
of = "rate_u"
alpha = 1.0
gamma = 2.0
delta = 1.0
[memory.slow]
kind = "rate_limit"
of = "u"
most = 1.0
[memory.warm]
kind = "warm_up"
of = "1"
time_s = "tau"
[outputs.play]
formula = "play"
[outputs.smooth]
formula = "smooth"
[outputs.band]
formula = "band"
[outputs.bristle]
formula = "bristle"
[outputs.stribeck]
formula = "stribeck"
[outputs.loop]
formula = "loop"
[outputs.slow]
formula = "slow"
[outputs.warm]
formula = "warm"
[outputs.late]
formula = "late_u"
[outputs.everything]
formula = "first_half + min(u, gap) + max(u, 0.1) + abs(u + 2)**tau + sign(u) + step(u) / 3"
[constants]
first_half = "sqrt(abs(u)) + root(u) + exp(-u**2) + tanh(u) * log(2 + u) + sin(u) * cos(u)"
"""


@pytest.fixture(scope="module")
def elements():
    made = model(ELEMENTS)
    n, dt = 4000, 1e-3
    t = np.arange(n) * dt
    u, rate = np.sin(2 * np.pi * t), 2 * np.pi * np.cos(2 * np.pi * t)
    record = simulate.record_of(made, log(n, dt, u=u, rate_u=rate, late_u=u), "here")
    simulator = simulate.Simulator(made)
    p = np.array([0.4, 0.2, 0.03])
    free = simulator.run(record, p, slopes=True)
    return t, u, rate, dict(zip(made.outputs, free.outputs.T, strict=True)), (made, simulator, record, p, free)


def test_elements_do_what_their_equations_say(elements):
    """Play: half the width behind. Lag: amplitude and phase of 1/(1 + i w tau). Dead band: both edges. Dahl: +-Fc when it slides. LuGre:
    Fc + (Fs - Fc) exp(-(v/vs)^2) in sliding. Bouc-Wen: within +-alpha/(gamma + delta). Rate limit: never faster. Delay: earlier input."""
    t, u, rate, y, _ = elements
    late = t > 2.0
    assert np.abs(y["play"] - u).max() == pytest.approx(0.2, rel=1e-6)
    w = 2 * np.pi
    assert y["smooth"][late].max() == pytest.approx(1 / np.hypot(1, w * 0.2), rel=2e-3)
    assert y["band"].max() == pytest.approx(0.8, abs=1e-5) and y["band"].min() == pytest.approx(-0.8, abs=1e-5)
    sliding = late & (np.abs(u) < 0.3) & (np.abs(rate) > 5)
    assert y["bristle"][sliding] == pytest.approx(3.0 * np.sign(rate[sliding]), abs=0.02)
    assert y["stribeck"][sliding] == pytest.approx(
        3.0 * np.sign(rate[sliding]), abs=0.02
    )  # 10 Stribeck speeds: 3 N are left
    assert 0.25 < np.abs(y["loop"]).max() <= 1 / 3 + 1e-6
    assert np.abs(np.diff(y["slow"])).max() <= 1e-3 * (1 + 1e-9)
    assert y["warm"] == pytest.approx(1 - np.exp(-t / 0.2), abs=1e-6)
    assert y["late"][100:] == pytest.approx(np.sin(2 * np.pi * (t[100:] - 0.03)), abs=1e-5)


def test_derivatives_of_elements_are_those_of_finite_differences(elements):
    """By the width of a play, a time constant and a delay, for every output."""
    *_, (made, simulator, record, p, free) = elements
    for k in range(3):
        ahead, behind = p.copy(), p.copy()
        ahead[k] += 1e-5
        behind[k] -= 1e-5
        difference = (simulator.run(record, ahead).outputs - simulator.run(record, behind).outputs) / 2e-5
        for j, name in enumerate(made.outputs):
            off = np.abs(free.slopes[:, j, k] - difference[:, j])
            assert np.quantile(off, 0.99) < 1e-3 * (1.0 + np.abs(difference[:, j]).max()), (
                name
            )  # 1 %: at edges either side holds


def test_free_runs_begin_anew_where_the_file_asks():
    """anew_s = 1 parts 3.5 s into three free runs; each begins at the sample that was measured there, and time goes on."""
    text = "[states.x]\nrate = '-x'\nstart = 'first(x)'\n[outputs.x]\nformula = 'x'\n[simulation]\nanew_s = 1.0"
    made, run = model(text), log(350, 0.01, x=np.linspace(1.0, 4.5, 350))
    found = simulate.records_of(made, run, "here")
    assert [record.n for record in found] == [100, 100, 150]
    simulator = simulate.Simulator(made)
    for record, at in zip(found, (0, 100, 200), strict=True):
        assert simulator.run(record, np.zeros(0)).outputs[0, 0] == run.columns["x"][at]
        assert record.time[0] == pytest.approx(0.01 * at)
