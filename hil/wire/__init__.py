"""The wire between host and board: spec, codecs, framing and both ends of every link.

Imports nothing else of `hil`, so that the emulator can use it without loading the bench.
"""
