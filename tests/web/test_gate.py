"""The door of the page: strangers are refused, and what a widget cannot take changes nothing. Over the page's real port."""

import asyncio
import contextlib
import logging
import math
import socket
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("mjviser", reason="the page needs the extra: pip install 'hexsim[web]'")
import msgspec
import viser
import websockets

from hexsim import HexsimError, load_scenario, web
from hexsim.machine import load_machine
from hexsim.web import gate as page_gate
from hexsim.web import knobs as sliders

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [3.0, 0.0, 1.0], "image_height": 600,
    "image_width": 800, "fov": 1.0, "near": 0.01, "far": 100.0, "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0],
}  # fmt: skip
PATIENCE_S = 20.0


@pytest.fixture(scope="module")
def page():
    """A bench on its page, which serves and does not simulate."""
    served = web.Page(web.Session(load_machine("bench"), load_scenario("heave")), "bench", "heave", port=8870)
    yield served
    served.server.stop()


def get(address: str, **headers: str) -> int:
    request = urllib.request.Request(address, headers=headers)
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            answer.read()
            return answer.status
    except urllib.error.HTTPError as error:
        with error:
            return error.code


@contextlib.asynccontextmanager
async def connected(page: web.Page, path: str | None = None, origin: str | None = "", **headers: str):
    """A websocket as the browser opens it, with another path, Origin or Host where they are given."""
    host = f"127.0.0.1:{page.server.get_port()}"
    where = f"ws://{host}/{page.gate.token}" if path is None else f"ws://{host}{path}"
    async with websockets.connect(
        where,
        origin=f"http://{host}" if origin == "" else origin,
        additional_headers=headers or None,
        subprotocols=[f"viser-v{viser.__version__}"],
        max_size=None,
        compression=None,
    ) as made:
        yield made


async def say(page: web.Page, *messages: object) -> None:
    """Camera first, as any browser; then the messages, packed unless they are bytes or text; until all were looked at."""
    async with connected(page) as made:
        await made.send(msgspec.msgpack.encode(CAMERA))
        await asyncio.sleep(0.3)
        with contextlib.suppress(websockets.ConnectionClosed):
            for message in messages:
                await made.send(message if isinstance(message, (bytes, str)) else msgspec.msgpack.encode(message))
        await asyncio.sleep(0.3)


def change(page: web.Page, name: str, **updates: object) -> dict:
    """The message of a browser in which a widget is moved."""
    uuid = next(u for u, handle in page.gate.widgets.items() if handle is page.handles[name])
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


def test_the_address_is_on_loopback_with_a_token_that_is_new_each_time(page):
    """22 letters or more of chance, other ones for another page."""
    other, gate = page_gate.open_server("other", 8871)
    other.stop()
    assert page.address == f"http://127.0.0.1:{page.server.get_port()}/{page.gate.token}"
    assert len(page.gate.token) >= 22 and gate.token != page.gate.token


def test_a_browser_is_let_in(page):
    """The page by its address, on 127.0.0.1 and on localhost, and nothing framed or referred to from elsewhere."""
    assert get(page.address) == get(page.address + "/") == 200
    assert get(page.address.replace("127.0.0.1", "localhost")) == 200
    with urllib.request.urlopen(page.address, timeout=PATIENCE_S) as answer:
        assert answer.headers["X-Frame-Options"] == "DENY" and answer.headers["Referrer-Policy"] == "no-referrer"
    asyncio.run(say(page, change(page, "compensator", value="none")))


@pytest.mark.parametrize(
    "where", ["/", "/index.html", "/wrong", "/{token}x", "//{token}", "/?{token}", "/%2e%2e/{token}"]
)
def test_without_the_token_there_is_nothing(page, where):
    """Neither the page nor a websocket."""
    path = where.format(token=page.gate.token)
    assert get(f"http://127.0.0.1:{page.server.get_port()}{path}") == 403
    with pytest.raises(websockets.InvalidStatus, match="403"):
        asyncio.run(open_and_close(page, path=path))


