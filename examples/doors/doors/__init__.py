"""A link, a sensor and a file format of one's own."""
