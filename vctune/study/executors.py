"""Provide workers as a `concurrent.futures.Executor`: processes on this machine, or a Dask cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from vctune.document.text.errors import InputError
from vctune.version import __version__

PENDING_PER_WORKER = 3  # Number of points that the sweep hands out for each worker in advance
CONNECT_SECONDS = 5  # Time for which vctune tries to reach the scheduler of a running Dask cluster, s
# Environment variables of worker processes: single-threaded linear algebra, and no messages when a run is interrupted
# or killed
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
    "DASK_LOGGING__DISTRIBUTED": "critical",
}


@dataclass(slots=True)
class WorkerPool:
    """Workers that solve points."""

    executor: Executor  # executor that receives the points
    max_pending: int = 1  # greatest number of points that are handed out and not yet solved
    worker_died: tuple[type[BaseException], ...] = ()  # exceptions that mean a dead worker
    unreachable: tuple[type[BaseException], ...] = ()  # exceptions that mean an unreachable cluster
    renew: Callable[[], None] = lambda: None  # function to call after a worker has died


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def worker_pool(choice: str, jobs: int) -> Iterator[WorkerPool]:
    """Start workers or connect to them, and release them at the end of the block."""
    kind, _, address = choice.partition(":")
    if choice == "serial":
        yield WorkerPool(_Serial())
    elif choice == "processes":
        yield from _process_pool(jobs)
    elif choice == "dask" or (kind == "dask" and address):
        yield from _dask_pool(choice, address, jobs)
    elif kind == "dask":
        raise _refusal(choice, "has no address: write dask:HOST:PORT, or dask for a cluster on this machine")
    else:
        raise _refusal(choice, 'is not "serial", "processes", "dask" or "dask:ADDRESS"')


class _Serial(Executor):
    """An executor that runs work immediately in this process. It starts no process and imports no script."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(work(*args, **kwargs))
        return done


def _process_pool(jobs: int) -> Iterator[WorkerPool]:
    """Yield worker processes on this machine, and end them afterwards."""

    def started() -> ProcessPoolExecutor:
        with _for_workers():  # also for the process that tracks the semaphores of the executor
            executor = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_worker)
            for _ in range(jobs):
                executor.submit(int)  # starts a worker, as long as none is idle
        return executor

    def renew() -> None:
        pool.executor.shutdown(wait=False, cancel_futures=True)
        pool.executor = started()

    pool = WorkerPool(started(), PENDING_PER_WORKER * jobs, (BrokenExecutor,), renew=renew)
    try:
        yield pool
    except BaseException:
        pool.executor.shutdown(wait=False, cancel_futures=True)
        raise
    pool.executor.shutdown()  # wait, because idle workers could outlive the pipe that wakes them


@contextmanager
def _for_workers() -> Iterator[None]:
    """Give `ENVIRONMENT` to the processes that start in this block, and leave Ctrl-C to this one."""
    before, foremost = dict(os.environ), threading.current_thread() is threading.main_thread()
    os.environ.update(ENVIRONMENT)
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if foremost else None
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
        if handler is not None:  # also None if code other than Python installed the handler
            signal.signal(signal.SIGINT, handler)


def _begin_worker() -> None:
    """Set up a worker process: it leaves Ctrl-C to its parent and ends when its parent ends."""
    os.environ.update(ENVIRONMENT)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _dask_pool(choice: str, address: str, jobs: int) -> Iterator[WorkerPool]:
    """Yield the workers of a Dask cluster, or refuse a cluster that is absent or of another version."""
    try:
        from distributed import CancelledError, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError:
        raise _refusal(choice, "needs Dask: pip install distributed") from None
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)  # Dask's tracebacks of lost connections, which vctune's own message covers
    try:
        with _client(choice, address, jobs) as client:
            threads = sum(client.nthreads().values())
            if threads == 0:
                raise _refusal(choice, "has no workers; start some with: dask worker ADDRESS")
            _check_versions(choice, client)
            executor = client.get_executor(pure=False)
            try:
                lost = CancelledError, CommClosedError
                yield WorkerPool(executor, PENDING_PER_WORKER * threads, (KilledWorker,), lost)
            finally:
                executor.shutdown(wait=False)
    finally:
        logging.disable(before)


def _client(choice: str, address: str, jobs: int) -> Any:
    """Return a client of a new cluster on this machine, or of the cluster at an address."""
    from distributed import Client

    if not address:
        with _for_workers():
            return Client(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
    try:
        return Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise _refusal(choice, f"the scheduler cannot be reached: {error}") from None


def _check_versions(choice: str, client: Any) -> None:
    """Check that every worker runs this version of vctune, because another version would give different rows."""
    try:
        versions = ", ".join(sorted(set(client.run(_version).values())))
    except Exception as error:  # each reason why a worker cannot run vctune raises a different exception
        versions = f"none that runs ({error})"
    if versions != __version__:
        raise _refusal(choice, f"its workers need vctune {__version__} and have {versions}; install it on each of them")


def _version() -> str:
    return __version__


def _refusal(choice: str, message: str) -> InputError:
    return InputError.of(f"executor {choice}", "no-workers", message)
