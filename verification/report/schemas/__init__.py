"""The documents of ``--json`` as models, from which their published schemas are made."""
