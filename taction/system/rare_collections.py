"""Importing this module makes Python's collector of garbage run rarely, as a command wants it.

What imports make is no garbage, and Python's own threshold looks at it some hundred times: a fifth
of the imports of `verify`. The first collection now comes after the end of a short command. At the
end of a process Python would look at all that is left, a tenth of a short command; what is frozen
is not looked at.
"""

import atexit
import gc

gc.set_threshold(200_000)
atexit.register(gc.freeze)
