"""Which reader reads a file, and where the log of a name is."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from hexsim.errors import HexsimError
from hexsim.files.plugins import found_parts
from hexsim.readers import formats
from hexsim.readers.mapping import FileLayout
from hexsim.readers.reader import RawLog, Reader

OF_A_RUN = "log.parquet"


@cache
def readers() -> dict[str, Reader]:
    """Suffix -> reader; an entry point `hexsim.readers` announces one of another package."""
    found = found_parts(formats, "READER", "hexsim.readers").values()
    return {suffix: reader for reader in found for suffix in reader.suffixes}


@cache
def folder_readers() -> dict[str, Reader]:
    """File that marks a folder as one log -> reader."""
    found = found_parts(formats, "READER", "hexsim.readers").values()
    return {reader.marker: reader for reader in found if reader.marker}


def reader_of(path: Path) -> Reader | None:
    """The reader of a file by its suffix, of a folder by the file that marks it."""
    if path.is_dir():
        return next((reader for marker, reader in folder_readers().items() if (path / marker).is_file()), None)
    return readers().get(suffix_of(path)) if path.is_file() else None


def suffix_of(path: Path) -> str:
    """.csv of fit.csv.gz; a .gz alone is a text."""
    inner = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    suffix = inner.suffix.lower()
    return ".txt" if inner is not path and suffix not in readers() else suffix


def log_name(path: Path) -> str:
    """fit.csv.gz -> fit; run.2 of another ending stays; a run's own log has its folder's name."""
    if path.name == OF_A_RUN and path.parent.name:
        return path.parent.name
    inner = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return inner.stem if inner.suffix.lower() in readers() else inner.name


def of_a_run(path: Path) -> Path:
    """The log in a run's folder, where `path` is one."""
    return path / OF_A_RUN if (path / OF_A_RUN).is_file() else path


def raw_log(path: Path, layout: FileLayout | None = None) -> RawLog:
    """The signals of a file, by the reader of its suffix. The one place where what a library raises becomes a sentence:
    damaged files make libraries raise anything, a Rust panic is not even an Exception."""
    path = of_a_run(path)
    if not path.exists():
        raise HexsimError(f"there is no file {path}: give a log ({', '.join(readers())}, text also as .gz)")
    reader = reader_of(path)
    if reader is None:
        raise HexsimError(f"{path}: a log ends in one of {', '.join(readers())}, text also in .gz")
    try:
        return reader.read(path, layout or FileLayout()).cut(path)
    except HexsimError:
        raise
    except ImportError as error:
        if not reader.needs:
            raise
        raise HexsimError(
            f"{path} is {reader.name}: pip install 'hexsim[{reader.needs}]' to read it ({first_line(error)})"
        ) from None
    except MemoryError:
        raise HexsimError(f"{path} asks for more memory than there is: cut the file") from None
    except BaseException as error:
        if isinstance(error, (KeyboardInterrupt, SystemExit, GeneratorExit)):
            raise
        raise HexsimError(f"cannot read {path} as {reader.name}: {first_line(error)}") from None


def first_line(error: BaseException) -> str:
    """The first line of a library's message, that says what went wrong where it says nothing itself."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:160]


def logs_of_folder(folder: Path, layout: FileLayout | None = None) -> list[Path]:
    """The logs of a folder, sorted: files of a format, but for texts without a table."""
    found = sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
    known = [(path, readers().get(suffix_of(path))) for path in found]
    return [path for path, one in known if one is not None and one.holds_log(path, layout or FileLayout())]


def log_files(folder: Path, name: str) -> Path:
    """The file of log `name` in a machine's folder, or the path itself."""
    direct = of_a_run(Path(name))
    if reader_of(direct) is not None:
        return direct
    paths = sorted(Path(folder).iterdir()) if Path(folder).is_dir() else []
    logs = [path for path in paths if reader_of(path) is not None]
    for path in logs:
        if name in (log_name(path), path.name.partition(".")[0]):
            return path
    known = sorted({log_name(path) for path in logs})
    raise HexsimError(
        f"no log {name!r} in {folder}: it has {', '.join(known) or 'no logs'}; give one of them or a path"
    )
