"""Where cases run: in this process, on a pool of processes, or on a Dask cluster. The results are the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence

from groupstart.regress.case import Case, Result, run_case

Done = Callable[[Result], None]
RETRIES = 2


class SchedulerError(Exception):
    """The cluster cannot be used."""


def run_cases(cases: Sequence[Case], workers: int | None, scheduler: str | None) -> Iterator[Result]:
    """Results as they come. workers: None for one a core, 1 for this process. Raises SchedulerError."""
    if scheduler is not None:
        yield from _on_cluster(cases, scheduler)
    elif workers == 1 or len(cases) == 1:
        yield from map(run_case, cases)
    else:
        yield from _on_pool(cases, workers)


def _on_pool(cases: Sequence[Case], workers: int | None) -> Iterator[Result]:
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    # a fresh interpreter for each worker: what this process holds (threads, compiled code) stays out of the results
    context = get_context("spawn")
    with ProcessPoolExecutor(min(workers or os.cpu_count() or 1, len(cases)), mp_context=context) as pool:
        waiting = [pool.submit(run_case, case) for case in cases]
        try:
            for future in as_completed(waiting):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _on_cluster(cases: Sequence[Case], scheduler: str) -> Iterator[Result]:
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise SchedulerError("--scheduler needs dask.distributed: pip install 'groupstart[dask]'") from None
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise SchedulerError(f"{scheduler}: {error}") from None
    with client:
        futures = client.map(run_case, cases, pure=False, retries=RETRIES)
        for _, result in as_completed(futures, with_results=True):
            yield result
