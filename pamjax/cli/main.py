"""The command `pamjax`: its subcommands, and how a bad input leaves it."""

from __future__ import annotations

import errno
import os
import sys
from importlib.metadata import version
from keyword import iskeyword
from typing import NoReturn

from cyclopts import App, CycloptsError

from pamjax.cli.help import ParagraphFormatter
from pamjax.cli.misused import format_usage_error
from pamjax.errors import BadInput

#: Exit codes: an answer, a bad input, an interruption.
EXIT_OK, EXIT_REFUSED, EXIT_INTERRUPTED = 0, 2, 130

#: Errors of a disk that the user can mend: full, over quota, read-only, closed, too long a name.
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG)

app = App(
    name="pamjax",
    help="Pneumatic artificial muscles: calibrated on recordings, with honest uncertainty.",
    version=lambda: version("pamjax"),
    help_format="plaintext",
    help_formatter=ParagraphFormatter(),
    suppress_keyboard_interrupt=False,  # it is told below
)
for command_name, summary in {
    "new": "Write a commented case folder to fill in.",
    "import": "Make a case folder from a rig's files, CSV or MAT, one a test or a channel.",
    "check": "Say whether a case is fit to be fitted, without fitting it.",
    "fit": "Calibrate a muscle on its recording, or several muscles together.",
    "sample": "Draw from the posterior of a muscle's numbers: how sure they are.",
    "compare": "Compare posteriors by how they predict blocks they did not see.",
    "diagnose": "Name the physics that a recording's model leaves out, and show the gain.",
    "validate": "Hold a model against a recording that it never saw.",
    "prove": "Conceal known physics in simulated recordings, diagnose them, and score.",
    "size": "Choose a muscle that does what a spec wants, at the least diameter, mass, air or cost.",
    "inverse": "Say which pressure or length gives a wanted force; export that for a robot.",
    "plan": "Choose the next runs: for a number, or to tell two mechanisms apart.",
    "simulate": "Make the case folder that a bench would have written.",
    "explain": "Say what a number or a mechanism means; without a name, list them all.",
}.items():
    # Named by path: a subcommand's module, and what it imports, is loaded when it is run.
    module_name = f"{command_name}_" if iskeyword(command_name) else command_name
    app.command(f"pamjax.cli.commands.{module_name}:{module_name}", name=command_name, help=summary)
app.register_install_completion_command(
    help="Let the shell (bash, zsh or fish) complete the commands of pamjax; writes to its start file."
)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line.

    Args:
        arguments: the words after `pamjax`; None takes the process's own.

    Returns:
        the exit code: 0 for an answer, 2 for a bad input, 130 if interrupted.
    """
    from pamjax.cli.screen import defer_interrupts, raise_interrupt, remember_command

    # A busy machine draws a compilation out, and XLA shouts about it; what fails raises all the same.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    remember_command(sys.argv[1:] if arguments is None else arguments)
    try:
        with defer_interrupts():
            app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
            raise_interrupt()
        sys.stdout.flush()
    except (BadInput, CycloptsError) as error:
        print(
            f"pamjax: {format_usage_error(error) if isinstance(error, CycloptsError) else error}",
            file=sys.stderr,
        )
        return EXIT_REFUSED
    except BrokenPipeError:
        # The reader had enough, as `head` has; nor is there anything left to flush at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise
        place = f" ({error.filename})" if error.filename else ""
        message = f"the disk says: {error.strerror}{place}"
        print(f"pamjax: {message}. Read or write somewhere else.", file=sys.stderr)
        return EXIT_REFUSED
    except KeyboardInterrupt:
        print("pamjax: interrupted; nothing was written half", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_OK


def run() -> NoReturn:
    """The process `pamjax`: `main` on its own words, and its exit code."""
    code = main()
    if code == EXIT_INTERRUPTED:
        # A compilation that was broken off leaves JAX's runtime in a state in which Python's own clearing up
        # now and then ends in a segmentation fault. Everything is written or thrown away by now.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
