"""What every test can rely on.

Ctrl-C is not ignored, as it is by what a shell without job control starts with `&`, nor a terminal that is closed, as
it is by what `nohup` starts; and no example of hypothesis fails because the machine is slow.
"""

import signal

from hypothesis import HealthCheck, settings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # child processes begin with the default then
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda number, frame: None)  # these tests go on, and their child processes do not

settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
if settings.get_current_profile_name() == "default":  # neither in CI, which has its own, nor where mutants are tried
    settings.load_profile("any machine")
