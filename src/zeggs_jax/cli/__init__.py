"""The `zeggs` command: one function for each subcommand, one sentence for each thing that can go wrong."""

import functools
import os
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import tyro

from . import diffuse, export, judge, learn, perform, stream, style, timeline

COMMANDS = (
    perform.demo,
    perform.generate,
    stream.stream,
    style.embed,
    style.styles,
    timeline.timeline,
    learn.prepare,
    learn.train,
    learn.convert,
    export.export,
    perform.view,
    judge.evaluate,
)


def _kept(command: Callable[..., None]) -> Callable[..., None]:
    """The command, with what it compiles kept for the next one."""

    @functools.wraps(command)
    def run(*given: Any, **options: Any) -> None:
        from ..nn import compiled

        compiled.keep()
        command(*given, **options)

    return run


app = tyro.extras.SubcommandApp()
for command in COMMANDS:
    app.command(_kept(command))
diffuclip = tyro.extras.SubcommandApp()
for command in (diffuse.generate, diffuse.train):
    diffuclip.command(_kept(command))
app.command(diffuclip, name="diffuclip", help="GestureDiffuCLIP: gestures from speech, its words and a prompt.")


def _sentence(error: Exception) -> str:
    """What an error says, in one line; those of the system name the file first."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"'{error.filename}' cannot be read or written ({error.strerror}); check its name, its rights, the disk."
    return " ".join(str(error).split())


def main() -> None:
    """Runs the command line; bad input ends in one sentence on stderr and exit status 2."""
    if sys.argv[1:] == ["--version"]:
        print(f"zeggs-jax {version('zeggs-jax')}")
        return
    try:
        app.cli(
            prog="zeggs",
            description="Speech in, a moving body out, in a style you choose.",
        )
    except KeyboardInterrupt as stop:
        print(f"zeggs: {str(stop) or 'stopped'}.", file=sys.stderr)
        sys.exit(130)
    except (ValueError, OSError) as error:
        if os.environ.get("ZEGGS_DEBUG"):
            raise
        print(f"zeggs: {_sentence(error)}", file=sys.stderr)
        if train := sys.modules.get("zeggs_jax.zeroeggs.train"):
            train.devices.leave(2)  # one process of several must not wait for the others, which wait for it
        sys.exit(2)
