"""The command line, run inside the test's own process."""

from __future__ import annotations

import json
from typing import Any

from click.testing import CliRunner, Result

from taction.cli.main import main


def taction(*words: str) -> Result:
    return CliRunner().invoke(main, list(words))


def document(result: Result) -> Any:
    """The one JSON document on stdout; numbers that JSON does not know are refused."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(result.stdout, parse_constant=refuse)
