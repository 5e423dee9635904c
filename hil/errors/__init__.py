"""How the bench says that something cannot be used, and how a program of it ends."""

from hil.errors.input import InputError, printable, printable_json, told_to_user
from hil.errors.told import in_two

__all__ = ["InputError", "in_two", "printable", "printable_json", "told_to_user"]
