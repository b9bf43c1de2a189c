"""Packets: where they go, by an address that people type; and those that are not understood, in words for a status line."""

from __future__ import annotations

import socket
from collections import Counter

from hexsim.errors import HexsimError

OTHER = "other packets"
HOST_PORT = 47110  # UDP, of a machine's host interface; any that is free would do
# Beyond it no number of a packet is one of a machine or a vehicle: places, rates and accelerations in m and rad. A heading that counts
# its turns is below; a float32 resolves it to 0.1 mrad.
LARGEST = 1000.0


def address_of(text: str, default_port: int, option: str, allowed: str) -> tuple[str, int]:
    """Numeric address and port of ADDRESS or ADDRESS:PORT. Raises HexsimError: option, as typed, and what it allows."""
    host, colon, port = text.partition(":")
    if not host or (colon and not (port.isascii() and port.isdigit() and 0 < int(port) < 2**16)):
        raise HexsimError(f"{option}: give {allowed}")
    try:
        return socket.gethostbyname(host), int(port or default_port)
    except (OSError, UnicodeError) as error:
        raise HexsimError(f"{option}: {host} is no address of a computer ({error})") from None


def described(data: bytes) -> str:
    """Size and first bytes of a packet."""
    return f"{len(data)} bytes that begin with {data[:4]!r}" if data else "no bytes"


class Refusals(Counter[str]):
    """How often each reason was given. Reasons beyond `most_kinds` count as `OTHER`."""

    def note(
        self,
        reason: str,
        *,
        most_kinds: int = 12,  # reasons that are kept apart; a flood of noise must not fill the memory with them
    ) -> None:
        self[reason if reason in self or len(self) < most_kinds else OTHER] += 1

    def line(self, received: int, what: str) -> str:
        """One phrase for a status line, empty where all was understood. what: the protocol that is listened for."""
        refused = self.total()
        if not refused:
            return ""
        kinds = [kind for kind, _ in self.most_common(2)]
        more = f", and {len(self) - len(kinds)} other kinds" if len(self) > len(kinds) else ""
        none = "none" if refused == received else f"{refused}"
        verb = "is" if refused == received or refused == 1 else "are"
        negation = "" if refused == received else "not "
        return f"{received} packets, {none} {verb} {negation}of {what}: {'; '.join(kinds)}{more}"
