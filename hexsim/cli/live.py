"""`hexsim live`: the machine running, in MuJoCo's own viewer or on a page in the browser."""

from __future__ import annotations

import contextlib
import shlex
import threading
import time
from collections.abc import Iterator, Sequence
from enum import IntEnum
from queue import SimpleQueue
from typing import TYPE_CHECKING, Annotated

import typer

from hexsim.cli import completion, flown, options
from hexsim.cli.console import compiling_said, stop_when_signalled, terminated_like_interrupted
from hexsim.errors import HexsimError
from hexsim.packets import HOST_PORT

if TYPE_CHECKING:
    from hexsim.machine import Machine
    from hexsim.scenarios import Scenario
    from hexsim.simulation.live import LiveMachine
    from hexsim.simulation.stream import Stream
    from hexsim.web.machine_page import MachinePage

KEYS = "space pause   Enter 100 kg for 1 s   Backspace start again   ctrl + right mouse push   sliders: panel Control"


class Key(IntEnum):
    """Keys, as GLFW numbers them."""

    SPACE = 32
    ENTER = 257
    BACKSPACE = 259


def register(app: typer.Typer) -> None:
    app.command("live")(live)


def live(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="Motion to run; without it the sliders alone move the machine.", autocompletion=completion.scenarios
        ),
    ] = None,
    machine: options.MachineName = None,
    compensator: options.CompensatorName = "none",
    amplitude: options.Amplitude = None,
    frequency: options.Frequency = None,
    settings: options.Set = None,
    seconds: Annotated[float | None, options.EndAfter] = None,
    web: Annotated[bool, typer.Option("--web", help="A page for the browser, on this computer alone.")] = False,
    port: Annotated[int, typer.Option(min=1024, max=65535, help="Of the page; the next free one if taken.")] = 8080,
    source: flown.Source = None,
    washout: flown.WashoutName = "classical",
    listen: Annotated[
        str, typer.Option(help="Of --from: ADDRESS:PORT for the packets; only this computer unless you say otherwise.")
    ] = f"{flown.LOOPBACK}:{HOST_PORT}",
    stream: options.StreamTo = None,
    allow_native: options.AllowNative = False,
) -> None:
    """The machine running. In MuJoCo's viewer: a slider for each degree of freedom, pause, pushes by mouse or key.
    With --web: sliders for overlap, friction, spool, load, leak, delay and motion, and the bump as it becomes. With
    --web --from: a simulator flies; sliders for gain, smoothing and dead band, felt against flown acceleration."""
    if source and (scenario or not web):
        raise HexsimError("--from flies the machine on the page: give --web, and no scenario")
    if not source and washout != "classical":
        raise HexsimError("--washout acts on the packets of a simulator: give --from too")
    with_machine, what = options.prepare(
        scenario or "heave",
        options.Motion(machine=machine, amplitude=amplitude, frequency=frequency),
        settings,
        allow_native=allow_native,
    )
    looker = options.stream_of(stream)
    looking = contextlib.closing(looker) if looker else contextlib.nullcontext()
    with compiling_said(lambda text: typer.echo(text, err=True)), looking:
        name = machine or what.machine_name
        if source:
            fly(with_machine, source, washout, compensator, name, listen, port, seconds, looker)
            return
        if web:
            serve_page(with_machine, what, compensator, (name, scenario or "heave"), port, seconds, looker)
            return
        from hexsim.simulation.live import LiveMachine

        check_screen()
        show(LiveMachine(with_machine, what if scenario else None, compensator, stream=looker), seconds)


def serve_page(
    machine: Machine,
    scenario: Scenario,
    compensator: str,
    names: tuple[str, str],
    port: int,
    seconds: float | None,
    stream: Stream | None = None,
) -> None:
    """Serve the page until Ctrl-C, or for `seconds`. names: of machine and scenario, as typed."""
    with page_needed():
        from hexsim.web import Page, Session

    with terminated_like_interrupted():
        page = Page(Session(machine, scenario, compensator, stream), *names, port)
    show_page(page, seconds)


def fly(
    machine: Machine,
    source: str,
    washout: str,
    compensator: str,
    name: str,
    listen: str,
    port: int,
    seconds: float | None,
    stream: Stream | None = None,
) -> None:
    """Serve the page of a machine that a simulator flies. name: of the machine, as typed. listen: ADDRESS:PORT."""
    with page_needed():
        from hexsim.web import Flight, FlightPage
    from hexsim.cueing.washout import washout_of

    host, _, udp_port = listen.rpartition(":")
    if not host or not (udp_port.isascii() and udp_port.isdigit() and int(udp_port) < 2**16):
        raise HexsimError(f"--listen {listen!r}: give ADDRESS:PORT, as {flown.LOOPBACK}:{HOST_PORT}")
    words = ["hexsim", "serve", "--from", source, "--machine", name, "--host", host, "--port", udp_port]
    words += ["--washout", washout] if washout != "classical" else []
    words += ["-c", compensator] if compensator != "none" else []
    with terminated_like_interrupted():
        vehicle = flown.vehicle_of(source, strict=False)
        flight = Flight(machine, vehicle, washout_of(washout), compensator, host, int(udp_port), stream)
        page = FlightPage(flight, name, shlex.join(words), port)
    typer.echo(f"packets of {vehicle.name} on udp://{flight.address[0]}:{flight.address[1]}", err=True)
    show_page(page, seconds)


