"""What each threshold of tracing does: what breaks when it is halved, and when it is doubled.

    python -m benchmarks.thresholds [measure|page] [--jobs 2] [--folder runs/thresholds] [--out docs/results]

A fixed set of short records is traced in processes of their own, each with other thresholds: two axes from the
generator of `evaluation.undeclared`, a single axis, rate sensors, and records that are to be refused. What tracing
answers is compared with what it answers by the thresholds as they are: the verdict with the effects that it names, and
the look-alikes, advice and findings beside it.

A threshold that was not read while a record was traced cannot change its answer. Of the others several are changed at
once; where an answer changes, they are halved until one is left. Two that make up for each other are missed so.

A number between 0.5 and 1 is a share: what it lacks to one is halved and doubled. Of a number between 1 and 1.5, what
it has beyond one is.
"""
