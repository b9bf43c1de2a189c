"""The door of the page: who may speak to it, and what may be said.

A program or a web page of anybody can send to a port of this computer. So the page is served

    to requests whose Host is loopback with the page's port        (a foreign name that points here is refused)
    from Origin the same, where there is one; a websocket needs it (a page from elsewhere is refused)
    under a path that begins with a random token                   (the address that the terminal shows)

and of what comes over the websocket two messages are taken: the camera, and the value of a widget that is on the page,
within that widget's own limits and options. Everything else is counted, with the reason, and ignored.

viser has no place for such a door; its server is made with websockets' own `serve`, whose options hold all of it.
"""

from __future__ import annotations

import functools
import hmac
import http
import logging
import math
import secrets
from collections.abc import Callable, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import fields, replace
from io import StringIO
from typing import Any

import msgspec
import viser
import websockets.asyncio.server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from hexsim.errors import HexsimError
from hexsim.packets import Refusals

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
LARGEST_MESSAGE = 1 << 16  # bytes; a camera takes 300
MOST_REFUSED = 100  # messages of a connection, then it is closed
CAMERA = {field.name: 1 for field in fields(_messages.ViewerCameraMessage)} | {
    "wxyz": 4,
    "position": 3,
    "look_at": 3,
    "up_direction": 3,
}
HEADERS = {
    "Referrer-Policy": "no-referrer",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
}
# put into the page: viser's dark look where the browser wants one; on a phone the machine above its sheet, figures first in it
SHEET = '.mantine-Paper-root[style*="max-height: 60%"]'
HEAD = f"""<script>
if (matchMedia("(prefers-color-scheme: dark)").matches) history.replaceState(null, "", "?darkMode");
</script><style>@media (max-width: 36em) {{
  {SHEET}, {SHEET} [style*="width: 20em"] {{ width: 100% !important; }} {SHEET} {{ max-height: 45% !important; }}
  {SHEET} [style*="width: 20em"] > :last-child {{ display: flex; flex-direction: column; }}
  {SHEET} [style*="grid-template-rows"] {{ order: 1; }} [style*="background-color"] > div:has(canvas) {{ height: 55% !important; }}
}}</style>""".encode()


class Gate:
    """token: the first part of every path. refusals: of requests and messages, by reason. widgets: of the page, by id."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(16)
        self.refusals = Refusals()
        self.widgets: Mapping[str, Any] = {}
        self.is_used = False

    # requests
    def against_request(self, request: Request, port: int) -> str:
        """Why a request is refused; empty where it is not."""
        hosts = {f"{name}:{port}" for name in NAMES}
        origins = request.headers.get_all("Origin")
        is_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if len(named := request.headers.get_all("Host")) != 1 or named[0] not in hosts:
            return "a Host that is not this computer's loopback address with the page's port"
        if len(origins) > 1 or (origins and origins[0] != f"http://{named[0]}"):
            return "an Origin that is another page"
        if is_socket and not origins:
            return "a websocket without Origin"
        given = request.path.partition("?")[0].split("/")[1:2]
        if not given or not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return "an address without the token"
        return ""

    def answer(self, serve_file: Callable[..., Any], connection: ServerConnection, request: Request) -> Response | None:
        """What is answered to a request; None lets the websocket's handshake go on."""
        reason = self.against_request(request, connection.local_address[1])
        if reason:
            self.refusals.note(reason)
            text = f"Refused: {reason}. Open the whole address that the terminal shows.\n".encode()
            headers = Headers(HEADERS | {"Content-Type": "text/plain", "Content-Length": str(len(text))})
            return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, text)
        path, mark, query = request.path.partition("?")
        rest = path.removeprefix(f"/{self.token}") or "/"
        request.headers.pop("Accept-Encoding", None)  # plain text, to be put into
        response = serve_file(connection, replace(request, path=rest + mark + query))
        if response is not None:
            response.headers.update(HEADERS)
            if rest == "/" and response.body:
                response.body = response.body.replace(b"<head>", b"<head>" + HEAD, 1)
                del response.headers["Content-Length"]
                response.headers["Content-Length"] = str(len(response.body))
        return response

    # messages
    def against_message(self, data: str | bytes) -> str:
        """Why a message is refused; empty where it is not. Never raises."""
        try:
            message = msgspec.msgpack.decode(data) if isinstance(data, bytes) else None
        except Exception:  # hostile bytes: whatever the decoder makes of them
            message = None
        if not isinstance(message, dict):
            return "a message that is no MessagePack of a table"
        kind = message.pop("type", None)
        if kind == "ViewerCameraMessage":
            return "" if _is_camera(message) else "a camera that cannot be"
        if kind != "GuiUpdateMessage":
            return "a message of a kind that the page does not take"
        updates, uuid = message.get("updates"), message.get("uuid")
        widget = self.widgets.get(uuid) if isinstance(uuid, str) else None
        if set(message) != {"uuid", "updates"} or not isinstance(updates, dict) or set(updates) != {"value"}:
            return "a change of something that is no widget's value"
        if widget is None:
            return "a widget that is not on the page"
        return "" if takes(widget, updates["value"]) else "a value that its widget does not take"


