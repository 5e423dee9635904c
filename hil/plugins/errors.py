"""What ends a run for a plug-in's sake."""

from hil.wire.errors import WireError


class PluginError(WireError):
    """A plug-in did what it must not: raised, said what is no number, drove beyond the limit, took too long.

    The message is one line that names it.
    """
