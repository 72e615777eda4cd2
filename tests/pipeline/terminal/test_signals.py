"""The signals that end a verb end it wherever they come."""

import signal
import subprocess
import sys

import pytest

_FALLS_INTO_A_FINALIZER = """
import signal, time
from pipeline.terminal.signals import end_by_exceptions

class Falls:
    def __del__(self):
        signal.raise_signal({number})

end_by_exceptions()
falls = Falls()
del falls
print("goes on", flush=True)
while True:
    time.sleep(0.1)
"""


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, -signal.SIGINT), (signal.SIGTERM, 143)])
def test_one_whose_exception_a_finalizer_drops_is_not_lost(number: signal.Signals, status: int) -> None:
    script = _FALLS_INTO_A_FINALIZER.format(number=int(number))
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert (run.returncode, run.stdout) == (status, "goes on\n")
    assert "ignored" not in run.stderr


_WHILE_IT_ENDS = """
import signal, threading, time
from pipeline.terminal.signals import end_by_exceptions

def last():
    threading.main_thread().join()
    for _ in range(20):
        signal.pthread_kill(threading.main_thread().ident, signal.SIGTERM)
        time.sleep(0.005)  # so that the main thread waits again
    print("done", flush=True)

end_by_exceptions()
threading.Thread(target=last).start()
"""


def test_one_that_comes_while_the_last_threads_end_does_not_cut_them_short() -> None:
    run = subprocess.run(
        [sys.executable, "-c", _WHILE_IT_ENDS], capture_output=True, text=True, timeout=60, check=False
    )
    assert (run.returncode, run.stdout, run.stderr) == (0, "done\n", "")