async def open_and_close(page: web.Page, **how: str | None) -> None:
    async with connected(page, **how):
        pass


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://127.0.0.1:1", "http://127.0.0.1", None])
def test_a_websocket_of_another_origin_is_refused(page, origin):
    """A page from elsewhere, from a file, from another port of this computer, and a client that does not say, even with the
    token."""
    with pytest.raises(websockets.InvalidStatus, match="403"):
        asyncio.run(open_and_close(page, origin=origin))


@pytest.mark.parametrize(
    "host", ["evil.example:{port}", "evil.example", "127.0.0.1", "127.0.0.1:1", "127.0.0.1.evil.example:{port}"]
)
def test_another_name_for_this_computer_is_refused(page, host):
    """DNS rebinding: the token is right and the Host is not, with and without the Origin that goes with it."""
    name = host.format(port=page.server.get_port())
    assert get(page.address, Host=name) == get(page.address, Host=name, Origin=f"http://{name}") == 403


def bad_values(page: web.Page, name: str) -> list[object]:
    handle = page.handles[name]
    odd: list[object] = [
        None,
        [],
        {},
        [1.0],
        b"x",
        "",
        "/tmp/x.so",
        "os:system",
        "mine.json",
        math.nan,
        math.inf,
        -1e308,
        2**63,
    ]
    if isinstance(handle, viser.GuiSliderHandle):
        return [*odd, True, handle.max + 1e-3, handle.min - 1e-3, "1.0"]
    return [*odd, True, 1] if isinstance(handle, viser.GuiDropdownHandle) else [*odd, 1, 0, "True"]


def test_every_widget_holds_to_its_own_limits(page, capfd):
    """Values of another type, not finite, beyond the limits and not among the options, for every widget of the page, and a
    change of its limits, options or label: no widget changes, nothing is asked of the machine, and nothing is printed."""
    handles = page.handles
    assert len(handles) >= 8
    before = {name: (handle.value, handle.visible, handle.label) for name, handle in handles.items()}
    limits = {name: (handle.min, handle.max) for name, handle in handles.items() if hasattr(handle, "min")}
    asked, count = page.session.asked, page.gate.refusals.total()
    bad = [change(page, name, value=value) for name in handles for value in bad_values(page, name)]
    for name in handles:
        bad += [
            change(page, name, min=-1e9, max=1e9),
            change(page, name, options=["/tmp/x.so"]),
            change(page, name, label="x"),
            change(page, name, visible=False),
            change(page, name, value=handles[name].value, max=1e9),
            change(page, name),
            change(page, name, __class__=1),
            {**change(page, name, value=1.0), "updates": 5},
            {**change(page, name), "uuid": 3},
        ]
    for first in range(0, len(bad), page_gate.MOST_REFUSED - 1):
        asyncio.run(say(page, *bad[first : first + page_gate.MOST_REFUSED - 1]))
    assert page.gate.refusals.total() == count + len(bad)
    assert {name: (handle.value, handle.visible, handle.label) for name, handle in handles.items()} == before
    assert {name: (handle.min, handle.max) for name, handle in handles.items() if hasattr(handle, "min")} == limits
    assert page.session.asked == asked
    printed = capfd.readouterr()
    assert "Traceback" not in printed.out + printed.err


def test_what_a_widget_takes_reaches_the_machine(page):
    """The ends of a slider, an option of the list: asked of the machine as they are."""
    knob = next(knob for knob in sliders.knobs(page.session.declared) if knob.name == "overlap")
    for value in (knob.high, knob.low):
        asyncio.run(say(page, change(page, "overlap", value=value)))
        wait_until(lambda value=value: page.session.asked.knobs.get("overlap") == value)
    asyncio.run(say(page, change(page, "compensator", value="adaptive")))
    wait_until(lambda: page.session.asked.compensator == "adaptive")


def wait_until(condition) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_only_built_in_algorithms_can_be_chosen(page, monkeypatch):
    """What an installed package announces is no option of the page: to choose it would import it."""
    import compensation

    monkeypatch.setattr("compensation.registry._announced", lambda: {"foreign": None})
    assert "foreign" in compensation.available() and "foreign" not in compensation.built_in()
    assert set(page.handles["compensator"].options) == set(compensation.built_in())


