"""Sources of compiled modules, written from the declarations of models and effects."""
