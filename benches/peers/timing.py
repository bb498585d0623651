"""Times of a piece of work, each tool in a process of its own so that neither memory nor threads of one weigh on the next."""

import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context


def times_s(work, repeats, warm=True):
    """Wall times, and what the last run gave. A warm-up is not counted: buffers grow, code is compiled."""
    if warm:
        work()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - began)
    return times, result


def median_s(work, repeats, warm=True):
    times, result = times_s(work, repeats, warm)
    return statistics.median(times), result


def in_own_process(function, *arguments):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()
