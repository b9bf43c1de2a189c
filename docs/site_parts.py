"""What the site's build needs beside its libraries: a griffe extension of mkdocstrings, and a hook of mkdocs."""

from __future__ import annotations

import re
from typing import Any

import griffe

DIAGRAMS = re.compile(r'<script type="module">(?:(?!</script>).)*?mermaid(?:(?!</script>).)*</script>', re.DOTALL)
DOCTEST = re.compile(r" *# doctest:.*$", re.MULTILINE)


class Blocks(griffe.Extension):
    """Indented lines of a docstring, its equations, become blocks of Markdown, and so do its examples.

    Docstrings are written for people who read the code, where no empty line is needed before them.
    """

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = with_blocks(obj.docstring.value)


def with_blocks(text: str) -> str:
    """The text with an empty line wherever an indented line follows one that is not, and with examples in fences."""
    lines: list[str] = []
    for line in with_fences(text).splitlines():
        before = lines[-1] if lines else ""
        if line.startswith("    ") and before and not before.startswith(("    ", "- ")):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


def with_fences(text: str) -> str:
    """Examples, from `>>>` to an empty line or the end, in fences, without what is for doctest; Markdown would take `>` for a
    quotation and brackets for links."""
    example = re.compile(r"^>>> .*?(?=\n\n|\Z)", re.DOTALL | re.MULTILINE)
    return example.sub(lambda found: f"```pycon\n{DOCTEST.sub('', found.group().rstrip())}\n```", text)


def on_page_content(html: str, **kwargs: Any) -> str:
    """mkdocs' hook: notebooks without the script that would load diagrams from a network."""
    return DIAGRAMS.sub("", html)
