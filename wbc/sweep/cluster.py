"""Workers that do the runs: of an embedded cluster, or of a scheduler that runs already."""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from wbc import checks
from wbc.errors import InvalidInput
from wbc.sweep.plan import Trial
from wbc.sweep.trial import done

#: Runs that are handed out ahead for each thread of the workers, so that none waits.
AHEAD = 3
#: How often a run may cost its worker before that is its result. Dask itself tries each hand-out a few times.
TRIES = 3
CONNECT = "20s"


def do_all(
    trials: Iterator[Trial], take: Callable[[dict[str, Any]], None], *, scheduler: str | None, workers: int
) -> None:
    """Do the trials and give each result to ``take`` as soon as it is there, in any order.

    Runs of a worker that dies are given to another one. ``scheduler``: its address; without one, ``workers`` processes
    on this machine, each with one thread.

    Raises:
        NotSupported: the extra ``sweep`` is not installed.
        InvalidInput: nobody answers at that address.
    """
    checks.packages("a sweep", "distributed", extra="sweep")
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    with _client(scheduler, workers) as client:
        threads = max(1, sum(client.nthreads().values()))
        tries: dict[int, int] = {}
        pending: dict[Any, Trial] = {}
        completed: Any = as_completed(loop=client.loop)  # type: ignore[no-untyped-call]

        def hand_out(trial: Trial) -> None:
            tries[trial.run] = tries.get(trial.run, 0) + 1
            future = client.submit(done, trial, pure=False)
            pending[future] = trial
            completed.add(future)

        for _, trial in zip(range(AHEAD * threads), trials, strict=False):
            hand_out(trial)
        for future in completed:
            trial = pending.pop(future)
            try:
                line = future.result()  # asked once: what a worker has done is lost if it dies before it is fetched
            except Exception as error:  # of a run, whatever it is, or of its worker
                if isinstance(error, KilledWorker) and tries[trial.run] < TRIES:
                    hand_out(trial)
                    continue
                line = {
                    "run": trial.run, "solver": trial.solver, "ok": False, "error": f"{type(error).__name__}: {error}",
                }  # fmt: skip
            take(line)
            future.release()
            following = next(trials, None)
            if following is not None:
                hand_out(following)


@contextmanager
def _client(scheduler: str | None, workers: int) -> Iterator[Any]:
    import dask
    from distributed import Client, LocalCluster

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers that die are our business
    with dask.config.set({"distributed.comm.timeouts.connect": CONNECT}):
        if scheduler is not None:
            try:
                client = Client(scheduler, set_as_default=False)  # type: ignore[no-untyped-call]
            except (OSError, ValueError, TimeoutError) as cause:
                raise InvalidInput(f"no scheduler answers at {scheduler}: {cause}") from cause
            with client:
                yield client
            return
        # Ctrl-C reaches all processes of a terminal. Workers, which have the mask of the thread that starts them, are
        # ended by this one, and in silence. The tracker unblocks the signal in the thread that starts it.
        resource_tracker.ensure_running()
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            cluster = LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )  # fmt: skip
            client = Client(cluster, set_as_default=False)  # type: ignore[no-untyped-call]
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        with cluster, client:
            yield client
