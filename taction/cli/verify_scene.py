"""``taction verify SCENE``: the verdict is printed when it is known, then what mends it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import taction
from taction.cli.command import Call, load
from taction.cli.running import is_of_stdout
from taction.cli.terminal import StageLine, put, say
from taction.system.after_result import attempt
from taction.system.errors import Interrupted

if TYPE_CHECKING:
    from taction.verification.design.remedies import Remedies

DOCUMENT = "verification.report.documents.verdict:verdict_document"


@dataclass(frozen=True, slots=True)
class Verified:
    """The verdict of one scene, with what the options of ``taction verify`` add."""

    verdict: taction.Verdict
    remedies: Remedies | None
    document: dict[str, Any]

    @property
    def outcome(self) -> str:
        """Of the verdict."""
        return str(self.verdict.outcome.value)


def verify_scene(call: Call, progress: StageLine) -> Verified:
    """Verify the scene, print the verdict, and search for changes if it fails."""
    options = call.options
    verdict = taction.verify(
        options["scenes"][0],
        engine=options["engine"],
        settings=options["settings"],
        progress=progress,
    )
    for text in verdict.scene.written_questions * bool(options["settings"]):
        say(text)
    document: dict[str, Any] = {}
    if call.as_json or options["margins"] or options["annotate"]:
        document = load(DOCUMENT + "_with_margins" * bool(options["margins"]))(verdict)
    found = Verified(verdict, None, document)

    def show(lines: Sequence[Any]) -> None:
        """Print on stdout; a reader who has gone is met at the end, after the files."""
        with progress.aside(), suppress(BrokenPipeError):
            for line in lines:
                put(line)

    if call.as_json:
        return _searched(found, options, progress, lambda line: None)
    lines = ChangeLines(lambda line: show([line]), whole=options["verbose"])
    attempt("the text", lambda: show(_body(found, options)), None, say, is_of_stdout)
    found = _searched(found, options, progress, lines.add)
    attempt("the changes", lambda: lines.end(changes_text(found)), None, say, is_of_stdout)
    return found


def _searched(
    found: Verified,
    options: dict[str, Any],
    progress: StageLine,
    tell: Callable[[str], None],
) -> Verified:
    """Return the verdict with the changes that mend it."""
    given = {name: options[name] for name in ("changes", "any_part")}

    def search() -> Remedies | None:
        return taction.what_to_change(found.verdict, **given, progress=progress, tell=tell)

    try:
        return replace(found, remedies=attempt("the search for changes", search, None, say))
    except KeyboardInterrupt:
        raise Interrupted("the verdict stands, the search for changes was ended", found) from None


def _body(found: Verified, options: dict[str, Any]) -> list[Any]:
    """Return what is printed of a verdict, without its last line."""
    from taction.verification.report.renderers.terminal import page_lines
    from taction.verification.report.views.checks import margin_lines

    margins = tuple(margin_lines(found.document))
    if options["verbose"]:
        from taction.verification.report.views.verdict import view

        page = view(found.verdict, notes=margins, verbose=True)
    else:
        from taction.verification.report.views.verdict_screen import screen

        searched = found.outcome == "fail" and options["changes"] != 0
        page = screen(found.verdict, margins, searched=searched)
    return [*page_lines(page)][:-1]


def changes_text(found: Verified) -> str:
    """Return the changes that mend a verdict as lines, the first of which introduces the others."""
    if found.remedies is None:
        return ""
    from taction.verification.report.views.remedies import remedies_text

    return remedies_text(found.verdict.scene, found.remedies)


def print_outcome(found: Verified) -> None:
    """Print the last line."""
    from taction.verification.report.renderers.terminal import outcome_line

    put(outcome_line(found.outcome))


@dataclass(slots=True)
class ChangeLines:
    """The changes that mend a verdict, each printed when it is found.

    Attributes
    ----------
    show : callable
        Prints a line.
    whole : bool
        Whether all lines are printed, not only those that fit on the screen.
    """

    show: Callable[[str], None]
    whole: bool
    said: list[str] = field(default_factory=list)
    held: list[str] = field(default_factory=list)
    used: int = 0

    def add(self, line: str) -> None:
        """Print a new line below the heading; the last place on the screen is kept."""
        from taction.verification.report.views.remedies import HEAD
        from taction.verification.report.views.verdict_screen import CHANGES, height

        if not line or line in self.said:
            return
        if not self.said and line != HEAD:
            self.add(HEAD)
        self.said.append(line)
        if self.whole or self.used + height(line) < CHANGES:
            self.used += height(line)
            self.show(line)
        else:
            self.held.append(line)

    def end(self, text: str) -> None:
        """Print what the search knows at its end, and how many lines are not printed."""
        for line in text.splitlines():
            self.add(line)
        if self.held:
            self.show(f"  and {len(self.held)} more: -v")
