"""The folder of a run: gathered under a temporary name, moved when complete, so a folder that is there is whole.

An interrupted or diverged run becomes `<name>-partial`. A folder that exists already is filled: files of an earlier run
in it are replaced, others stay.
"""

from __future__ import annotations

import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from hexsim.errors import HexsimError
from hexsim.files.report_links import link_reports

UNFINISHED = ".unfinished-"
LOCK = ".lock"  # in an unfinished folder: its run lives
YOUNG_S = 10.0
LAST = "summary.json"  # moved last: whoever sees it sees a whole folder
OF_A_RUN = (
    "log.parquet",
    "log.csv",
    "log.csv.gz",
    "run.rrd",
    "report.html",
    "config.toml",
    "learned.json",
    "compensator.json",
    "figures",
    LAST,
)


def default_folder(name: str, root: Path = Path("runs")) -> Path:
    """runs/<time>-<name>, a name that is not taken."""
    stem = f"{datetime.now():%Y-%m-%dT%H-%M-%S}-{file_name(name)}"
    for suffix in ("", *(f"-{k}" for k in range(2, 1000))):
        folder = root / f"{stem}{suffix}"
        if not folder.exists():
            return folder
    raise HexsimError(f"{root} holds 999 runs of this second already: give --out a folder of your own")


def file_name(name: str) -> str:
    """A name of the user's as the name of a file: letters, digits, dots and dashes; at most 150 bytes."""
    return re.sub(r"[^\w.-]+", "_", name).encode()[:150].decode(errors="ignore")


class RunFolder:
    """Where to write (`path`) until `finish` gives it its name."""

    def __init__(self, out: Path) -> None:
        self.out = Path(out)
        self._finished = False
        self.into_existing = self.out.is_dir()
        parent = self.out if self.into_existing else self.out.parent
        try:
            if self.out.exists() and not self.into_existing:
                raise HexsimError(f"cannot write {self.out}: it is a file; give a folder")
            parent.mkdir(parents=True, exist_ok=True)
            _remove_abandoned(parent)
            self.path = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=parent))
            self._lock = FileLock(self.path / LOCK)
            self._lock.acquire()
        except OSError as error:
            raise _unwritable(self.out, error) from None

    def finish(self, complete: bool = True) -> Path:
        """Move what was written to its place, and link its report with those beside it; the folder's final path."""
        place = self._moved(complete)
        link_reports(place)
        return place

    def _moved(self, complete: bool) -> Path:
        self._finished = True
        try:
            self._unlock()
            self.path.chmod(0o755)
            if not complete:
                return self._finish_partial()
            if not self.into_existing:
                return self._renamed(self.out)
            self._fill(self.out)
        except OSError as error:
            raise HexsimError(
                f"cannot move {self.path} to {self.out}: {error.strerror or error}; it is whole there"
            ) from None
        return self.out

    def _renamed(self, target: Path) -> Path:
        if target.exists():  # made by somebody else meanwhile
            self._fill(target)
        else:
            self.path.rename(target)
        return target

    def _finish_partial(self) -> Path:
        """Beside `out` where that can be written, else in it."""
        name = f"{self.out.resolve().name}-partial"
        for parent in (self.out.resolve().parent, self.out):
            for suffix in ("", *(f"-{k}" for k in range(2, 1000))):
                target = parent / f"{name}{suffix}"
                if target.exists():
                    continue
                try:
                    self.path.rename(target)
                except OSError:
                    break
                return target
        return self.path

    def _fill(self, target: Path) -> None:
        for name in OF_A_RUN:
            earlier = target / name
            if earlier.is_dir():
                shutil.rmtree(earlier)
            else:
                earlier.unlink(missing_ok=True)
        for entry in sorted(self.path.iterdir(), key=lambda entry: entry.name == LAST):
            place = target / entry.name
            if place.is_dir():
                shutil.rmtree(place)
            entry.rename(place)
        self.path.rmdir()

    def _unlock(self) -> None:
        self._lock.release()
        (self.path / LOCK).unlink(missing_ok=True)

    def discard(self) -> None:
        """Leave nothing behind; what could not be moved to its place stays where it is whole."""
        if self._finished:
            return
        self._lock.release()
        shutil.rmtree(self.path, ignore_errors=True)


@contextmanager
def run_folder(out: Path) -> Iterator[RunFolder]:
    """A folder to gather a run in, gone when the block raises. HexsimError at once if it cannot be written."""
    folder = RunFolder(out)
    try:
        yield folder
    except BaseException:
        folder.discard()
        raise


def _remove_abandoned(parent: Path) -> None:
    """Folders whose run was killed: nobody holds their lock, and they are no younger than a run takes to begin."""
    for folder in parent.glob(f"{UNFINISHED}*"):
        with suppress(OSError, Timeout):
            if time.time() - folder.stat().st_mtime > YOUNG_S:
                with FileLock(folder / LOCK, blocking=False):
                    pass
                shutil.rmtree(folder, ignore_errors=True)


def _unwritable(out: Path, error: OSError) -> HexsimError:
    return HexsimError(
        f"cannot write the folder {out}: {error.strerror or error}; give --out a folder that can be written"
    )
