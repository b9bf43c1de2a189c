"""A foreign FMU in a process of its own: native code that may hang, crash, exit or leak without taking hexsim with it.

The process gets JSON over its standard input and output, each message after its length in 4 bytes; nothing is unpickled.
It may take `memory_bytes`, and ends with the process that began it. It is no sandbox: the code runs with the user's rights,
so it runs only where the user says `--allow-native` (in Python: allow_native=True).
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import signal
import stat
import struct
import subprocess
import sys
import tempfile
import threading
import time
import weakref
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from hexsim.errors import HexsimError, shortened


class Allowed(NamedTuple):
    """What a foreign FMU may take."""

    open_s: float = 10.0  # to unpack and initialise; compiled models take well below a second
    step_s: float = 5.0  # for one step of milliseconds
    unpacked_bytes: int = 1 << 30  # on disk


ALLOWED = Allowed()

LENGTH = struct.Struct("<I")


class ForeignFmu:
    """An FMU of version 2.0 or 3.0 for co-simulation, opened and described; `start` before the first `step`.

    what: how sentences call it. variables: name -> (reference, causality) of its real numbers. Every method raises
    HexsimError where the FMU fails, takes longer than its limit, or its process ends; after that it is closed. Use `close`,
    or let it be collected.
    """

    def __init__(
        self,
        path: Path,
        *,
        allow_native: bool,
        what: str = "FMU",
        begin_s: float = 60.0,  # for Python and FMPy to load, on a slow disk
    ) -> None:
        self.path, self._name = Path(path), f"{what} {Path(path).name}"
        if not allow_native:
            raise HexsimError(
                f"{self.path} is native code, which may do whatever you may: if you trust it, give --allow-native "
                "(in Python: allow_native=True)"
            )
        if importlib.util.find_spec("fmpy") is None:
            raise HexsimError("a foreign FMU needs FMPy: pip install 'hexsim[fmu]'")
        if not os.path.isfile(self.path):
            raise HexsimError(f"there is no FMU {shortened(str(self.path))}")
        self._deadline, self._is_late = float("inf"), False
        folder = tempfile.mkdtemp(prefix="hexsim-fmu-")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "hexsim.foreign_fmu", folder, str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path), "OMP_NUM_THREADS": "1"},
        )
        self.close = weakref.finalize(self, _end, self._process, folder)
        threading.Thread(target=_watch, args=(weakref.ref(self),), daemon=True).start()
        self._receive(begin_s, "begins")
        told = self._ask(ALLOWED.open_s, "is unpacked", do="open", path=os.path.abspath(self.path))
        self.variables: dict[str, tuple[int, str]] = {
            str(name): (int(reference), str(causality)) for name, reference, causality in told["variables"]
        }

    def start(self, inputs: list[int], outputs: list[int]) -> list[float]:
        """Instantiate and initialise it at time 0; the outputs [references] there."""
        return self._values(ALLOWED.open_s, "is initialised", do="start", inputs=inputs, outputs=outputs)

    def step(self, time_s: float, step_s: float, inputs: list[float]) -> list[float]:
        """Set the inputs, step from `time_s`, and give the outputs."""
        return self._values(
            ALLOWED.step_s, f"steps from {time_s:g} s", do="step", time_s=time_s, step_s=step_s, values=inputs
        )

    def _values(self, limit_s: float, doing: str, **request: Any) -> list[float]:
        return [float(value) for value in self._ask(limit_s, doing, **request)["values"]]

    def _ask(self, limit_s: float, doing: str, **request: Any) -> dict[str, Any]:
        with suppress(OSError):  # a process that has ended is noticed at its answer
            assert self._process.stdin is not None
            _send(self._process.stdin, request)
        return self._receive(limit_s, doing)

    def _receive(self, limit_s: float, doing: str) -> dict[str, Any]:
        self._deadline = time.monotonic() + limit_s
        assert self._process.stdout is not None
        try:
            answer = _receive(self._process.stdout)
        except (EOFError, OSError, ValueError):
            self._deadline = float("inf")
            self.close()
            how = f"takes longer than {limit_s:g} s" if self._is_late else f"ends its process ({_how(self._process)})"
            raise HexsimError(f"{self._name} {how} while it {doing}") from None
        except BaseException:
            self.close()
            raise
        self._deadline = float("inf")
        if "error" in answer:
            self.close()
            raise HexsimError(f"{self._name} fails while it {doing}: {answer['error']}")
        return answer


def _watch(
    reference: weakref.ref[ForeignFmu],
    *,
    late_check_s: float = 0.05,  # between two looks whether it hangs
) -> None:
    """Kill the process once it is late; end with it."""
    while (fmu := reference()) is not None and fmu._process.poll() is None:
        if time.monotonic() > fmu._deadline:
            fmu._is_late = True
            _kill(fmu._process)
            return
        del fmu
        time.sleep(late_check_s)


def _kill(process: subprocess.Popen[bytes]) -> None:
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)  # and what it has begun
        else:
            process.kill()


def _end(process: subprocess.Popen[bytes], folder: str) -> None:
    """Kill the process and remove what it has unpacked."""
    _kill(process)
    process.wait()
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):
            assert stream is not None
            stream.close()
    shutil.rmtree(folder, ignore_errors=True)


def _how(process: subprocess.Popen[bytes]) -> str:
    code = process.wait()
    return f"signal {signal.Signals(-code).name}" if -code in set(signal.Signals) else f"exit code {code}"


def _send(stream: IO[bytes], message: dict[str, Any]) -> None:
    data = json.dumps(message).encode()
    stream.write(LENGTH.pack(len(data)) + data)
    stream.flush()


def _receive(
    stream: IO[bytes],
    *,
    message_bytes: int = 64 << 20,  # of a reply: more than the variables of any FMU
) -> dict[str, Any]:
    """The next message. EOFError at the end, ValueError for what is none."""
    head = stream.read(LENGTH.size)
    if len(head) < LENGTH.size:
        raise EOFError
    (length,) = LENGTH.unpack(head)
    if length > message_bytes:
        raise ValueError("too long")
    data = stream.read(length)
    if len(data) < length:
        raise EOFError
    message = json.loads(data)
    if not isinstance(message, dict):
        raise ValueError("no message")
    return message


# in the process of the FMU
class Opened:
    """What the process holds."""

    def __init__(self, folder: str) -> None:
        self.folder = folder
        self.fmu: Any = None

    def open(self, path: str) -> dict[str, Any]:
        import fmpy

        _check_archive(path)
        fmpy.extract(path, unzipdir=self.folder)
        self.description: Any = fmpy.read_model_description(self.folder)
        reals = [v for v in self.description.modelVariables if v.type in ("Real", "Float64")]
        return {"variables": [(v.name, v.valueReference, v.causality) for v in reals]}

    def start(self, inputs: list[int], outputs: list[int]) -> dict[str, Any]:
        from fmpy.simulation import instantiate_fmu

        self.inputs, self.outputs = inputs, outputs
        self.fmu = instantiate_fmu(self.folder, self.description, fmi_type="CoSimulation")
        if str(self.description.fmiVersion).startswith("3"):
            self.get, self.put = self.fmu.getFloat64, self.fmu.setFloat64
            self.fmu.enterInitializationMode(startTime=0.0)
        else:
            self.get, self.put = self.fmu.getReal, self.fmu.setReal
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self._given()

    def step(self, time_s: float, step_s: float, values: list[float]) -> dict[str, Any]:
        if self.inputs:
            self.put(self.inputs, values)
        self.fmu.doStep(currentCommunicationPoint=time_s, communicationStepSize=step_s)
        return self._given()

    def _given(self) -> dict[str, Any]:
        return {"values": [float(value) for value in self.get(self.outputs)] if self.outputs else []}


def _check_archive(
    path: str,
    *,
    most_files: int = 10_000,  # files in an FMU
) -> None:
    """Refuse what unpacks to too much, or elsewhere."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if len(members) > most_files or sum(member.file_size for member in members) > ALLOWED.unpacked_bytes:
        raise ValueError(f"it holds more than {most_files} files or {ALLOWED.unpacked_bytes >> 30} GB")
    for member in members:
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or not parts[0] or ":" in parts[0] or stat.S_ISLNK(member.external_attr >> 16):
            raise ValueError(f"its member {shortened(repr(member.filename))} leads out of it")


def _end_with(parent: int, folder: str) -> None:
    """End when the process that began this one is gone."""
    while os.getppid() == parent:
        time.sleep(0.5)
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _limit_memory(
    *,
    memory_bytes: int = 2 << 30,  # of the process
) -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_FSIZE, (ALLOWED.unpacked_bytes, ALLOWED.unpacked_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> None:
    """The process: messages in, messages out, until the input ends. What the FMU prints goes nowhere."""
    folder, parent = sys.argv[1], int(sys.argv[2])
    receiving, sending = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1, 2):
        os.dup2(nowhere, number)
    if os.name != "nt":
        threading.Thread(target=_end_with, args=(parent, folder), daemon=True).start()
    import fmpy.simulation

    _limit_memory()
    opened = Opened(folder)
    _send(sending, {"fmpy": fmpy.__version__})
    while True:
        try:
            request = _receive(receiving)
        except EOFError:
            os._exit(0)
        try:
            answer = getattr(opened, request.pop("do"))(**request)
        except Exception as error:  # FMPy raises many kinds on foreign files
            answer = {"error": shortened(" ".join(f"{type(error).__name__}: {error}".split()), 300)}
        _send(sending, answer)


if __name__ == "__main__":
    main()
