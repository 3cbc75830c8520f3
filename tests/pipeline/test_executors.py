"""Executors: in this process or in spawned ones."""

from __future__ import annotations

import operator
import os
import signal
from concurrent.futures import ProcessPoolExecutor

import pytest

from pipeline.executors import ONE_THREAD, SerialExecutor, default_jobs, make_executor


@pytest.fixture(autouse=True)
def _environment(monkeypatch):
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "8")


def test_serial_runs_at_once_in_this_process():
    with make_executor(1) as executor:
        assert isinstance(executor, SerialExecutor)
        future = executor.submit(os.getpid)
        assert future.done()
        assert future.result() == os.getpid()
        assert list(executor.map(operator.add, [1, 2], [3, 4])) == [4, 6]


def test_serial_keeps_an_error_in_its_future():
    future = SerialExecutor().submit(operator.truediv, 1, 0)
    with pytest.raises(ZeroDivisionError):
        future.result()


def interrupt():
    raise KeyboardInterrupt


def test_serial_does_not_keep_an_interruption():
    with pytest.raises(KeyboardInterrupt):
        SerialExecutor().submit(interrupt)


def test_a_pool_runs_elsewhere_with_one_thread_and_leaves_interrupts_to_the_parent():
    with make_executor(2) as executor:
        assert isinstance(executor, ProcessPoolExecutor)
        assert executor.submit(os.getpid).result(timeout=60) != os.getpid()
        assert executor.submit(os.getenv, "OPENBLAS_NUM_THREADS").result(timeout=60) == "1"
        assert executor.submit(signal.getsignal, signal.SIGINT).result(timeout=60) == signal.SIG_IGN


def test_default_jobs(monkeypatch):
    assert default_jobs() >= 1
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert default_jobs() == 1
