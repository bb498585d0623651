"""Times a piece of work. Each tool runs in its own process, so that memory and threads of one do not affect the next."""

import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context


def times_s(work, repeats, warm=True):
    """Wall times, and the result of the last run. A warm-up, in which buffers grow and code is compiled, is not counted."""
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
