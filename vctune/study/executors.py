"""Workers: processes of this machine or a Dask cluster, both as a `concurrent.futures.Executor`.

Workers end when the process that started them does, however it ends, and leave Ctrl-C to it.
"""

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
from functools import partial
from multiprocessing.connection import wait
from multiprocessing.context import BaseContext
from typing import Any

from vctune.document.text.errors import InputError
from vctune.version import __version__

PENDING_PER_WORKER = 3
"""Points handed out for each worker, so that none waits for its next one: solving takes tens of milliseconds at least,
handing one out takes one. With half as many a worker on another machine may wait; with twice as many none does less."""
CONNECT_SECONDS = 5
ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "PYTHONWARNINGS": "ignore:resource_tracker:UserWarning",
    "DASK_LOGGING__DISTRIBUTED": "critical",
}
"""Environment of worker processes: single-threaded linear algebra, and no complaints when a run is interrupted or
killed."""


@dataclass(slots=True)
class WorkerPool:
    """Workers that solve points.

    Attributes
    ----------
    executor : to submit to
    max_pending : number of points to hand out at once
    worker_died : exceptions of a dead worker
    unreachable : exceptions of an unreachable cluster
    renew : function that renews the executor after a worker has died
    """

    executor: Executor
    max_pending: int
    worker_died: tuple[type[BaseException], ...]
    unreachable: tuple[type[BaseException], ...]
    renew: Callable[[], None]


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def worker_pool(choice: str, jobs: int) -> Iterator[WorkerPool]:
    """Start workers, or join them, and let them go at the end.

    Parameters
    ----------
    choice : "serial" for this process alone, "processes", "dask" for a Dask cluster of this machine, "dask:ADDRESS" for
        a running one
    jobs : number of workers to start

    Returns
    -------
    context manager
        Of the pool.

    Raises
    ------
    InputError
        If there is no such executor or its scheduler cannot be reached.
    """
    kind, _, address = choice.partition(":")
    if kind == "dask":
        with _dask_pool(choice, address, jobs) as pool:
            yield pool
    elif choice == "processes":
        with _process_pool(jobs) as pool:
            yield pool
    elif choice == "serial":
        yield WorkerPool(_Serial(), 1, (), (), lambda: None)
    else:
        raise _refusal(choice, 'is not "serial", "processes", "dask" or "dask:ADDRESS"')


class _Serial(Executor):
    """An executor that works at once in this process: nothing to start, no script for workers to import."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(work(*args, **kwargs))
        return done


@contextmanager
def _process_pool(jobs: int) -> Iterator[WorkerPool]:
    with _for_workers():
        context = _context()
    start = partial(ProcessPoolExecutor, jobs, mp_context=context, initializer=_begin_worker)

    def renew() -> None:
        pool.executor.shutdown(wait=False, cancel_futures=True)
        pool.executor = start()

    pool = WorkerPool(start(), PENDING_PER_WORKER * jobs, (BrokenExecutor,), (), renew)
    try:
        yield pool
    except BaseException:
        pool.executor.shutdown(wait=False, cancel_futures=True)
        raise
    pool.executor.shutdown()  # idle workers end at once; not waited for, they may outlive the pipe that wakes them


def _context() -> BaseContext:
    """Return how processes are started: from a server that has imported the solver, where there can be one.

    The server passes on its start environment.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing.forkserver import ensure_running

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["vctune.study.row"])
    ensure_running()
    return context


@contextmanager
def _for_workers() -> Iterator[None]:
    """Let processes that start in this block have `ENVIRONMENT` and ignore Ctrl-C, as this one does meanwhile."""
    before, foremost = dict(os.environ), threading.current_thread() is threading.main_thread()
    os.environ.update(ENVIRONMENT)
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if foremost else None
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
        if foremost:
            signal.signal(signal.SIGINT, handler)


def _begin_worker() -> None:
    """Begin a worker process: leave Ctrl-C to the parent, and end when the parent does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _dask_pool(choice: str, address: str, jobs: int) -> Iterator[WorkerPool]:
    try:
        from distributed import CancelledError, KilledWorker
        from distributed.comm import CommClosedError
    except ImportError:
        raise _refusal(choice, "needs Dask: pip install distributed") from None
    with _no_logs(), _client(choice, address, jobs) as client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise _refusal(choice, "has no workers; start some with: dask worker ADDRESS")
        _check_versions(choice, client)
        executor = client.get_executor(pure=False)
        try:
            yield WorkerPool(
                executor, PENDING_PER_WORKER * threads, (KilledWorker,), (CancelledError, CommClosedError), lambda: None
            )
        finally:
            executor.shutdown(wait=False)


@contextmanager
def _no_logs() -> Iterator[None]:
    """Keep Dask's tracebacks of lost connections from stderr: our own message covers them."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


@contextmanager
def _client(choice: str, address: str, jobs: int) -> Iterator[Any]:
    from distributed import Client, LocalCluster

    if not address:
        with _for_workers():
            cluster = LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
        with cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise _refusal(choice, f"the scheduler cannot be reached: {error}") from None
    with client:
        yield client


def _check_versions(choice: str, client: Any) -> None:
    """Make sure that every worker has this vctune: another one would make other rows."""
    try:
        versions = ", ".join(sorted(set(client.run(_version).values())))
    except Exception as error:  # whatever keeps a worker from running vctune comes back as its own kind of failure
        versions = f"none that runs ({error})"
    if versions != __version__:
        raise _refusal(choice, f"its workers need vctune {__version__} and have {versions}; install it on each of them")


def _version() -> str:
    return __version__


def _refusal(choice: str, message: str) -> InputError:
    return InputError.of(f"executor {choice}", "no-workers", message)
