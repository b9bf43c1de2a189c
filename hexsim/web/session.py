"""The machine behind the page: one thread that simulates at real time at most, and takes over what the sliders ask."""

from __future__ import annotations

import shlex
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from compensation import Knowledge
from hexsim.compiled import seconds_compiled
from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.plant.plant import PlantError
from hexsim.scenarios import Scenario
from hexsim.scenarios.settings import machine_in
from hexsim.simulation.live import LiveMachine
from hexsim.simulation.recent_motion import MotionFigures, RecentMotion, motion_figures
from hexsim.simulation.stream import Stream
from hexsim.web.knobs import Wave, machine_with, settings_of, wave_of, waves

FRAME_S = 1.0 / 30.0  # of a page
CUT = "The motion asks for more than the strokes: it is cut at their ends."
STOP_S = 1.0  # for a frame or a tick to end


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the page asks for: values of the sliders by name, a motion by name with its size, a compensator."""

    knobs: Mapping[str, float] = field(default_factory=dict)
    motion: str
    amplitude: float | None = None  # mm or deg; None: as the scenario says, as for one that is no sine
    frequency_Hz: float | None = None
    compensator: str = "none"


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What the page shows: figures of what was asked, and those before the last change; None where there are none yet."""

    asked: Asked
    figures: MotionFigures | None = None
    before: MotionFigures | None = None
    time_s: float = 0.0
    speed: float = 1.0  # simulated over real time
    error: str = ""
    known: tuple[Knowledge | None, ...] = ()  # by each leg's compensator
    warnings: tuple[str, ...] = ()  # of cavitation since the machine was built, the last ones


