"""The folder of a run: gathered under a temporary name, moved when complete, so a folder that is there is whole.

An interrupted or diverged run becomes `<name>-partial`. A folder that exists already is filled: files of an earlier run
in it are replaced, others stay. While a run gathers for a place, a second one for it is refused.
"""

from __future__ import annotations

import atexit
import os
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
from hexsim.files.runs_index import link_to_index, write_index

UNFINISHED = ".unfinished-"
LOCK = ".lock"  # in an unfinished folder: its run lives
WRITING = ".hexsim-"  # beside a place, with the place's name and LOCK: a run is writing it
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
    "summary.json",
)


def default_folder(name: str, root: Path = Path("runs")) -> Path:
    """runs/<time>-<name>, a name that is not taken."""
    stem = f"{datetime.now():%Y-%m-%dT%H-%M-%S}-{file_name(name)}"
    for suffix in ("", *(f"-{k}" for k in range(2, 1000))):
        folder = root / f"{stem}{suffix}"
        if not folder.exists() and _reserve(folder):
            return folder
    raise HexsimError(f"{root} holds 999 runs of this second already: give --out a folder of your own")


def file_name(name: str) -> str:
    """A name of the user's as the name of a file: letters, digits, dots and dashes; at most 150 bytes."""
    return re.sub(r"[^\w.-]+", "_", name).encode()[:150].decode(errors="ignore")


_RESERVED: dict[Path, FileLock] = {}  # default names of this process that no run has taken yet


def _reserve(folder: Path) -> bool:
    """Whether no other run has this name in mind."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        _RESERVED[folder.absolute()] = _locked(folder)
    except Timeout:
        return False
    except OSError:  # the run will say so
        return True
    return True


def _locked(out: Path) -> FileLock:
    """The lock of a place: beside it, or in it where only it can be written. Raises Timeout where another run has it."""
    whole = out.absolute()
    places = [whole.parent / f"{WRITING}{file_name(whole.name)}{LOCK}", whole / f"{WRITING}{LOCK}"]
    if not os.access(whole.parent, os.W_OK) and whole.is_dir():
        places.reverse()
    lock = FileLock(places[0], blocking=False)
    lock.acquire()
    return lock


def _release(lock: FileLock) -> None:
    """Its file goes while it is still held: whoever takes it next makes a new one."""
    if lock.is_locked:
        with suppress(OSError):
            Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()


@atexit.register
def _release_reserved() -> None:
    while _RESERVED:
        _release(_RESERVED.popitem()[1])


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
            self._listed = self.out.absolute() in _RESERVED  # a default name: its folder is hexsim's own
            self._place = _RESERVED.pop(self.out.absolute(), None) or _locked(self.out)
        except Timeout:
            raise HexsimError(f"another run is writing {self.out}: wait for it, or give another --out") from None
        except OSError as error:
            raise _unwritable(self.out, error) from None
        try:
            _remove_abandoned(parent)
            self.path = Path(tempfile.mkdtemp(prefix=UNFINISHED, dir=parent))
            self._lock = FileLock(self.path / LOCK)
            self._lock.acquire()
        except OSError as error:
            _release(self._place)
            raise _unwritable(self.out, error) from None

    def finish(self, complete: bool = True) -> Path:
        """Move what was written to its place; the folder's final path. Under a default name the page of all runs lists it."""
        if self._listed:
            link_to_index(self.path / "report.html")
        try:
            place = self._moved(complete)
        finally:
            _release(self._place)
        if self._listed:
            write_index(place.parent)
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
        """First everything of the earlier run goes, its figures before all else; then the new files come, figures last: whoever
        is killed in between leaves no figures beside data that are not theirs."""
        entries = sorted(self.path.iterdir(), key=_is_figures)
        for name in sorted(
            {*OF_A_RUN, *(entry.name for entry in entries)}, key=lambda name: not _is_figures(Path(name))
        ):
            earlier = target / name
            if earlier.is_dir() and not earlier.is_symlink():
                shutil.rmtree(earlier)
            else:
                earlier.unlink(missing_ok=True)
        for entry in entries:
            entry.rename(target / entry.name)
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
        _release(self._place)


def _is_figures(path: Path) -> bool:
    """summary.json, compare.json, trace.json: what tells a program that a folder is whole."""
    return path.suffix == ".json"


@contextmanager
def run_folder(out: Path) -> Iterator[RunFolder]:
    """A folder to gather a run in, gone when the block raises. HexsimError at once if it cannot be written."""
    folder = RunFolder(out)
    try:
        yield folder
    except BaseException:
        folder.discard()
        raise


def _remove_abandoned(
    parent: Path,
    *,
    young_s: float = 10.0,  # a younger one may be of a run that is about to write
) -> None:
    """Folders and locks whose run was killed: nobody holds them, and they are no younger than a run takes to begin."""
    for file in parent.glob(f"{WRITING}*{LOCK}"):
        with suppress(OSError, Timeout):
            if time.time() - file.stat().st_mtime > young_s:
                lock = FileLock(file, blocking=False)
                lock.acquire()
                _release(lock)
    for folder in parent.glob(f"{UNFINISHED}*"):
        with suppress(OSError, Timeout):
            if time.time() - folder.stat().st_mtime > young_s:
                with FileLock(folder / LOCK, blocking=False):
                    pass
                shutil.rmtree(folder, ignore_errors=True)


def _unwritable(out: Path, error: OSError) -> HexsimError:
    return HexsimError(
        f"cannot write the folder {out}: {error.strerror or error}; give --out a folder that can be written"
    )
