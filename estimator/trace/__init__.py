"""What a record says of a model and of what it lacks: maximum likelihood, score tests, a short search, checks.

Problem → FittedModel → ScoreTable → [FittedModel] → [Check] → Diagnosis.  Parameters are not states: a filter of the
motion, the sense offsets and the rate gives innovations, and in the same pass their sensitivities to every parameter
(Ljung, System Identification, 2nd ed., ch. 7, 10, 11; Kristensen, Madsen & Jørgensen, Automatica 40, 2004).
"""