class Session:
    """A machine that runs until `stop`. The page calls `ask` and `shown` from its threads; `on_frame(live)` is called in
    the simulating one.

    Sliders of the hydraulics take effect at once, and so do motion and compensator; another load builds the machine
    anew, which takes a moment. Raises HexsimError for a machine or motion that cannot run at all.
    """

    def __init__(
        self, machine: Machine, scenario: Scenario, compensator: str = "none", stream: Stream | None = None
    ) -> None:
        self.declared = machine_in(scenario, machine)
        self.waves = waves(self.declared)
        own = wave_of(scenario) if scenario.mode == "dof" else None
        if own is not None:
            self.waves[scenario.name] = own
        self.scenario = scenario
        self.asked = Asked(
            motion=scenario.name,
            compensator=compensator,
            amplitude=own.amplitude if own else None,
            frequency_Hz=own.frequency_Hz if own else None,
        )
        self._lock = threading.Lock()  # of machine and recent motion
        self._wanted = self._handled = self._present = self.asked
        self._recent, self._stream = RecentMotion(), stream
        self.live = self._made(self.declared, scenario, compensator)
        self._since_s = self._settled_from()
        self._shown, self._error, self._speed = Shown(asked=self.asked), "", 1.0
        self._stop = threading.Event()
        self._earlier: list[str] = []  # warnings of machines that were replaced
        self._thread: threading.Thread | None = None
        self.paused = False

    def _made(self, machine: Machine, scenario: Scenario, compensator: str) -> LiveMachine:
        return LiveMachine(machine, scenario, compensator, observe=self._recent.note, stream=self._stream)

    @property
    def motions(self) -> list[str]:
        """Names that `Asked.motion` may have."""
        return list(dict.fromkeys([self.scenario.name, *self.waves]))

    def start(self, on_frame: Callable[[LiveMachine], None] = lambda live: None) -> None:
        """Simulate from now on."""
        self._thread = threading.Thread(target=self._run, args=(on_frame,), name="simulation", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the simulation and wait for it; not for a machine that is being built, whose thread ends with the process."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=STOP_S)
        self.live.cavitation.end()

    def new_warnings(self) -> list[str]:
        """Since the last call, of the machines that were built; after `stop` those that were still open."""
        earlier, self._earlier = self._earlier, []
        return earlier + self.live.cavitation.unsaid()

    def ask(self, asked: Asked) -> None:
        """Take effect at the next frame; what comes more often is taken together."""
        self.asked = self._wanted = asked

    def _run(
        self,
        on_frame: Callable[[LiveMachine], None],
        *,
        longest_s: float = 0.1,  # a computer that is slower than real time shows slow motion instead of standing still
    ) -> None:
        last = time.perf_counter()
        while not self._stop.is_set():
            now, compiled_s = time.perf_counter(), seconds_compiled()
            due, last = min(now - last, longest_s), now
            with self._lock:
                if self._wanted is not self._handled:
                    self._take_over(self._wanted)
                if not self.paused:
                    self._advance(due)
            on_frame(self.live)
            took = time.perf_counter() - now - (seconds_compiled() - compiled_s)
            self._speed = min(1.0, due / took) if took > FRAME_S else 1.0
            self._stop.wait(max(0.0, FRAME_S - took))

    def _advance(self, due: float) -> None:
        try:
            self.live.advance(due)
        except PlantError as error:
            self._error = f"The simulation diverged ({error}); it began anew."
            self._restart()

    def _restart(self) -> None:
        self._recent.forget()
        self.live.reset()
        self._since_s = self._settled_from()

    def push(self) -> None:
        """Put 100 kg on for a second."""
        with self._lock:
            self.live.push()

    def begin_again(self) -> None:
        """From neutral, at rest; a compensator forgets what it has learned."""
        with self._lock:
            self.live.use_compensator(self._present.compensator)
            self._restart()

    def _take_over(self, wanted: Asked) -> None:
        """Change what differs; where that cannot be, keep the machine and say why."""
        self._handled = wanted
        if self._shown.figures is not None:
            self._shown = replace(self._shown, before=self._shown.figures, figures=None)
        try:
            self._change(self._present, wanted)
            self._present, self._error = wanted, ""
        except HexsimError as error:
            self._error = str(error)
        self._since_s = self._settled_from()

    def _change(self, present: Asked, wanted: Asked) -> None:
        scenario = self.motion_of(wanted)
        if wanted.knobs != present.knobs:
            machine = machine_with(self.declared, wanted.knobs)
            if not self.live.become(machine):
                built = self._made(machine, scenario, wanted.compensator)
                self.live.cavitation.end()
                self._earlier += self.live.cavitation.unsaid()
                self.live = built
                self._recent.forget()
                return
        if scenario != self.live.motion.scenario:
            self.live.use_scenario(scenario)
        if wanted.compensator != present.compensator:
            self.live.use_compensator(wanted.compensator)

    def motion_of(self, asked: Asked) -> Scenario:
        """The scenario that is asked for."""
        if asked.motion not in self.waves or asked.amplitude is None or asked.frequency_Hz is None:
            return self.scenario
        wave: Wave = replace(self.waves[asked.motion], amplitude=asked.amplitude, frequency_Hz=asked.frequency_Hz)
        return wave.built()

    def command(self, asked: Asked, machine_name: str, scenario_name: str) -> str:
        """What runs the same machine and motion without the page. Names: as `hexsim run` takes them."""
        motion = scenario_name if asked.motion == self.scenario.name else asked.motion
        words, wave = ["hexsim", "run", motion, "--machine", machine_name], self.waves.get(asked.motion)
        if wave is not None and asked.amplitude is not None:
            size = asked.amplitude if wave.unit[1] == "deg" else asked.amplitude * wave.unit[0]
            words += ["--amplitude", f"{size:g}", "--frequency", f"{asked.frequency_Hz:g}"]
        if asked.compensator != "none":
            words += ["-c", asked.compensator]
        for key, value in settings_of(self.declared, asked.knobs).items():
            words += ["--set", f"{key}={value:g}" if isinstance(value, float) else f"{key}={value}"]
        return shlex.join(words)

    def _settled_from(
        self,
        *,
        settle_s: float = 0.5,  # after a change, before the figures count
    ) -> float:
        """From when on the figures count, after a change now."""
        return max(self.live.motion.steady_s(), self.live.time_s) + settle_s

    def shown(self) -> Shown:
        """What is to be shown now; the figures are made here, beside the simulation."""
        with self._lock:
            live, since = self.live, self._since_s
            log, scenario = self._recent.log(live, since), live.motion.scenario
        figures = motion_figures(scenario, live.kinematics.axes, log) if scenario and log is not None else None
        with self._lock:
            if live is self.live and since == self._since_s:
                self._shown = replace(
                    self._shown,
                    asked=self._present,
                    figures=figures or self._shown.figures,
                    time_s=live.time_s,
                    speed=self._speed,
                    error=self._error or (CUT if live.out_of_reach else ""),
                    warnings=tuple(live.cavitation.told)[-3:],
                    known=live.loop.known,
                )
            return self._shown
