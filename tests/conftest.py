"""What every test can rely on: Ctrl-C is not ignored, as it is by what a shell without job control starts with `&`."""

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # child processes begin with the default then