@contextlib.contextmanager
def page_needed() -> Iterator[None]:
    """HexsimError where the page's packages are not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise HexsimError(f"the page needs {error.name}: pip install 'hexsim[web]'") from None


def show_page(page: MachinePage, seconds: float | None) -> None:
    """Say the address and run, until Ctrl-C or for `seconds`."""
    with stop_when_signalled() as stop:  # before the address: whoever reads it may signal
        typer.echo(f"{page.address}   open it in a browser on this computer; Ctrl-C ends it", err=True)
        page.run(seconds, stop, warn)


def warn(sentences: Sequence[str]) -> None:
    """Each in a line of its own."""
    for text in sentences:
        typer.echo(f"warning: {text}", err=True)


def show(
    machine: LiveMachine,
    seconds: float | None = None,
    *,
    frame_s: float = 1.0 / 60.0,  # of a screen
    longest_s: float = 0.1,  # a computer that is slower than real time shows slow motion instead of standing still
    closing_s: float = 5.0,  # for the viewer's thread to end
) -> None:
    """Run the viewer until its window is closed, or for `seconds`."""
    from mujoco.viewer import launch_passive

    from hexsim.simulation.live import TOP_LEFT

    typer.echo(KEYS, err=True)
    pressed: SimpleQueue[int] = SimpleQueue()  # the window has its own thread; the machine is touched in this one only
    before = set(threading.enumerate())
    viewer = launch_passive(machine.model, machine.data, key_callback=pressed.put, show_left_ui=False)
    started = last = time.perf_counter()
    with viewer, stop_when_signalled() as stop:
        frame_camera(viewer.cam, machine)
        while (
            viewer.is_running() and not stop.is_set() and (seconds is None or time.perf_counter() - started < seconds)
        ):
            now = time.perf_counter()
            due, last = min(now - last, longest_s), now
            with viewer.lock():
                while not pressed.empty():
                    press(machine, pressed.get())
                machine.pull(viewer.perturb)
                machine.advance(due)
            warn(machine.cavitation.unsaid())
            took = time.perf_counter() - now
            viewer.set_texts((None, TOP_LEFT, *overlay(machine, due, took)))
            viewer.sync()
            time.sleep(max(0.0, frame_s - (time.perf_counter() - now)))
    machine.cavitation.end()
    warn(machine.cavitation.unsaid())
    for thread in set(threading.enumerate()) - before:  # the window's own: it must be gone before Python ends
        thread.join(timeout=closing_s)


def check_screen() -> None:
    """HexsimError where there is no screen; MuJoCo's viewer would end the process."""
    import warnings

    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not glfw.init():
            raise HexsimError(
                "there is no screen for MuJoCo's viewer here: run it on a computer with a display, or use `run`"
            )


def press(machine: LiveMachine, key: int) -> None:
    """Space pauses, Enter puts 100 kg on for a second, Backspace starts again (the viewer has taken the letters)."""
    if key == Key.SPACE:
        machine.paused = not machine.paused
    elif key == Key.ENTER:
        machine.push()
    elif key == Key.BACKSPACE:
        machine.reset()


def frame_camera(camera, machine: LiveMachine) -> None:
    """Look at the whole machine from the front left."""
    size = float(machine.model.stat.extent)
    camera.lookat[:] = machine.model.stat.center
    camera.distance, camera.azimuth, camera.elevation = 2.4 * size, 140.0, -18.0


def overlay(machine: LiveMachine, due: float, took: float) -> tuple[str, str]:
    """Two columns of text: names and values."""
    state = "paused" if machine.paused else "out of reach" if machine.out_of_reach else "running"
    load = 100.0 * took / due if due > 0 else 0.0
    pressures = " ".join(f"{1e-5 * pressure:.0f}" for pressure in machine.plant.bottom_pressures())
    names = ("state", "time", "computing", "bottom pressures", "compensator")
    values = (state, f"{machine.time_s:.1f} s", f"{load:.0f} % of real time", f"{pressures} bar", machine.compensator)
    return "\n".join(names), "\n".join(values)
