"""A plug-in of pytest (`-p`): python-can without asammdf, which brings pandas and is not needed here."""

import sys

sys.modules["asammdf"] = None  # type: ignore[assignment]
