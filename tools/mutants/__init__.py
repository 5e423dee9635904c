"""Small changes to a module: does a test fail for each of them?"""
