"""Work in forks of this process: each gives back a few texts, or is ended by its limit of processor time."""

import json
import os
import resource
import select
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterable
from typing import IO, Any, NamedTuple, TypeVar

_Key = TypeVar("_Key")

OUT_OF_TIME = "out of time"
_HANGS_AFTER_S = 3600.0  # whoever waits for ever takes no processor time; a test that waits is ended by pytest before


class Task(NamedTuple):
    """Work for a fork: its result is something that JSON has."""

    work: Callable[[], Any]
    seconds: int  # of processor time


class _Fork(NamedTuple):
    process: int
    handle: int  # becomes readable at the end of the process
    result: IO[str]  # a file without a name


def run_in_forks(tasks: Iterable[tuple[_Key, Task]], *, processes: int, done: Callable[[_Key, Any], None]) -> None:
    """Run tasks in forks, so many at a time; `done` is called with each result as it comes.

    The result of a fork that was ended by its limit, or by a signal, is the text `OUT_OF_TIME`, or the signal's name.
    """
    running: dict[int, tuple[_Key, _Fork]] = {}
    for key, task in tasks:
        if len(running) == processes:
            _take_one(running, done)
        fork = _start(task)
        running[fork.handle] = key, fork
    while running:
        _take_one(running, done)


def limit_processor_time(seconds: int) -> None:
    """End this process once it has taken so much more of it."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(used.ru_utime + used.ru_stime) + seconds
    resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))


def _take_one(running: dict[int, tuple[_Key, _Fork]], done: Callable[[_Key, Any], None]) -> None:
    ended, _, _ = select.select(list(running), [], [], _HANGS_AFTER_S)
    for handle in ended or list(running):
        key, fork = running.pop(handle)
        done(key, _result(fork))


def _start(task: Task) -> _Fork:
    file = tempfile.TemporaryFile("w+")  # noqa: SIM115  # whoever takes the result closes it
    process = os.fork()
    if process == 0:
        _work(task, file)
    return _Fork(process, os.pidfd_open(process), file)


def _work(task: Task, file: IO[str]) -> None:
    """Run in the fork, which ends here."""
    try:
        os.setpgid(0, 0)
        nothing = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(nothing, number)
        limit_processor_time(task.seconds)
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        result = task.work()
    except BaseException:
        result = traceback.format_exc()
    json.dump(result, file)
    file.flush()
    os._exit(0)


def _result(fork: _Fork) -> Any:
    if not select.select([fork.handle], [], [], 0)[0]:
        os.kill(fork.process, signal.SIGKILL)
    _, status = os.waitpid(fork.process, 0)
    os.close(fork.handle)
    _end_group(fork.process)
    with fork.result as file:
        file.seek(0)
        text = file.read()
    if os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        return OUT_OF_TIME if name in ("SIGXCPU", "SIGKILL") else name
    return json.loads(text)


def _end_group(process: int) -> None:
    """End what the fork started and did not end."""
    try:
        os.killpg(process, signal.SIGKILL)
    except ProcessLookupError:
        return
