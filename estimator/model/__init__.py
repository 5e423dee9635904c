"""The physics, declared once as symbols, and what is generated from it."""
