"""The command ``taction``, and ``python -m taction``."""

from cli.main import main

if __name__ == "__main__":
    main(prog_name="taction")
