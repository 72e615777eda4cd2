"""Threads that end with the block that they belong to, wherever an exception cuts it short."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def background_thread(
    target: Callable[[], object], *, name: str, stop: Callable[[], object], daemon: bool = True
) -> Iterator[None]:
    """Run a function on a thread of its own while the block runs, and wait for its end.

    A signal raises its exception anywhere: while the thread starts, and while it is stopped. Whatever is cut short,
    the thread is stopped. That holds for a block that is never left, too, whose generator is dropped: so the thread
    must hold nothing by which what this returns is reached. It does not hold within Python's own locks: one that was
    just taken there is never released.

    Parameters
    ----------
    target : callable
        Runs on the thread. Returns once it is stopped, be that before it has begun.
    name : str
        Name of the thread.
    stop : callable
        Has `target` return; may be called twice.
    daemon : bool
        Whether an interpreter that ends does not wait for the thread.
    """
    thread = threading.Thread(target=target, name=name, daemon=daemon)
    try:
        thread.start()
        yield
    finally:
        try:
            stop()
        except BaseException:  # of a signal, which may have come before anything was done
            stop()
            raise
        if thread.is_alive():  # one that was cut short while it started may be about to begin
            thread.join()


@contextmanager
def periodic_thread(action: Callable[[], object], *, name: str, every_s: float) -> Iterator[None]:
    """Call a function again and again on a thread of its own while the block runs; as `background_thread` ends.

    Parameters
    ----------
    action : callable
        What is done.
    name : str
        Name of the thread.
    every_s : float
        Time until it is done first, and from the end of one time to the next [s].
    """
    over = threading.Event()

    def repeat() -> None:
        while not over.wait(every_s):
            action()

    with background_thread(repeat, name=name, stop=over.set):
        yield
