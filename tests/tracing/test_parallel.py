"""Jobs on all cores, and answers that are asked for again."""

import threading
import time

import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.signals.log import Log
from hexsim.tracing.problems import problem
from hexsim.tracing.simulation import rig, simulator


@pytest.fixture(autouse=True)
def two_cores(monkeypatch):
    """The same on every computer."""
    problem._threads.cache_clear()
    monkeypatch.setattr(problem, "N_CORES", 2)
    yield
    problem._threads.cache_clear()


def test_results_come_in_the_order_of_the_jobs_and_each_job_is_done_once():
    """Of jobs of jobs too, whoever does them."""
    done = []

    def inner(job):
        done.append(job)
        time.sleep(0.002 * (job % 3))
        return job

    def outer(k):
        return problem.in_parallel(inner, range(10 * k, 10 * k + 10))

    assert problem.in_parallel(outer, range(7)) == [list(range(10 * k, 10 * k + 10)) for k in range(7)]
    assert sorted(done) == list(range(70))
    assert problem.in_parallel(inner, []) == []


def test_a_core_that_has_come_to_its_end_helps_with_the_jobs_of_a_job():
    """One long job of six parts is left: two threads do them."""
    threads = set()

    def part(_):
        threads.add(threading.get_ident())
        time.sleep(0.02)

    problem.in_parallel(lambda parts: problem.in_parallel(part, range(parts)), [1, 6])
    assert len(threads) == 2
    threads.clear()
    problem.in_parallel(lambda parts: problem.in_parallel(part, range(parts)), [6])
    assert len(threads) == 2


def test_a_job_that_fails_is_told_and_no_other_begins():
    """The error of the first job; of a hundred others, 10 ms each, no ten begin in the 0.3 s in which one thread would do thirty."""
    begun = []

    def job(k):
        begun.append(k)
        if k == 0:
            raise ValueError("the first one")
        time.sleep(0.01)

    with pytest.raises(ValueError, match="the first one"):
        problem.in_parallel(job, range(100))
    time.sleep(0.3)
    assert len(begun) < 10


def test_the_answer_of_a_machine_to_a_log_is_simulated_once(monkeypatch):
    """Asked again, the same bits without a simulation, in arrays that nobody can change; another number, start or log gives
    another answer."""
    calls = []
    answer = simulator.loop.answer
    monkeypatch.setattr(simulator.loop, "answer", lambda *given: calls.append(1) or answer(*given))
    t = np.arange(1000) / 1000.0
    setpoint = 0.1 + 0.01 * np.sin(2 * np.pi * t)[None]
    log = Log(name="once", kind="bench", time=t, rate=1000.0, setpoint=setpoint, position=setpoint)
    bench = load_machine("bench")

    def asked(machine, log=log, off_Pa=0.0):
        return simulator.simulate_log(machine, log, rig.DECLARED_LOOP, {}, off_Pa)

    first, again = asked(bench), asked(load_machine("bench"))
    assert len(calls) == 1
    assert all(np.array_equal(first[stem], again[stem]) for stem in first)
    assert not again["position"].flags.writeable
    stiffer = changed(bench, {"oil.bulk_modulus_Pa": 1.01 * bench.oil.bulk_modulus_Pa})
    late = log.head(0.9)
    for other in (asked(stiffer), asked(bench, off_Pa=1e4), asked(bench, late)):
        n = other["position"].shape[1]
        assert not np.array_equal(other["pressure_bottom"], first["pressure_bottom"][:, :n]) or n < t.size
    assert len(calls) == 4
