"""Undeclared effects in quantity: emulated records whose effect nobody declared, and how well tracing names it.

`python -m evaluation.undeclared generate` draws devices, effects and rates and records them in closed loop;
`evaluate` traces each record without its truth and compares.  The generator knows the emulator, the tracer the
estimator; they meet in `truth.json`, which only the evaluation reads.
"""
