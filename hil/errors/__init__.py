"""How the bench says that something cannot be used, and how a program of it ends."""

from hil.errors.input import InputError, machine_fault, printable, printable_json, refusal_of, told_to_user

__all__ = ["InputError", "machine_fault", "printable", "printable_json", "refusal_of", "told_to_user"]
