"""The command `pamjax`: its subcommands, error messages and exit codes."""

from __future__ import annotations

import errno
import os
import signal
import sys
from importlib.metadata import version
from keyword import iskeyword
from typing import NoReturn

from cyclopts import App, CycloptsError

from pamjax.cli.help import ParagraphFormatter
from pamjax.cli.import_example import IMPORT_EPILOGUE
from pamjax.cli.process import describe_missing_device, prepare_streams
from pamjax.cli.size_example import SIZE_EPILOGUE
from pamjax.cli.usage_errors import format_usage_error, name_options
from pamjax.compile.platform import choose_platform
from pamjax.errors import BadInput

#: Exit codes: success, bad input, interruption by Ctrl-C, termination by another process.
_EXIT_OK, _EXIT_REFUSED, _EXIT_INTERRUPTED, _EXIT_TERMINATED = 0, 2, 130, 143

#: File errors that the user can correct: disk full, over quota, file above its size limit, read-only, no
#: permission, name too long.
DISK_ERRORS = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EROFS,
    errno.EACCES,
    errno.EPERM,
    errno.ENAMETOOLONG,
)

app = App(
    name="pamjax",
    help="Calibrate models of pneumatic artificial muscles, quantify their uncertainty, and identify"
    " missing physics.",
    version=lambda: version("pamjax"),
    help_format="plaintext",
    help_formatter=ParagraphFormatter(),
    suppress_keyboard_interrupt=False,  # `main` handles it
)
epilogues = {"import": IMPORT_EPILOGUE, "size": SIZE_EPILOGUE}
for command_name, summary in {
    "new": "Write a commented case folder as a template.",
    "import": "Make a case folder from the CSV, XLSX or MAT files of a test rig.",
    "check": "Check the data of a case, and which parameters it determines.",
    "fit": "Calibrate a muscle model on its recording, or several muscles together.",
    "sample": "Estimate the posterior uncertainty of the parameters of a muscle.",
    "compare": "Compare posteriors of one recording by their predictions of held-out blocks.",
    "diagnose": "Test the model of a recording and identify missing mechanisms.",
    "validate": "Test a model on recordings that its fit did not use.",
    "fleet": "Check, fit and diagnose many recordings, and compare their specimens.",
    "prove": "Test `pamjax diagnose` on simulated recordings with concealed effects.",
    "size": "Design a muscle with the smallest diameter, mass, air or cost for a specification.",
    "inverse": "Compute the pressure or length for a wanted force, or export a table of it.",
    "plan": "Choose the next runs: to determine a parameter, or to distinguish two mechanisms.",
    "simulate": "Simulate a recording of a muscle and write it as a case folder.",
    "explain": "Describe a parameter or a mechanism; without a name, list all of them.",
}.items():
    # The command is registered by its path, so that its module is imported only when it runs.
    module_name = f"{command_name}_" if iskeyword(command_name) else command_name
    epilogue = {"help_epilogue": epilogues[command_name]} if command_name in epilogues else {}
    app.command(
        f"pamjax.cli.commands.{module_name}:{module_name}", name=command_name, help=summary, **epilogue
    )
app.register_install_completion_command(
    help="Install command completion for bash, zsh or fish; this changes the start file of the shell."
)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line.

    Args:
        arguments: arguments after `pamjax`; None uses those of the process.

    Returns:
        the exit code: 0 for success, 2 for bad input, 130 for Ctrl-C, 143 for a termination.
    """
    from pamjax.cli.screen import defer_interrupts, is_terminated, raise_interrupt, store_command

    prepare_streams()
    # Suppress XLA's warnings about slow compilation. Errors still raise exceptions.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    # Child processes of the command inherit the choice.
    os.environ.update(choose_platform(os.environ))
    store_command(sys.argv[1:] if arguments is None else arguments)
    try:
        with defer_interrupts():
            app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
            raise_interrupt()
        sys.stdout.flush()
    except (BadInput, CycloptsError) as error:
        is_usage_error = isinstance(error, CycloptsError)
        message = format_usage_error(error) if is_usage_error else name_options(str(error))
        print(f"pamjax: {message}", file=sys.stderr)
        return _EXIT_REFUSED
    except BrokenPipeError:
        # The reader, for example `head`, closed the pipe. Redirect the output to avoid an error at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise
        place = f" ({error.filename})" if error.filename else ""
        message = f"cannot read or write a file: {error.strerror}{place}"
        print(f"pamjax: {message}. Use another path.", file=sys.stderr)
        return _EXIT_REFUSED
    except KeyboardInterrupt:
        word = "terminated" if is_terminated() else "interrupted"
        print(f"pamjax: {word}; no incomplete file was written", file=sys.stderr)
        return _EXIT_TERMINATED if is_terminated() else _EXIT_INTERRUPTED
    except (RuntimeError, AssertionError):
        message = describe_missing_device()
        if not message:
            raise
        print(f"pamjax: {message}", file=sys.stderr)
        return _EXIT_REFUSED
    return _EXIT_OK


def run() -> NoReturn:
    """Run `main` on the arguments of the process, and exit with its code."""
    code = main()
    if code in (_EXIT_INTERRUPTED, _EXIT_TERMINATED):
        # After an interrupted compilation, the clean-up of the JAX runtime at exit sometimes causes a
        # segmentation fault. All files are complete here, so skip the clean-up.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    # All results are written and printed: Ctrl-C during the clean-up must not change the exit code.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(code)
