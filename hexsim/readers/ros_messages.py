"""Messages of ROS 1 and 2, by definitions that come with a file and are not trusted: rosbags makes Python source of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from hexsim.readers.reader import LARGEST

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/msg)?/[A-Za-z][A-Za-z0-9_]*")  # of a type
FIELD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class BadDefinition(ValueError):
    """A message definition that no tool of ROS would write."""


class Messages:
    """Types known so far: those that ROS 2 Humble ships (ros1: ROS 1 Noetic), then those of the file."""

    def __init__(self, ros1: bool = False) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.ros1 = ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        self.store.max_sequence_length = LARGEST.items

    def define(
        self,
        name: str,
        text: str,
        *,
        most_characters: int = 1 << 20,  # characters of a definition
        most_types: int = 2000,  # of a file
    ) -> None:
        """Add a type with those that it needs. BadDefinition, or what rosbags raises."""
        from rosbags.typesys import get_types_from_msg

        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise BadDefinition(f"a message type is called {str(name)[:40]!r}")
        if not isinstance(text, str) or len(text) > most_characters:
            raise BadDefinition(f"the definition of {name} is no text of less than 1 MB")
        types = get_types_from_msg(text, name)
        if len(types) > most_types:
            raise BadDefinition(f"the definition of {name} holds {len(types)} types")
        for other, (constants, fields) in types.items():
            bad = [key for key, *_ in (*constants, *fields) if not FIELD.fullmatch(key)]
            if not NAME.fullmatch(other) or bad:
                raise BadDefinition(f"the definition of {name} names {(bad or [other])[0][:40]!r}")
        known = {**self.store.fielddefs, **types}
        for other in types:
            sizes(other, known, 0)
        self.store.register(types)

    def knows(self, name: str) -> bool:
        return name in self.store.fielddefs

    def decoder(self, name: str) -> Callable[[bytes], Any]:
        """From the bytes of a message to its fields."""
        read = self.store.deserialize_ros1 if self.ros1 else self.store.deserialize_cdr
        return lambda data: read(data, name)


def sizes(name: str, known: dict[str, Any], depth: int) -> tuple[int, int]:
    """(least bytes, most items of arrays of a fixed size) of a message. BadDefinition where few bytes can claim many items."""
    if depth > 20 or name not in known:
        return 1, 1
    least, items = 0, 1
    for _, (kind, detail) in known[name][1]:
        inner, count = 1, 1
        if kind.name == "NAME":
            inner, count = sizes(detail, known, depth + 1)
        elif kind.name in ("ARRAY", "SEQUENCE"):
            of, number = detail
            inner, count = sizes(of[1], known, depth + 1) if of[0].name == "NAME" else (1, 1)
            if inner == 0:
                raise BadDefinition(f"{name} has an array of messages without fields")
            if kind.name == "ARRAY":
                inner, count = inner * number, count * number
            else:
                inner = 4
        least, items = least + inner, items + count
        if items > LARGEST.items:
            raise BadDefinition(f"{name} has arrays of more than {LARGEST.items:,} items")
    return least, items
