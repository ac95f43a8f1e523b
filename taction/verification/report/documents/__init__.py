"""The documents of ``--json``: types, from which the data and the published schemas follow."""
