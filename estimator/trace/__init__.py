"""What a record says of a model and of what it lacks: maximum likelihood, score tests, a short search, checks.

Problem → FittedModel → ScoreTable → [FittedModel] → [Check] → Diagnosis.  Parameters are not states: a filter of the
motion, the sense offsets and the rate gives innovations, and in the same pass their sensitivities to every parameter
(Ljung, System Identification, 2nd ed., ch. 7, 10, 11; Kristensen, Madsen & Jørgensen, Automatica 40, 2004).

    what is asked    problem, pool, traceable
    likelihood       likelihood, and four of it: filtered, free_run, output_error, pooled; candidates, start_values
    FittedModel      fit
    ScoreTable       score_test, exchange
    [FittedModel]    search, ambiguity: chosen
    [Check]          checks
    Diagnosis        trace, pool_trace, output_trace; verdict writes it, of named, rejected, pairs, probabilities

The import contract of `pyproject.toml` holds that order.
"""
