"""Emulators written from the equations of the reference pages alone: devices, loops and records for tracing."""
