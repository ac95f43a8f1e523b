"""``taction verify SCENE``: the verdict is printed when it is known, then what mends it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import taction
from taction.cli.command import Call, load
from taction.cli.printing import StageLine, put, say
from taction.cli.running import is_of_stdout
from taction.system.errors import Interrupted
from taction.system.progress import attempt

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
        return _searched(found, options, progress)
    attempt("the text", lambda: show(_body(found, options)), None, say, is_of_stdout)
    found = _searched(found, options, progress)
    lines = change_lines(found, whole=options["verbose"])
    attempt("the changes", lambda: show(lines), None, say, is_of_stdout)
    return found


def _searched(found: Verified, options: dict[str, Any], progress: StageLine) -> Verified:
    """Return the verdict with the changes that mend it."""
    given = {name: options[name] for name in ("changes", "any_part")}

    def search() -> Remedies | None:
        return taction.what_to_change(found.verdict, **given, progress=progress)

    try:
        return replace(found, remedies=attempt("the search for changes", search, None, say))
    except KeyboardInterrupt:
        raise Interrupted("the verdict stands, the search for changes was ended", found) from None


def _body(found: Verified, options: dict[str, Any]) -> list[Any]:
    """Return what is printed of a verdict, without its last line."""
    from taction.verification.report.renderers.terminal import page_lines
    from taction.verification.report.views.answer_view import margin_lines

    margins = tuple(margin_lines(found.document))
    if options["verbose"]:
        from taction.verification.report.views.verdict_view import view

        page = view(found.verdict, notes=margins, verbose=True)
    else:
        from taction.verification.report.views.verdict_view import screen

        page = screen(found.verdict, margins)
    return [*page_lines(page)][:-1]


def change_lines(found: Verified, *, whole: bool) -> list[str]:
    """Return the changes that mend a verdict as lines below a heading: all, or the first."""
    if found.remedies is None:
        return []
    from taction.verification.report.views.design_view import remedies_text
    from taction.verification.report.views.verdict_view import CHANGES

    lines = remedies_text(found.verdict.scene, found.remedies).splitlines()
    rest = 0 if whole else max(len(lines) - CHANGES, 0)
    return [*lines[: len(lines) - rest], *[f"  and {rest} more: -v"] * bool(rest)]


def print_outcome(found: Verified) -> None:
    """Print the last line."""
    from taction.verification.report.renderers.terminal import outcome_line

    put(outcome_line(found.outcome))
