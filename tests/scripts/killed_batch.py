import os
import signal

from batches import made_row

import ldbb_bayes as lb
import ldbb_bayes.fleet.batch as home


def fit(settings, job):
    with open("calls", "a") as handle:
        handle.write(f"{job.number}\n")
    return made_row(settings, job)


home.fit_row = fit


def kill(finished, *_):
    if finished == 7:
        os.kill(os.getpid(), signal.SIGKILL)


lb.fleet.run_batch([f"p{k}" for k in range(20)], "out", progress=kill)
