"""For the processes that a test starts: the module that is being tried is the changed one there, too."""

import importlib.util
import os

if _place := os.environ.get("GYROHIL_MUTANT_HOOK"):
    _spec = importlib.util.spec_from_file_location("mutant_hook", _place)
    assert _spec is not None
    assert _spec.loader is not None
    _hook = importlib.util.module_from_spec(_spec)
    _spec.loader.exec_module(_hook)
    _hook.install()
