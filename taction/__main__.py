"""The command ``taction``, and ``python -m taction``."""

import signal
import sys
import warnings
from contextlib import suppress

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    with suppress(ValueError):  # not the main thread
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C during the imports: no traceback

if not sys.warnoptions:
    warnings.simplefilter("ignore")  # of libraries, for programmers; `python -W error` has them

from taction.cli.main import main

if __name__ == "__main__":
    main(prog_name="taction")
