"""How the command meets its user: one line for every failure, an exit status that means it."""

import difflib
import math
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from graphnav.common.errors import GraphnavError

INTERRUPTED = 130
NOTHING_WRITTEN = "interrupted; no result was written"
UNDETERMINED = (
    "the sensors leave the solution undetermined: their stated noise, or what they hold, is far "
    "out of proportion; check units and figures in the vehicle file (graphnav check tells more)"
)
OUT_OF_MEMORY = (
    "out of memory; no result was written: smooth the run in parts, or lower --nodes or --rate"
)


class OneLine(click.Group):
    """A group that lists commands as written and names the nearest when there is no such one."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order a user meets them."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Click's own, with a suggestion."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError:
            near = difflib.get_close_matches(args[0], self.commands, 1, 0.4)
            hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(self.commands)}"
            raise click.UsageError(f"no command '{args[0]}'; {hint}", ctx) from None


class Numbers(click.ParamType[tuple[float, ...]]):
    """A few numbers in one word: `600:660`, `0,-1.2,1.8`."""

    name = "numbers"

    def __init__(self, count: int, mark: str, form: str) -> None:
        self.count, self.mark, self.form = count, mark, form

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """The numbers; a usage error when they are not as many, or a span that ends first."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(self.mark))
        except ValueError:
            numbers = ()
        if len(numbers) != self.count or not all(map(math.isfinite, numbers)):
            self.fail(f"'{value}' is not {self.form}", param, ctx)
        if self.mark == ":" and not numbers[0] < numbers[1]:
            self.fail(f"'{value}': START must come before END", param, ctx)
        return numbers


class Place(click.Path):
    """A path that says something, in characters other programs can write down."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; a usage error where it is empty or its bytes are no UTF-8."""
        text = os.fspath(value)
        if not text:
            self.fail("a path is needed, not ''", param, ctx)
        if any("\ud800" <= character <= "\udfff" for character in text):
            self.fail(f"{text!a} is not UTF-8; rename the file or directory", param, ctx)
        return super().convert(value, param, ctx)


class ResultPlace(Place):
    """A result to be read; put back first where a killed run left nothing there."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path."""
        from graphnav.result.writing import restore

        path = super().convert(value, param, ctx)
        restore(path)
        return path


class Finite(click.FloatRange):
    """A number in a range that is one: neither nan nor infinite."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; a usage error when it is none."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"'{value}' is not a finite number", param, ctx)
        return number


def report_failures(command: click.Command, args: Sequence[str]) -> int:
    """Run `command` and return the exit status; what fails is one line on stderr.

    With GRAPHNAV_DEBUG set, unexpected exceptions come through with their traceback.
    """
    debug = bool(os.environ.get("GRAPHNAV_DEBUG"))
    if not debug:
        warnings.simplefilter("ignore")
    _open_streams()
    heard = _heard_signals()
    try:
        with command.make_context("graphnav", list(args)) as context:
            command.invoke(context)
    except click.exceptions.Exit as finished:
        return finished.exit_code
    except click.ClickException as error:
        return _usage(error)
    except (click.Abort, KeyboardInterrupt):
        return _say(NOTHING_WRITTEN, INTERRUPTED)
    except GraphnavError as error:
        return _say(str(error), error.exit_code)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if debug:
            raise
        return _say(f"{error.filename or 'what was printed'}: {error.strerror or error}", 2)
    except MemoryError:
        return _say(OUT_OF_MEMORY, 1)
    except Exception as error:
        if heard:
            return _say(NOTHING_WRITTEN, 128 + heard[-1])
        if debug:
            raise
        kind = type(error).__name__
        if kind == "LinAlgError" or "ndeterminate linear system" in str(error):
            return _say(UNDETERMINED, 1)
        return _say(f"unexpected {kind}: {error} (GRAPHNAV_DEBUG=1 shows where)", 1)
    return 0


def _open_streams() -> None:
    """Standard streams that the caller closed lead nowhere; else the next file would be one."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(number)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115


def _heard_signals() -> list[int]:
    """A list that fills with every Ctrl-C, kill and hang-up; the exception they raise runs the
    clean-up, but a library may turn it into one of its own.
    """
    heard: list[int] = []

    def hear(number: int, _: object) -> None:
        heard.append(number)
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        sys.exit(128 + number)

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # Windows has no SIGHUP
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, hear)
    return heard


def _usage(error: click.ClickException) -> int:
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return 2
    path = (
        error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else "graphnav"
    )
    return _say(f"{error.format_message().rstrip('.')} (see {path} --help)", 2)


def _say(text: str, status: int) -> int:
    print(f"graphnav: {' '.join(text.split())}", file=sys.stderr)
    return status
