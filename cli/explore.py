"""``taction explore``: a local page on which the board follows the hand."""

from __future__ import annotations

import click

from taction.cli.common import say, scene_command


@scene_command
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port of the page on 127.0.0.1; 0 is any free port.",
)
@click.option(
    "--browser/--no-browser",
    default=True,
    help="Open the page in a browser, where there is a display.",
)
def explore(scene: str, port: int, browser: bool, as_json: bool) -> None:
    """Serve a page with sliders for C, gain, lambda, stray capacitance and noise, until Ctrl-C.

    Waveforms, poles, stable values of C and the recovered stress follow at once, by the state-space
    engine; the verdict follows when it is ready. The page is for this machine alone, and its
    address has a secret.
    """
    from taction.netlist_gen.scene.file import load_scene
    from taction.verification.report.explorer.server import explore as serve

    def announce(address: str) -> None:
        if as_json:
            from taction.cli.common import print_json

            print_json({"address": address})
        else:
            click.echo(address)
        say("Ctrl-C ends the explorer")

    try:
        serve(load_scene(scene), port=port, show=browser, announce=announce)
    except KeyboardInterrupt:
        say("ended")
