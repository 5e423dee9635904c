"""What `import hil` offers: verbs that take names, paths, runs or arrays, and what they return."""
