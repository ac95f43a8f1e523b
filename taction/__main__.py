"""The command ``taction``, and ``python -m taction``."""

import gc
import signal
from contextlib import suppress

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports: no traceback

from taction.cli.main import main

gc.set_threshold(100_000)  # by default 10 % of a short command: what imports make is no garbage

if __name__ == "__main__":
    main(prog_name="taction")
