"""The ways graphnav can fail; each carries one line a user can act on."""


class GraphnavError(Exception):
    """Base of every error graphnav raises on purpose; `exit_code` is the command's status."""

    exit_code = 1


class InputError(GraphnavError):
    """The input or the options are at fault: names the file, the row or time, and the cure."""

    exit_code = 2


class SolutionError(GraphnavError):
    """The solution failed: names the sensor or time span that left it without information."""

    exit_code = 1


class RejectedError(GraphnavError):
    """A result was written, but its sensors contradict each other beyond use: cause and cure."""

    exit_code = 3
