"""What the site's build needs beside its libraries: a griffe extension of mkdocstrings, and a hook of mkdocs."""

from __future__ import annotations

import re
from typing import Any

import griffe

DIAGRAMS = re.compile(r'<script type="module">(?:(?!</script>).)*?mermaid(?:(?!</script>).)*</script>', re.DOTALL)


class Blocks(griffe.Extension):
    """Indented lines of a docstring, its equations, become blocks of Markdown.

    Docstrings are written for people who read the code, where no empty line is needed before them.
    """

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = with_blocks(obj.docstring.value)


def with_blocks(text: str) -> str:
    """The text with an empty line wherever an indented line follows one that is not."""
    lines: list[str] = []
    for line in text.splitlines():
        before = lines[-1] if lines else ""
        if line.startswith("    ") and before and not before.startswith(("    ", "- ")):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


def on_page_content(html: str, **kwargs: Any) -> str:
    """mkdocs' hook: notebooks without the script that would load diagrams from a network."""
    return DIAGRAMS.sub("", html)