def takes(widget: Any, value: Any) -> bool:
    """Whether a value is one that the widget, as it stands now, lets people choose."""
    if getattr(widget, "disabled", False):
        return False
    if isinstance(widget, viser.GuiSliderHandle):
        slack = 1e-9 * (widget.max - widget.min)  # a browser counts steps from the lower end
        return is_number(value) and widget.min - slack <= value <= widget.max + slack
    if isinstance(widget, viser.GuiDropdownHandle):
        return isinstance(value, str) and value in widget.options
    if isinstance(widget, viser.GuiCheckboxHandle):
        return isinstance(value, bool)
    return isinstance(widget, viser.GuiButtonHandle) and value is True


def is_number(value: Any) -> bool:
    """A finite number, and no bool, which Python counts among them."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < math.inf


def _is_camera(
    message: Mapping[str, Any],
    *,
    largest: float = 1e6,  # m, px or rad
) -> bool:
    def are_numbers(values: Any, count: int) -> bool:
        given = values if count > 1 else [values]
        return (
            isinstance(given, (list, tuple))
            and len(given) == count
            and all(is_number(value) and abs(value) < largest for value in given)
        )

    return set(message) == set(CAMERA) and all(are_numbers(message[name], count) for name, count in CAMERA.items())


def gated_connection(gate: Gate) -> type[ServerConnection]:
    """Websocket connections that give on only what the gate lets pass."""

    class GatedConnection(ServerConnection):
        refused = 0

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                data = await super().recv(decode)
                reason = gate.against_message(data)
                if not reason:
                    return data
                gate.refusals.note(reason)
                self.refused += 1
                if self.refused >= MOST_REFUSED:
                    await self.close(1008, "too many messages that the page does not take")

    return GatedConnection


@contextmanager
def _behind(gate: Gate):
    """Whatever asks websockets for a server meanwhile gets one behind the gate. viser asks in a thread of its own."""
    serve = websockets.asyncio.server.serve
    quiet = logging.Logger("hexsim.web", logging.CRITICAL + 1)  # broken handshakes are the other side's matter

    def gated(handler: Any, host: Any = None, port: Any = None, **options: Any) -> Any:
        gate.is_used = True
        options |= {
            "process_request": functools.partial(gate.answer, options["process_request"]),
            "create_connection": gated_connection(gate),
            "max_size": LARGEST_MESSAGE,
            "logger": quiet,
        }
        return serve(handler, host, port, **options)

    websockets.asyncio.server.serve = gated  # type: ignore[assignment]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve


def open_server(label: str, port: int) -> tuple[viser.ViserServer, Gate]:
    """A viser server on loopback behind a gate. port: the first that is tried.

    Raises HexsimError where viser makes its server in a way that the gate does not know.
    """
    gate = Gate()
    with redirect_stdout(StringIO()), _behind(gate):  # it would greet
        server = viser.ViserServer(host=LOOPBACK, port=port, label=label, verbose=False)
    widgets = getattr(server.gui, "_gui_input_handle_from_uuid", None)
    if not gate.is_used or not isinstance(widgets, dict):
        server.stop()
        raise HexsimError(f"viser {viser.__version__} cannot be put behind hexsim's gate: pip install 'viser<1.2'")
    gate.widgets = widgets
    return server, gate
