"""Files are written whole or not at all: to a temporary name beside the target, then moved."""

from __future__ import annotations

import glob
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from hexsim.errors import HexsimError

PARTIAL = ".partial-"


@contextmanager
def written_whole(
    path: Path,
    *,
    abandoned_s: float = 3600.0,  # a file that nobody has written to for so long is left from a process that was killed
) -> Iterator[Path]:
    """Yield a temporary path; when the block ends well, it becomes `path`, else it is removed.

    The temporary name keeps the suffix (.csv.gz too), because writers choose the format by it. What killed processes
    have left of the same file goes. Raises HexsimError when the folder cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_partials(path, abandoned_s)
        handle, name = tempfile.mkstemp(prefix=_prefix(path), suffix="".join(path.suffixes[-2:]), dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise HexsimError(f"cannot write {path}: {error.strerror or error}; give another folder") from None
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        raise HexsimError(f"cannot write {path}: {error.strerror or error}; give another folder") from None
    finally:
        temporary.unlink(missing_ok=True)


def remove_partials(path: Path, older_than_s: float = 0.0) -> None:
    """Remove unfinished writings of `path` that killed processes have left, those that are older."""
    for left in path.parent.glob(f"{glob.escape(_prefix(path))}*"):
        with suppress(OSError):
            if time.time() - left.stat().st_mtime >= older_than_s:
                left.unlink()


def _prefix(path: Path) -> str:
    return f"{PARTIAL}{path.name[:60]}-"


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
