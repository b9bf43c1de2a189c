"""The machine while a simulator flies: packets by X-Plane's public layout, sliders, a pause, and the page in a browser."""

import contextlib
import math
import socket
import struct
import threading
import time

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.cueing import protocols
from hexsim.cueing import shaping as shapes
from hexsim.machine import load_machine

pytest.importorskip("mjviser", reason="the page needs the extra: pip install 'hexsim[web]'")
from hexsim import web
from hexsim.simulation import vehicle_link
from hexsim.web import browser

RATE_Hz = 500.0
SETTLED = int(5 * RATE_Hz)  # ticks, ten times the lag by which numbers go over


def steps(shaping, acceleration, rates=(0.0, 0.0, 0.0), ticks=SETTLED):
    """The last output of `ticks` ticks with the same motion."""
    return [shaping.step(acceleration, rates) for _ in range(ticks)][-1]


def test_a_motion_is_given_on_as_it_comes_until_something_is_asked():
    """Six numbers in, the same six out, in the first tick."""
    given = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
    np.testing.assert_allclose(shapes.Shaping(RATE_Hz).step(given[:3], given[3:]), given, rtol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gain_and_dead_band_act_on_their_axis_alone(sign):
    """Gain 0.5 and a dead band of 0.4: 3 m/s2 become 1.3, 0.3 m/s2 nothing, of either sign; the other axes stay."""
    shaping = shapes.Shaping(RATE_Hz)
    shaping.ask({"sway": shapes.AxisShape(gain=0.5, dead_band=0.4)})
    assert steps(shaping, (1.0, sign * 3.0, 2.0)) == pytest.approx([1.0, sign * 1.3, 2.0, 0.0, 0.0, 0.0], abs=1e-3)
    assert steps(shaping, (0.0, sign * 0.3, 0.0))[1] == pytest.approx(0.0, abs=1e-3)


def test_smoothing_is_a_lag_of_its_time_constant():
    """A step of 1 m/s2 through 0.2 s: 1 - 1/e after 0.2 s, 1 after 2 s."""
    shaping = shapes.Shaping(RATE_Hz)
    shaping.ask({"heave": shapes.AxisShape(smoothing_s=0.2)})
    steps(shaping, (0.0, 0.0, 0.0))
    assert steps(shaping, (0.0, 0.0, 1.0), ticks=100)[2] == pytest.approx(1.0 - math.exp(-1.0), abs=0.01)
    assert steps(shaping, (0.0, 0.0, 1.0), ticks=900)[2] == pytest.approx(1.0, abs=1e-3)


def test_a_slider_is_no_jolt():
    """From gain 1 to 3 at 1 m/s2: no tick changes by more than 2/250 of it (the lag of 0.5 s at 500 Hz), and it arrives."""
    shaping = shapes.Shaping(RATE_Hz)
    steps(shaping, (1.0, 0.0, 0.0))
    shaping.ask({"surge": shapes.AxisShape(gain=3.0)})
    found = [1.0] + [shaping.step((1.0, 0.0, 0.0), np.zeros(3))[0] for _ in range(SETTLED)]
    assert np.diff(found).max() <= 2.0 / 250.0 and found[-1] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize(
    "numbers", [{"gain": math.nan}, {"gain": 6.0}, {"smoothing_s": -0.1}, {"dead_band": math.inf}], ids=str
)
def test_a_shape_that_cannot_be_is_refused(numbers):
    """One sentence with the name and its range."""
    with pytest.raises(HexsimError, match=f"axis: {next(iter(numbers))} is .*; give a number from"):
        shapes.AxisShape(**numbers)


def data(normal=1.0, axial=0.0) -> bytes:
    """X-Plane's DATA with groups 4 and 16."""
    loads = struct.pack("<i8f", 4, 0, 0, 0, 0, normal, axial, 0, 0)
    return b"DATA\0" + loads + struct.pack("<i8f", 16, *[0.0] * 8)


class Ahead:
    """Ticks a flight without waiting, with packets every eighth tick (62.5 Hz)."""

    def __init__(self, flight: web.Flight) -> None:
        self.flight = flight
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def fly(self, seconds: float, packet=lambda t: data()) -> None:
        server = self.flight.server
        for k in range(round(seconds / server.tick_s)):
            if packet is not None and k % 8 == 0:
                self.socket.sendto(packet(server.time_s), self.flight.address)
            server.tick()


@pytest.fixture(scope="module")
def ahead():
    """A hexapod that X-Plane flies, ticked by hand, in normal."""
    flight = web.Flight(
        load_machine("micro_motion_system"),
        vehicle_link.Vehicle(decode=protocols.PROTOCOLS["xplane"], name="xplane"),
        port=0,
    )
    driven = Ahead(flight)
    with contextlib.closing(driven.socket), contextlib.closing(flight.link):
        driven.fly(2.0)
        yield driven


def bumpy(time_s: float) -> bytes:
    """0.15 g up and down, once a second."""
    return data(normal=1.0 + 0.15 * math.sin(2.0 * math.pi * time_s))


def size(rows: np.ndarray, axis: str, seconds: float) -> float:
    """rms of an axis over the last seconds."""
    return float(np.sqrt(np.mean(rows[-round(seconds / 0.02) :, shapes.AXES.index(axis)] ** 2)))


def test_felt_follows_what_is_asked_and_the_gain_scales_both(ahead):
    """0.15 g of heave at 1 Hz: flown 1.04 m/s2 rms, asked 0.3 of it, felt 0.6 to 1.05 of the washout's heave (plain control
    lags, and its valves' dead band takes its share). With gain 0.5 half is asked, and less felt. State and packets are said."""
    ahead.fly(4.0, bumpy)
    shown = ahead.flight.shown()
    asked, felt = size(shown.asked, "heave", 2.0), size(shown.felt, "heave", 2.0)
    assert size(shown.flown, "heave", 2.0) == pytest.approx(0.15 * 9.81 / math.sqrt(2.0), rel=0.02)
    assert asked == pytest.approx(0.3 * 0.15 * 9.81 / math.sqrt(2.0), rel=0.02)
    high_pass = abs((2j * math.pi) ** 3 / ((2j * math.pi + 4.0) ** 2 * (2j * math.pi + 0.3)))  # 1 Hz, the washout's
    assert 0.6 < felt / (high_pass * asked) < 1.05
    assert shown.state == "normal" and shown.packets.endswith("packets, all understood")
    ahead.flight.ask({"heave": shapes.AxisShape(gain=0.5)})
    ahead.fly(4.0, bumpy)
    halved = ahead.flight.shown()
    assert size(halved.asked, "heave", 2.0) == pytest.approx(0.5 * asked, rel=0.02)
    assert 0.2 * felt < size(halved.felt, "heave", 2.0) < 0.6 * felt
    ahead.flight.ask({"heave": shapes.AxisShape()})


@pytest.mark.slow
def test_after_a_pause_it_goes_on(ahead):
    """Three seconds without packets: the page says that it waits, nothing is asked any more, and no fault comes. With packets
    again the motion comes back."""
    ahead.fly(3.0, bumpy)
    ahead.fly(3.0, None)
    waiting = ahead.flight.shown()
    assert "waits for them" in waiting.packets and waiting.state == "normal"
    assert size(waiting.asked, "heave", 3.0 - vehicle_link.SILENT_S - vehicle_link.FADE_S - 0.1) == 0.0
    ahead.fly(3.0, bumpy)
    again = ahead.flight.shown()
    assert size(again.asked, "heave", 1.0) > 0.2 and "waits" not in again.packets


def test_what_is_not_understood_is_said_in_words(ahead):
    """A packet of another protocol, and one whose loads are not finite, do nothing but be counted, with the reason."""
    for packet in (b"JUNK", data(normal=math.nan)):
        ahead.socket.sendto(packet, ahead.flight.address)
    ahead.fly(0.1)
    said = ahead.flight.shown().packets
    assert "not of xplane" in said and "not finite" in said and "JUNK" in said


def test_a_machine_without_platform_is_refused():
    """A bench has one leg: one sentence."""
    with pytest.raises(HexsimError, match="machine bench has no platform"):
        web.Flight(load_machine("bench"), vehicle_link.Vehicle(decode=protocols.PROTOCOLS["xplane"]), port=0)


@pytest.mark.slow
def test_the_page_shows_the_flight_and_its_sliders_act():
    """In a browser: packets and state in words, digits of what is flown; a slider at its end takes the axis out. Nothing is
    asked of another computer."""
    flight = web.Flight(
        load_machine("micro_motion_system"),
        vehicle_link.Vehicle(decode=protocols.PROTOCOLS["xplane"], name="xplane"),
        port=0,
    )
    page = web.FlightPage(flight, "micro_motion_system", "hexsim serve --from xplane", port=8795)
    running, done = threading.Thread(target=page.run), threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not done.wait(1.0 / 60.0):
                sender.sendto(bumpy(time.monotonic()), flight.address)

    sending = threading.Thread(target=send)
    running.start(), sending.start()
    try:
        with browser.opened(page.address) as shown:
            shown.wait_for_function("() => Number(document.querySelector('#hexsim-flown')?.innerText) > 1.0")
            assert "all understood" in shown.locator("#hexsim-packets").inner_text()
            shown.wait_for_function("() => document.querySelector('#hexsim-state').innerText.includes('normal')")
            browser.move_slider(shown, "Gain heave", -20)  # from 1 to 0
            shown.wait_for_function("() => Number(document.querySelector('#hexsim-felt').innerText) < 0.05")
            assert {address.split("/")[2].split(":")[0] for address in shown.asked_for if "://" in address} == {
                "127.0.0.1"
            }
    except HexsimError as error:
        pytest.skip(f"the page cannot be opened: {error}")
    finally:
        done.set()
        page.close()
        sending.join(timeout=5.0), running.join(timeout=30.0)
