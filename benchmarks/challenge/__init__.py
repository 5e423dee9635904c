"""A challenge that anyone can enter: records of boards with an effect that nobody declared, their continuation kept
back.

`python -m benchmarks.challenge make FOLDER` draws records from the population of `evaluation.undeclared` and writes
what entrants get to FOLDER/open and what is kept back to FOLDER/sealed; `score` compares; `baselines` writes the
answers of two entries that know nothing of effects, `tracer` those of this bench.  docs/challenge.md has the rules.
"""
