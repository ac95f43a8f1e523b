"""pytest plugin: the fixture `taction_scene`, and ``*.scene.toml`` files as tests.

pytest loads the plugin in every environment with taction, so the plugin imports no other module of
taction before a scene is verified.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import pytest

if TYPE_CHECKING:
    from taction.verification.studies.regression.regress import Entry
    from taction.verification.verdict.verify import Verdict

SUFFIX = ".scene.toml"
TactionScene: TypeAlias = "Callable[..., Verdict]"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that compares collected scenes with a baseline."""
    parser.getgroup("taction").addoption(
        "--taction-baseline",
        metavar="FILE",
        help=f"compare collected *{SUFFIX} files with this baseline of `taction regress`",
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Collect ``*.scene.toml`` files."""
    is_scene = file_path.name.endswith(SUFFIX)
    return SceneFile.from_parent(parent, path=file_path) if is_scene else None


class SceneFile(pytest.File):
    """A scene file with one test."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield the test ``verify``, or ``regress`` with a baseline, which must be readable."""
        file = self.config.getoption("--taction-baseline")
        if file is None:
            yield SceneItem.from_parent(self, name="verify", baseline={})
            return
        from taction.system.errors import InputError
        from taction.verification.studies.regression.regress import load_baseline

        try:
            baseline = load_baseline(self.config.invocation_params.dir / file)
        except InputError as error:
            raise self.CollectError(str(error)) from None
        yield SceneItem.from_parent(self, name="regress", baseline=baseline)


class SceneItem(pytest.Item):
    """The test of a scene: its verdict, and the comparison with its entry of a baseline, if any."""

    def __init__(self, *, baseline: Mapping[str, Entry], **rest: Any) -> None:
        super().__init__(**rest)
        self._entry = baseline.get(self.path.name)

    def runtest(self) -> None:
        """Verify the scene; fail without a pass, or if the baseline differs."""
        from taction.verification.report.views.comparison_view import change_line, remarks
        from taction.verification.studies.regression.regress import Status, compare_scene

        found = compare_scene(self.path, self._entry)
        if found.fails or found.status in (Status.NO_VERDICT, Status.BAD_INPUT):
            status = found.status.value if found.baseline or not found.checks else "fail"
            lines = [f"{found.file}: {status}", *remarks(found), *map(change_line, found.changes)]
            pytest.fail("\n  ".join(lines), pytrace=False)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return the file and the name of the test."""
        return self.path, None, f"{self.path.name}: {self.name}"


@pytest.fixture
def taction_scene(request: pytest.FixtureRequest) -> TactionScene:
    """Return the function ``taction_scene(path, engine=None) -> Verdict``, which verifies a scene.

    `path` is relative to the test's folder. A session verifies each scene once.
    """

    def run(path: str | Path, engine: str | None = None) -> Verdict:
        file = (request.path.parent / path).resolve()
        return _verified(file, file.stat().st_mtime_ns if file.exists() else 0, engine)

    return run


@cache
def _verified(file: Path, changed: int, engine: str | None) -> Verdict:
    import taction

    return taction.verify(file, engine=engine)