def test_malformed_data_is_no_traceback_and_no_end(page, capfd, caplog):
    """Text, noise, cut and wrong MessagePack, messages of other kinds (a share link, uploads, the server's own), cameras that
    cannot be, more than a message may be, and bytes that are no HTTP: nothing is said, and a browser is let in afterwards."""
    kinds = [
        "ShareUrlRequest",
        "FileTransferStartUpload",
        "RunJavascriptMessage",
        "GuiButtonHoldMessage",
        "SetCameraFovMessage",
        5,
        None,
    ]
    cameras = [CAMERA | {"fov": value} for value in (math.nan, math.inf, "1", None, [1.0], 1e300)]
    cameras += [
        CAMERA | {"wxyz": [1.0]},
        CAMERA | {"position": 3},
        CAMERA | {"more": 1},
        {"type": "ViewerCameraMessage"},
    ]
    noise = [np.random.default_rng(k).bytes(50) for k in range(10)]
    deep = b"\x91" * 5000
    with caplog.at_level(logging.WARNING):
        asyncio.run(
            say(page, "text", b"", b"\xc1", deep, *noise, *({"type": kind, "x": 1} for kind in kinds), *cameras)
        )
        asyncio.run(say(page, b"x" * (page_gate.LARGEST_MESSAGE + 1)))
        for data in (b"\x00\xff" * 50, b"GET\r\n\r\n", b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", page.server.get_port()), timeout=PATIENCE_S) as made:
                made.sendall(data)
        time.sleep(0.3)
    printed = capfd.readouterr()
    assert "Traceback" not in printed.out + printed.err and "Error" not in printed.err and not caplog.records
    assert get(page.address) == 200
    asyncio.run(say(page, change(page, "overlap", value=page.handles["overlap"].min)))


def test_who_goes_on_with_nonsense_is_put_out(page):
    """After a hundred refused messages the connection is closed; others stay."""

    async def flood() -> None:
        async with connected(page) as made:
            for _ in range(page_gate.MOST_REFUSED + 2):
                await made.send(b"\xc1")
            await asyncio.wait_for(made.wait_closed(), PATIENCE_S)
            assert made.close_code == 1008

    with contextlib.suppress(websockets.ConnectionClosed):
        asyncio.run(flood())
    assert get(page.address) == 200


def test_a_message_of_any_bytes_has_an_answer(page):
    """Noise, and good messages with bytes changed: a reason, or a value that its widget takes."""
    good = [msgspec.msgpack.encode(change(page, name, value=handle.value)) for name, handle in page.handles.items()]
    good.append(msgspec.msgpack.encode(CAMERA))

    @settings(max_examples=300, derandomize=True, deadline=None, database=None)
    @given(
        st.sampled_from(good),
        st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255)), max_size=3),
        st.binary(max_size=60),
    )
    def claim(message, changes, noise):
        data = bytearray(message)
        for at, byte in changes:
            data[at % len(data)] = byte
        for hostile in (bytes(data), noise):
            reason = page.gate.against_message(hostile)
            assert isinstance(reason, str)
            if not reason and (decoded := msgspec.msgpack.decode(hostile))["type"] == "GuiUpdateMessage":
                assert page_gate.takes(page.gate.widgets[decoded["uuid"]], decoded["updates"]["value"])

    claim()
    assert all(page.gate.against_message(message) == "" for message in good[:1] + good[-1:])


def test_a_slider_that_is_off_takes_nothing(page):
    """The amplitude where the motion is no sine."""
    slider = page.handles["amplitude"]
    assert page_gate.takes(slider, slider.max)
    slider.disabled = True
    try:
        assert not page_gate.takes(slider, slider.max)
    finally:
        slider.disabled = False


def test_without_the_gate_there_is_no_page(monkeypatch):
    """A viser that asks for its server otherwise than the gate knows: one sentence, and nothing is served."""

    @contextlib.contextmanager
    def beside(gate):
        yield

    monkeypatch.setattr("hexsim.web.gate._behind", beside)
    with pytest.raises(HexsimError, match="cannot be put behind hexsim's gate"):
        page_gate.open_server("x", 8890)
