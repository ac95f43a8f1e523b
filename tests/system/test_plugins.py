"""What other packages offer: found when it is asked for, checked, and named when it is wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from taction.system.errors import InputError
from taction.system.plugins import OpenTable, names
from taction.verification.studies.running import versions
from taction.verification.studies.running.versions import own_code
from tests.support.packages import environment
from tests.support.running import python

Plugin = Callable[..., Path]
NUMBERS = {"taction.opamps": {"seven": "SEVEN", "eight": "EIGHT"}}
SOURCE = "SEVEN, EIGHT = 7, 8\n"


def table(own: dict[str, int] | None = None) -> OpenTable[int]:
    return OpenTable("taction.opamps", {"one": 1} if own is None else own, int)


def test_what_a_package_offers_follows_the_own_entries(plugin: Plugin) -> None:
    numbers = table()
    assert list(numbers) == ["one"]
    plugin("acme", NUMBERS, SOURCE)
    assert list(numbers) == ["one", "eight", "seven"]
    assert "seven" in numbers
    assert len(numbers) == 3
    assert "acme" not in sys.modules  # a name loads no module
    assert numbers["seven"] == 7
    assert names("taction.opamps") == ("eight", "seven")
    assert names("taction.engines") == ()


WRONG = {
    "an object of another class": (SOURCE, int, str, "acme:SEVEN is a int; expected str"),
    "a class for an object": ("class SEVEN:\n    pass\n", int, int, "SEVEN; expected int"),
    "no such attribute": ("", int, int, "acme:SEVEN cannot be loaded: AttributeError"),
    "a module that fails": ("1 / 0\n", int, int, "ZeroDivisionError: division by zero"),
    "a module that does not parse": ("SEVEN =\n", int, int, "SyntaxError"),
    "another name": ("class SEVEN:\n    name = '9'\n", int, object, "has the other name '9'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_object_is_refused_by_its_name(case: str, plugin: Plugin) -> None:
    source, _, kind, message = WRONG[case]
    plugin("acme", {"taction.opamps": {"seven": "SEVEN"}}, source)
    numbers = OpenTable("taction.opamps", {"one": 1}, kind)
    assert "seven" in numbers  # nothing is loaded yet
    with pytest.raises(InputError) as refused:
        numbers["seven"]
    assert str(refused.value).startswith("plug-in acme 1.0: taction.opamps = 'seven': ")
    assert message in str(refused.value)
    assert numbers["one"] == 1


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("seven", r"acme 1\.0: .* 'seven': taction itself has"),
        ("Se-ven", "'Se-ven': a name is a lower-case letter"),
    ],
)
def test_a_name_is_one_word_that_taction_lacks(name: str, says: str, plugin: Plugin) -> None:
    plugin("acme", {"taction.opamps": {name: "SEVEN"}}, SOURCE)
    with pytest.raises(InputError, match=says):
        list(table({"seven": 0}))


def test_two_packages_cannot_offer_one_name(plugin: Plugin) -> None:
    plugin("acme", NUMBERS, SOURCE)
    plugin("zenith", {"taction.opamps": {"seven": "SEVEN"}}, SOURCE, version="2.1")
    with pytest.raises(InputError, match=r"zenith 2\.1: .*'seven': the plug-in acme 1\.0 offers"):
        table()["one"]


def test_a_changed_plugin_makes_stored_results_outdated(plugin: Plugin) -> None:
    alone = own_code()
    folder = plugin("acme", NUMBERS, SOURCE)
    first = own_code()
    assert first != alone
    script = f"from {versions.__name__} import own_code as f; print(f().hex())"
    found = set()
    for source in (SOURCE, SOURCE + "# another\n"):
        (folder / "acme.py").write_text(source, "utf-8")
        found.add(python("-c", script, env=environment(folder)).stdout.strip())
    assert len(found) == 2
    assert first.hex() in found


HELP = """
import contextlib
from taction.system import plugins
from taction.cli.main import main
with contextlib.suppress(SystemExit):
    main(["--help"])
assert plugins.offers.cache_info().misses == 0
"""


def test_help_looks_for_no_plugin(plugin: Plugin) -> None:
    folder = plugin("acme", NUMBERS, SOURCE)
    run = python("-c", HELP, env=environment(folder))
    assert run.returncode == 0, run.stderr
    assert "verify" in run.stdout
