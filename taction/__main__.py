"""The command ``taction``, and ``python -m taction``."""

import atexit
import gc
import signal
from contextlib import suppress

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports: no traceback

from taction.cli.main import main

# What imports make is no garbage. To look for some costs 10 % of a short command, and a fifth at
# its end, where Python looks at all that is left.
gc.set_threshold(100_000)
atexit.register(gc.freeze)

if __name__ == "__main__":
    main(prog_name="taction")
