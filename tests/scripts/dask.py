import json
import os
import signal
import sys
from pathlib import Path

import ldbb_bayes.parallel.dask_workers as home
from ldbb_bayes.errors import InputError
from ldbb_bayes.parallel import Lost, dask_executor, done


def job(x):
    if x == 5 and not Path(sys.argv[1], "died").exists():
        Path(sys.argv[1], "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if x == 9:
        os.kill(os.getpid(), signal.SIGKILL)
    return (max, [x * x, 0])  # Dask would take this for a task of its own, if it looked into it


if __name__ == "__main__":
    with dask_executor(workers=2) as executor:
        client = executor._client
        gather = executor._client._gather

        async def lost_once_gathered(futures, **options):
            result = await gather(futures, **options)
            key = getattr(futures, "key", None) or futures[0].key
            client.futures[key].lose()
            return result

        client._gather = lost_once_gathered
        results = dict(done(job, range(20), executor))
    lost = []
    correct = True
    for k, result in results.items():
        if isinstance(result, Lost):
            lost.append(k)
        elif result != (max, [k * k, 0]):
            correct = False
    print(json.dumps([sorted(results), lost, correct]))
    home.ANSWER_S = 1.0
    import distributed

    other = distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    )
    for address in ("nonsense", "tcp://127.0.0.1:1", other.scheduler_address):
        try:
            with dask_executor(address):
                pass
        except InputError as error:
            print(error)
