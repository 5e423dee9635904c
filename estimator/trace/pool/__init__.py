"""Several records of one device in one trace: the constants are shared, each record begins by itself, a coefficient may
depend on a covariate, and whole records are held out.
"""
